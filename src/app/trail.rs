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
