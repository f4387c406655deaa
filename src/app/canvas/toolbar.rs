use egui::{ComboBox, Slider, Ui};

use super::draft::Tool;
use crate::icons::{Icon, IconButton};
use crate::menu::is_possible;
use crate::pane_buttons::pane_buttons_ui;
use crate::tool_row::{ICON, IN_MENU, Slot, tool_row};
use crate::{Action, SessionView, ViewState};
use ostra_view::Layer;

/// Item of the tool row above the image.
#[derive(Clone, Copy)]
enum Item {
    Gap,
    Tool(Tool),
    BrushRadius,
    Snap,
    View(Action),
    Zoom,
    Layer,
    Masks,
    Opacity,
    Outlines,
    Clean(Action),
    CleanSize,
}

const ITEMS: [(Item, f32); 20] = [
    (Item::Tool(Tool::Click), ICON),
    (Item::Tool(Tool::Brush), ICON),
    (Item::Tool(Tool::Eraser), ICON),
    (Item::Tool(Tool::Polygon), ICON),
    (Item::Tool(Tool::Border), ICON),
    (Item::Tool(Tool::Stem), ICON),
    (Item::Gap, 6.0),
    (Item::BrushRadius, 56.0),
    (Item::Gap, 6.0),
    (Item::View(Action::Fit), ICON),
    (Item::View(Action::ActualSize), ICON),
    (Item::Zoom, 40.0),
    (Item::Masks, ICON),
    (Item::Outlines, ICON),
    (Item::Layer, 82.0),
    (Item::Opacity, 60.0),
    (Item::Snap, IN_MENU),
    (Item::Clean(Action::FillHoles), IN_MENU),
    (Item::Clean(Action::RemoveIslands), IN_MENU),
    (Item::CleanSize, IN_MENU),
];

/// Draws the tool row above the image: tools, zoom, layer, mask display, and clean-up in a menu.
///
/// `end` draws the buttons of the pane.
pub(super) fn toolbar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    zoom_percent: f32,
    actions: &mut Vec<Action>,
) -> bool {
    let mut is_dragged = false;
    tool_row(ui, "More image tools", &ITEMS, |ui, slot| match slot {
        Slot::End => {
            is_dragged = pane_buttons_ui(ui, view, Action::ShowImage, actions);
        }
        Slot::Row(Item::Clean(action)) | Slot::Menu(Item::Clean(action)) => {
            let button = IconButton {
                icon: if action == Action::FillHoles {
                    Icon::Holes
                } else {
                    Icon::Specks
                },
                name: &action.text(),
                tip: &view.prefs.shortcuts.tip(ui.ctx(), action),
                selected: None,
                enabled: is_possible(action, session, view),
            };
            if button.show(ui, matches!(slot, Slot::Menu(_))).clicked() {
                actions.push(action);
            }
        }
        Slot::Row(Item::Zoom) | Slot::Menu(Item::Zoom) => {
            let text = egui::RichText::new(format!("{zoom_percent:.0} %")).weak();
            ui.add_sized([38.0, 18.0], egui::Label::new(text))
                .on_hover_text("Zoom: wheel over the image; middle drag or Space+drag moves it");
        }
        Slot::Row(item) => item_ui(ui, view, item, false, actions),
        Slot::Menu(item) => item_ui(ui, view, item, true, actions),
    });
    is_dragged
}

fn item_ui(
    ui: &mut Ui,
    view: &mut ViewState,
    item: Item,
    in_menu: bool,
    actions: &mut Vec<Action>,
) {
    match item {
        Item::Gap if in_menu => drop(ui.separator()),
        Item::Gap => ui.add_space(4.0),
        Item::Tool(tool) => tool_ui(ui, view, tool, in_menu),
        Item::BrushRadius => radius_ui(ui, view),
        Item::View(action) => {
            let (icon, name) = if action == Action::Fit {
                (Icon::Fit, "Fit")
            } else {
                (Icon::ActualSize, "100 %")
            };
            let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
            let button = IconButton {
                icon,
                name,
                tip: &tip,
                selected: None,
                enabled: true,
            };
            if button.show(ui, in_menu).clicked() {
                actions.push(action);
            }
        }
        Item::Layer => layer_ui(ui, view),
        Item::Opacity => opacity_ui(ui, view),
        Item::CleanSize => clean_size_ui(ui, view),
        Item::Snap | Item::Masks | Item::Outlines => switch_ui(ui, view, item, in_menu),
        Item::Zoom | Item::Clean(_) => {}
    }
}

