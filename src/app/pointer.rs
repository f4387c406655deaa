use egui::{Event, PointerButton, Pos2, Ui};

/// Where the pointer went in this frame while one of the buttons was down, in points of the screen, from where it was
/// pressed if it was in this frame. While frames are slow there are many places in each, and a line needs them all.
pub(crate) fn trail(ui: &Ui, buttons: &[PointerButton]) -> Vec<Pos2> {
    let of_button = |event: &Event, down: bool| match event {
        Event::PointerButton {
            button, pressed, ..
        } => *pressed == down && buttons.contains(button),
        _ => false,
    };
    ui.input(|input| {
        let begin = input
            .events
            .iter()
            .rposition(|event| of_button(event, true))
            .unwrap_or(0);
        let held = input.events[begin..]
            .iter()
            .take_while(|event| !of_button(event, false));
        held.filter_map(place).collect()
    })
}

fn place(event: &Event) -> Option<Pos2> {
    match event {
        Event::PointerMoved(at) | Event::PointerButton { pos: at, .. } => Some(*at),
        _ => None,
    }
}

/// How long the pointer rests before something is told of what lies under it, in seconds.
const REST_S: f64 = 0.12;
/// Movements below this are a hand at rest, in screen points.
const STILL: f32 = 2.0;

/// Where on the screen the pointer rests, and since when.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rest {
    at: Pos2,
    since_s: f64,
}

impl Rest {
    /// Follows the pointer; where it rests, once it does so for long enough. Until then the window is drawn again in time.
    pub(super) fn follow(rest: &mut Option<Self>, ui: &Ui, at: Pos2) -> Option<Pos2> {
        let now = ui.input(|input| input.time);
        let same = rest
            .filter(|rest| rest.at.distance(at) < STILL)
            .unwrap_or(Self { at, since_s: now });
        *rest = Some(same);
        let left_s = same.since_s + REST_S - now;
        if left_s > 0.0 {
            ui.ctx().request_repaint_after_secs(left_s as f32);
        }
        (left_s <= 0.0).then_some(same.at)
    }
}
