use egui::{Button, Response, Ui};

use super::{Action, Shortcuts};

/// A button that does `action`: its tooltip says what, and with which keys.
pub(super) fn action_button(
    ui: &mut Ui,
    shortcuts: &Shortcuts,
    action: Action,
    text: &str,
    enabled: bool,
) -> Response {
    let tip = shortcuts.tip(ui.ctx(), action);
    // A button in a bar moves to the next row as a whole: its text must not break.
    let button = Button::new(text).wrap_mode(egui::TextWrapMode::Extend);
    let button = ui.add_enabled(enabled, button);
    button.on_hover_text(&tip).on_disabled_hover_text(tip)
}

/// An icon that is read out as `name`.
pub(super) fn icon_button(ui: &mut Ui, icon: &str, name: &str, tip: &str) -> Response {
    ui.add(Button::new(icon).frame(false))
        .on_hover_text(tip)
        .accessible_name(name)
}

/// A dialog over the dimmed window, with room around its content.
pub(super) fn modal<T>(
    ui: &Ui,
    name: &str,
    width: f32,
    content: impl FnOnce(&mut Ui) -> T,
) -> egui::ModalResponse<T> {
    let frame = egui::Frame::popup(ui.style())
        .inner_margin(18.0)
        .corner_radius(ui.visuals().window_corner_radius);
    egui::Modal::new(egui::Id::unique(name))
        .frame(frame)
        .show(ui.ctx(), |ui| {
            ui.set_width(width);
            content(ui)
        })
}

/// A heading of a section inside a panel.
pub(super) fn section_heading(ui: &mut Ui, text: &str) {
    ui.add_space(2.0);
    ui.label(egui::RichText::new(text).strong().size(14.0));
    ui.add_space(2.0);
}

/// Controls of a bar that belong together, about `width` points wide: where the row has no room left they begin the next.
pub(super) fn together<R>(ui: &mut Ui, width: f32, content: impl FnOnce(&mut Ui) -> R) -> R {
    let size = egui::vec2(width, ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(
        size,
        egui::Layout::left_to_right(egui::Align::Center),
        content,
    )
    .inner
}

/// A row of a form: what it is on the left, the control on the right, named after it.
pub(super) fn field<R>(
    ui: &mut Ui,
    name: &str,
    tip: &str,
    content: impl FnOnce(&mut Ui) -> R,
) -> R {
    ui.label(name).on_hover_text(tip);
    let result = ui.name_inputs(name, |ui| ui.horizontal(content).inner);
    ui.end_row();
    result
}

/// A number with thin gaps between thousands.
pub(super) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn thousands_are_apart() {
        assert_eq!(super::grouped(5_000_123), "5 000 123");
        assert_eq!(super::grouped(12), "12");
    }
}
