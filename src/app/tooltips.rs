use egui::{Button, Response, Ui, Widget};

use super::{Action, Shortcuts};

/// Adds a button for `action`, with its description and shortcut as tooltip.
///
/// `unavailable` is the reason for which it is disabled.
pub(super) fn action_button(
    ui: &mut Ui,
    shortcuts: &Shortcuts,
    action: Action,
    text: &str,
    unavailable: Option<&str>,
) -> Response {
    let tip = shortcuts.tip(ui.ctx(), action);
    // In a wrapping bar the whole button moves to the next row, so its text must not wrap.
    let button = Button::new(text).wrap_mode(egui::TextWrapMode::Extend);
    add_explained(ui, button, &tip, unavailable)
}

/// Adds the highlighted button of a step, as wide as the panel.
pub(super) fn primary_button(
    ui: &mut Ui,
    text: &str,
    tip: &str,
    unavailable: Option<&str>,
) -> Response {
    let (fill, color) = if ui.visuals().dark_mode {
        (egui::Color32::from_rgb(44, 108, 190), egui::Color32::WHITE)
    } else {
        (egui::Color32::from_rgb(30, 100, 200), egui::Color32::WHITE)
    };
    let text = egui::RichText::new(text).strong();
    let button = if unavailable.is_none() {
        Button::new(text.color(color)).fill(fill)
    } else {
        Button::new(text)
    };
    let size = egui::vec2(ui.available_width(), 26.0);
    let enabled = unavailable.is_none();
    let response = ui
        .add_enabled_ui(enabled, |ui| ui.add_sized(size, button))
        .inner;
    explained(response, tip, unavailable)
}

/// Adds a control that is disabled while there is a reason for it, which its tooltip gives.
pub(super) fn add_explained(
    ui: &mut Ui,
    widget: impl Widget,
    tip: &str,
    unavailable: Option<&str>,
) -> Response {
    let response = ui.add_enabled(unavailable.is_none(), widget);
    explained(response, tip, unavailable)
}

/// Adds the tooltip of a control: what it does, and why it is disabled.
pub(super) fn explained(response: Response, tip: &str, unavailable: Option<&str>) -> Response {
    let Some(reason) = unavailable else {
        return response.on_hover_text(tip);
    };
    // Screen readers get the reason too.
    response
        .ctx
        .accesskit_node_builder(response.id, |node| node.set_description(reason));
    response.on_disabled_hover_ui(|ui| {
        ui.set_max_width(ui.spacing().tooltip_width);
        ui.label(tip);
        ui.colored_label(ui.visuals().warn_fg_color, reason);
    })
}

/// Adds an icon button that screen readers announce as `name`.
pub(super) fn icon_button(ui: &mut Ui, icon: &str, name: &str, tip: &str) -> Response {
    ui.add(Button::new(icon).frame(false))
        .on_hover_text(tip)
        .accessible_name(name)
}

/// Shows a modal dialog over the dimmed window.
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

/// Adds the heading of a section inside a panel.
pub(super) fn section_heading(ui: &mut Ui, text: &str) {
    ui.add_space(2.0);
    ui.label(egui::RichText::new(text).strong().size(14.0));
    ui.add_space(2.0);
}

/// Groups controls of a bar, about `width` points wide.
///
/// The group starts a new row where the current one has too little space.
pub(super) fn together<R>(ui: &mut Ui, width: f32, content: impl FnOnce(&mut Ui) -> R) -> R {
    let size = egui::vec2(width, ui.spacing().interact_size.y);
    ui.allocate_ui_with_layout(
        size,
        egui::Layout::left_to_right(egui::Align::Center),
        content,
    )
    .inner
}

/// Adds a row to a form: label on the left, control on the right with the same accessible name.
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

/// Draws a check box for a number that is chosen by itself; returns whether it was changed.
///
/// Its text gives way to the number, so that both fit the side panel.
pub(super) fn automatic_ui(ui: &mut Ui, is_automatic: &mut bool, tip: &str) -> bool {
    let text = if *is_automatic { "Automatic" } else { "" };
    ui.checkbox(is_automatic, text)
        .on_hover_text(tip)
        .accessible_name("Automatic")
        .changed()
}

/// Formats a number with thin spaces between thousands.
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
    fn thousands_are_separated() {
        assert_eq!(super::grouped(5_000_123), "5 000 123");
        assert_eq!(super::grouped(12), "12");
    }
}
