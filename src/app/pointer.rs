use egui::{Event, PointerButton, Pos2, Ui};

/// Returns the path of the pointer in this frame while one of `buttons` was down, in screen points.
///
/// If the button was pressed in this frame, the path starts there. A slow frame contains many
/// pointer events, and a stroke needs all of them.
pub(crate) fn pointer_path(ui: &Ui, buttons: &[PointerButton]) -> Vec<Pos2> {
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

/// A press or a release of the primary button, in screen points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum PrimaryEnd {
    Pressed(Pos2),
    Released(Pos2),
}

/// Returns the presses and releases of the primary button in this frame, in their order.
///
/// egui reports no drag if the pointer moves and the button is released in one slow frame, which
/// may even end one drag and begin the next; the events always have both.
pub(crate) fn primary_ends(ui: &Ui) -> Vec<PrimaryEnd> {
    let end = |event: &Event| match *event {
        Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            ..
        } => Some(match pressed {
            true => PrimaryEnd::Pressed(pos),
            false => PrimaryEnd::Released(pos),
        }),
        _ => None,
    };
    ui.input(|input| input.events.iter().filter_map(end).collect())
}

fn place(event: &Event) -> Option<Pos2> {
    match event {
        Event::PointerMoved(at) | Event::PointerButton { pos: at, .. } => Some(*at),
        _ => None,
    }
}

/// Time the pointer has to rest before the position under it is evaluated, in seconds.
const REST_S: f64 = 0.12;
/// Movement that still counts as resting, in screen points.
const STILL: f32 = 2.0;

/// Resting position of the pointer on the screen, and since when it rests there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HoverDwell {
    at: Pos2,
    since_s: f64,
}

impl HoverDwell {
    /// Follows the pointer and returns its position once it has rested for long enough.
    ///
    /// Until then a repaint is scheduled for the end of the waiting time.
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