fn tool_ui(ui: &mut Ui, view: &mut ViewState, tool: Tool, in_menu: bool) {
    let icon = match tool {
        Tool::Click => Icon::Arrow,
        Tool::Brush => Icon::Brush,
        Tool::Eraser => Icon::Eraser,
        Tool::Polygon => Icon::Polygon,
        Tool::Border => Icon::Border,
        Tool::Stem => Icon::Stem,
    };
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::UseTool(tool));
    let button = IconButton {
        icon,
        name: tool.text(),
        tip: &format!("{}: {tip}", tool.text()),
        selected: Some(view.tool == tool),
        enabled: true,
    };
    if button.show(ui, in_menu).clicked() {
        view.tool = tool;
        view.draft.drop_half_made();
    }
}

fn radius_ui(ui: &mut Ui, view: &mut ViewState) {
    let brush = matches!(view.tool, Tool::Brush | Tool::Eraser);
    let size = egui::DragValue::new(&mut view.prefs.brush_px)
        .range(0.5..=500.0)
        .speed(0.2)
        .suffix(" px")
        .max_decimals(1);
    let tip = "Radius of the brush (Shift+wheel over the image)";
    ui.spacing_mut().interact_size.x = 54.0;
    ui.add_enabled(brush, size)
        .on_hover_text(tip)
        .on_disabled_hover_text(format!("{tip}; choose the brush or eraser first"))
        .accessible_name("Brush radius");
}

/// Draws a switch of the masks, the outlines or the snapping of the brush.
fn switch_ui(ui: &mut Ui, view: &mut ViewState, item: Item, in_menu: bool) {
    let (icon, name, action) = match item {
        Item::Snap => (Icon::Magnet, "Snap brush to edges", Action::ToggleSnap),
        Item::Masks => (Icon::Eye, "Masks", Action::ToggleMasks),
        _ => (Icon::Outline, "Outlines", Action::ToggleOutlines),
    };
    let is_brush = matches!(view.tool, Tool::Brush | Tool::Eraser);
    let enabled = match item {
        Item::Snap => is_brush,
        Item::Masks => true,
        _ => view.masks_shown,
    };
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let value = match item {
        Item::Snap => &mut view.prefs.snap,
        Item::Masks => &mut view.masks_shown,
        _ => &mut view.prefs.outlines,
    };
    let button = IconButton {
        icon,
        name,
        tip: &format!("{name}: {tip}"),
        selected: Some(*value),
        enabled,
    };
    if button.show(ui, in_menu).clicked() {
        *value = !*value;
    }
}

/// Draws the size limit of the holes and specks that the clean-up removes.
fn clean_size_ui(ui: &mut Ui, view: &mut ViewState) {
    ui.horizontal(|ui| {
        ui.label("Smaller than");
        let size = egui::DragValue::new(&mut view.prefs.tidy_px)
            .range(2..=1_000_000)
            .speed(1.0)
            .suffix(" px");
        ui.add(size)
            .on_hover_text("Fill holes and remove specks smaller than this many pixels")
            .accessible_name("Size of holes and specks");
    });
}

fn opacity_ui(ui: &mut Ui, view: &mut ViewState) {
    let slider = Slider::new(&mut view.prefs.opacity, 0.0..=1.0).show_value(false);
    ui.spacing_mut().slider_width = 56.0;
    ui.add_enabled(view.masks_shown, slider)
        .on_hover_text("Opacity of the masks")
        .accessible_name("Mask opacity");
}

/// Draws the choice of the shown layer.
fn layer_ui(ui: &mut Ui, view: &mut ViewState) {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::NextLayer);
    let choice = ComboBox::from_id_salt("layer")
        .selected_text(view.layer.text())
        .width(78.0)
        .show_ui(ui, |ui| {
            for layer in Layer::ALL {
                ui.selectable_value(&mut view.layer, layer, layer.text());
            }
        });
    choice
        .response
        .on_hover_text(tip)
        .accessible_name("Shown layer");
}
