use egui::{ComboBox, Slider, Ui};

use super::draft::Tool;
use crate::icons::{Icon, IconButton};
use crate::pane_buttons::pane_buttons_ui;
use crate::tool_row::{ICON, IN_MENU, Slot, icon_menu, tool_row};
use crate::tooltips::add_explained;
use crate::{Action, SessionView, Tone, ViewState};
use ostra_view::Layer;

/// Name of the menu of brightness and contrast.
const TONE: &str = "Brightness and contrast";
const NO_BRUSH: &str = "Choose the brush or the eraser first";
const NO_MASKS: &str = "Show the masks first";

/// ImageTool of the tool row above the image.
#[derive(Clone, Copy)]
enum ImageTool {
    Gap,
    Tool(Tool),
    BrushRadius,
    Snap,
    View(Action),
    Zoom,
    Layer,
    Tone,
    Masks,
    Opacity,
    Outlines,
    Clean(Action),
    CleanSize,
}

const ITEMS: [(ImageTool, f32); 20] = [
    (ImageTool::Tool(Tool::Click), ICON),
    (ImageTool::Tool(Tool::Brush), ICON),
    (ImageTool::Tool(Tool::Eraser), ICON),
    (ImageTool::Tool(Tool::Polygon), ICON),
    (ImageTool::Tool(Tool::Border), ICON),
    (ImageTool::Tool(Tool::Stem), ICON),
    (ImageTool::Gap, 6.0),
    (ImageTool::View(Action::Fit), ICON),
    (ImageTool::View(Action::ActualSize), ICON),
    (ImageTool::Zoom, 40.0),
    (ImageTool::Masks, ICON),
    (ImageTool::Outlines, ICON),
    (ImageTool::Layer, 82.0),
    (ImageTool::Tone, ICON),
    (ImageTool::BrushRadius, 56.0),
    (ImageTool::Opacity, 60.0),
    (ImageTool::Snap, IN_MENU),
    (ImageTool::Clean(Action::FillHoles), IN_MENU),
    (ImageTool::Clean(Action::RemoveIslands), IN_MENU),
    (ImageTool::CleanSize, IN_MENU),
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
        Slot::Row(ImageTool::Clean(action)) | Slot::Menu(ImageTool::Clean(action)) => {
            let button = IconButton {
                icon: if action == Action::FillHoles {
                    Icon::Holes
                } else {
                    Icon::Specks
                },
                name: &action.text(),
                tip: &view.prefs.shortcuts.tip(ui.ctx(), action),
                selected: None,
                unavailable: action.unavailable(session, view),
            };
            if button.show(ui, matches!(slot, Slot::Menu(_))).clicked() {
                actions.push(action);
            }
        }
        Slot::Row(ImageTool::Zoom) | Slot::Menu(ImageTool::Zoom) => {
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
    item: ImageTool,
    in_menu: bool,
    actions: &mut Vec<Action>,
) {
    match item {
        ImageTool::Gap if in_menu => drop(ui.separator()),
        ImageTool::Gap => ui.add_space(4.0),
        ImageTool::Tool(tool) => tool_ui(ui, view, tool, in_menu),
        ImageTool::BrushRadius => radius_ui(ui, view),
        ImageTool::View(action) => {
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
                unavailable: None,
            };
            if button.show(ui, in_menu).clicked() {
                actions.push(action);
            }
        }
        ImageTool::Layer => layer_ui(ui, view),
        ImageTool::Tone => tone_menu_ui(ui, view, in_menu),
        ImageTool::Opacity => opacity_ui(ui, view),
        ImageTool::CleanSize => clean_size_ui(ui, view),
        ImageTool::Snap | ImageTool::Masks | ImageTool::Outlines => {
            switch_ui(ui, view, item, in_menu);
        }
        ImageTool::Zoom | ImageTool::Clean(_) => {}
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
        unavailable: None,
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
    let reason = (!brush).then_some(NO_BRUSH);
    add_explained(ui, size, tip, reason).accessible_name("Brush radius");
}

/// Draws a switch of the masks, the outlines or the snapping of the brush.
fn switch_ui(ui: &mut Ui, view: &mut ViewState, item: ImageTool, in_menu: bool) {
    let (icon, name, action) = match item {
        ImageTool::Snap => (Icon::Magnet, "Snap brush to edges", Action::ToggleSnap),
        ImageTool::Masks => (Icon::Eye, "Masks", Action::ToggleMasks),
        _ => (Icon::Outline, "Outlines", Action::ToggleOutlines),
    };
    let is_brush = matches!(view.tool, Tool::Brush | Tool::Eraser);
    let unavailable = match item {
        ImageTool::Snap => (!is_brush).then_some(NO_BRUSH),
        ImageTool::Masks => None,
        _ => (!view.masks_shown).then_some(NO_MASKS),
    };
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let value = match item {
        ImageTool::Snap => &mut view.prefs.snap,
        ImageTool::Masks => &mut view.masks_shown,
        _ => &mut view.prefs.outlines,
    };
    let button = IconButton {
        icon,
        name,
        tip: &format!("{name}: {tip}"),
        selected: Some(*value),
        unavailable,
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
    let reason = (!view.masks_shown).then_some(NO_MASKS);
    add_explained(ui, slider, "Opacity of the masks", reason).accessible_name("Mask opacity");
}

/// Draws the menu of brightness and contrast, with a dot while they are changed.
fn tone_menu_ui(ui: &mut Ui, view: &mut ViewState, in_menu: bool) {
    if in_menu {
        ui.collapsing(TONE, |ui| tone_ui(ui, view));
        return;
    }
    let is_changed = view.tone != Tone::default();
    let menu = icon_menu(ui, Icon::Contrast, TONE, |ui| tone_ui(ui, view));
    if is_changed {
        let at = menu.rect.right_top() + egui::vec2(-4.0, 4.0);
        ui.painter()
            .circle_filled(at, 3.0, ui.visuals().warn_fg_color);
    }
    menu.on_hover_text("Brightness and contrast of the shown image; files and masks keep theirs");
}

fn tone_ui(ui: &mut Ui, view: &mut ViewState) {
    let other = (view.layer != Layer::Image).then_some("Show the layer Image first");
    let tone = &mut view.tone;
    for (name, value) in [
        ("Brightness", &mut tone.brightness),
        ("Contrast", &mut tone.contrast),
    ] {
        ui.horizontal(|ui| {
            ui.add_sized([70.0, 18.0], egui::Label::new(name));
            let slider = Slider::new(value, -1.0..=1.0).show_value(false);
            let tip = format!("{name} of the shown image");
            add_explained(ui, slider, &tip, other).accessible_name(name);
        });
    }
    let same = (*tone == Tone::default()).then_some("Brightness and contrast are not changed");
    let reset = egui::Button::new("Reset");
    if add_explained(ui, reset, "Show the image as it is", same).clicked() {
        *tone = Tone::default();
    }
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
