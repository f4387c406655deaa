//! Entries of menus: text with shortcut, tick of a switch, and the reason while they are disabled.

use egui::{Atom, Button, IntoAtoms, Shape, Stroke, Ui, Vec2, WidgetInfo};

use super::tooltips::explained;
use super::{Action, SessionView, ViewState};

/// Place of the tick before the text of an entry.
const TICK: Vec2 = Vec2::new(12.0, 12.0);

/// Returns text that starts where the texts of other entries start.
pub(super) fn indented(text: &str) -> impl IntoAtoms<'_> {
    (Atom::custom(egui::IdSalt::new("tick"), TICK), text)
}

/// Draws the entry of an action and returns `true` if it is clicked.
pub(super) fn menu_entry_ui(
    ui: &mut Ui,
    action: Action,
    session: &SessionView<'_>,
    view: &ViewState,
) -> bool {
    let unavailable = action.unavailable(session, view);
    let on = action.is_on(ui.ctx(), session, view);
    let text = action.text_now(session);
    let keys = view.prefs.shortcuts.text(ui.ctx(), action);
    let is_ticked = on == Some(true);
    let tick = Atom::paint(TICK, move |ui, args| {
        if is_ticked {
            let at = |x: f32, y: f32| args.rect.center() + Vec2::new(x, y);
            let line = vec![at(-4.0, 0.0), at(-1.2, 3.2), at(4.4, -3.6)];
            let stroke = Stroke::new(1.8, args.fallback_text_color);
            ui.painter().add(Shape::line(line, stroke));
        }
    });
    let button = Button::new((tick, text.as_str())).shortcut_text(keys);
    let response = ui.add_enabled(unavailable.is_none(), button);
    let is_enabled = response.enabled();
    response.widget_info(|| match on {
        Some(on) => WidgetInfo::selected(egui::Role::CheckBox, is_enabled, on, &text),
        None => WidgetInfo::labeled(egui::Role::Button, is_enabled, &text),
    });
    explained(response, action.tip(), unavailable).clicked()
}
