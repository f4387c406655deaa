//! Rows of tools of fixed height above the panes.

use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{Align, Button, Layout, PopupCloseBehavior, Rect, Sense, Ui, UiBuilder, Vec2};

use super::icons::{ICON_SIZE, Icon, paint_icon};

/// Height of a row in points.
pub(super) const TOOL_ROW: f32 = 28.0;
/// Width of an item that is always in the menu at the end.
pub(super) const IN_MENU: f32 = f32::INFINITY;
/// Width of an icon button with its gap.
pub(super) const ICON: f32 = ICON_SIZE.x + GAP;
const GAP: f32 = 2.0;

/// Draws a row of items with their widths; `draw` gets `true` for an item in the menu.
///
/// Items that do not fit are in a menu, called `name`, so that the row never gets a second line. Two
/// buttons have their place at the right end.
pub(super) fn tool_row<T: Copy>(
    ui: &mut Ui,
    name: &str,
    items: &[(T, f32)],
    mut draw: impl FnMut(&mut Ui, Slot<T>),
) {
    let end_width = 2.0 * ICON;
    let size = Vec2::new(ui.available_width(), TOOL_ROW);
    let (rect, _) = ui.allocate_exact_size(size, Sense::hover());
    let inner = rect.shrink2(Vec2::new(6.0, 2.0));
    let all: f32 = items.iter().map(|item| item.1).sum();
    let room = inner.width() - end_width;
    let room = if all <= room { room } else { room - ICON };
    let mut used = 0.0;
    let fits = items
        .iter()
        .take_while(|item| {
            used += item.1;
            used <= room
        })
        .count();
    let builder = UiBuilder::new()
        .max_rect(Rect::from_min_max(
            inner.min,
            inner.max - Vec2::new(end_width, 0.0),
        ))
        .layout(Layout::left_to_right(Align::Center));
    let mut row = ui.new_child(builder);
    row.set_clip_rect(inner.intersect(ui.clip_rect()));
    row.spacing_mut().item_spacing.x = GAP;
    for item in &items[..fits] {
        draw(&mut row, Slot::Row(item.0));
    }
    if fits < items.len() {
        let menu = icon_menu(&mut row, Icon::More, name, |ui| {
            ui.set_min_width(200.0);
            for item in &items[fits..] {
                draw(ui, Slot::Menu(item.0));
            }
        });
        menu.on_hover_text("Tools that do not fit in this row");
    }
    let end = UiBuilder::new()
        .max_rect(inner)
        .layout(Layout::right_to_left(Align::Center));
    let mut end = ui.new_child(end);
    end.spacing_mut().item_spacing.x = GAP;
    draw(&mut end, Slot::End);
}

/// Where an item is drawn.
#[derive(Clone, Copy)]
pub(super) enum Slot<T> {
    /// In the row.
    Row(T),
    /// In the menu of what does not fit.
    Menu(T),
    /// At the right end of the row, from right to left.
    End,
}

/// Adds a menu with an icon; it stays open while its contents are changed.
pub(super) fn icon_menu(
    ui: &mut Ui,
    icon: Icon,
    name: &str,
    content: impl FnOnce(&mut Ui),
) -> egui::Response {
    let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    let button = Button::new("")
        .min_size(ICON_SIZE)
        .frame_when_inactive(false);
    let (response, _) = MenuButton::from_button(button)
        .config(config)
        .ui(ui, content);
    let color = ui.style().interact(&response).text_color();
    paint_icon(ui.painter(), response.rect.center(), icon, color);
    response.accessible_name(name)
}
