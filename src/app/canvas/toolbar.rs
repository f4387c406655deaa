use egui::{Checkbox, ComboBox, Slider, TextWrapMode, Ui};

use super::draft::Tool;
use crate::menu::is_possible;
use crate::tooltips::{action_button, together};
use crate::{Action, SessionView, ViewState};
use ostra_view::Layer;

/// Draws the tool bar above the image: tools, clean-up, zoom, layer and mask display.
pub(super) fn toolbar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    zoom_percent: f32,
    actions: &mut Vec<Action>,
) {
    ui.horizontal_wrapped(|ui| {
        tools_ui(ui, view);
        ui.add_space(8.0);
        clean_ui(ui, session, view, actions);
        ui.add_space(8.0);
        zoom_ui(ui, view, zoom_percent, actions);
        ui.add_space(8.0);
        layer_ui(ui, view);
        mask_appearance_ui(ui, view);
    });
}

fn tools_ui(ui: &mut Ui, view: &mut ViewState) {
    for tool in Tool::ALL {
        let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::UseTool(tool));
        if ui
            .add(
                egui::Button::selectable(view.tool == tool, tool.text())
                    .wrap_mode(TextWrapMode::Extend),
            )
            .on_hover_text(tip)
            .clicked()
        {
            view.tool = tool;
            view.draft.drop_half_made();
        }
    }
    let brush = matches!(view.tool, Tool::Brush | Tool::Eraser);
    let size = egui::DragValue::new(&mut view.prefs.brush_px)
        .range(0.5..=500.0)
        .speed(0.2)
        .suffix(" px")
        .max_decimals(1);
    let tip = "Radius of the brush (Shift+wheel over the image)";
    ui.add_enabled(brush, size)
        .on_hover_text(tip)
        .on_disabled_hover_text(tip)
        .accessible_name("Brush radius");
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::ToggleSnap);
    let snap = Checkbox::new(&mut view.prefs.snap, "Snap");
    ui.add_enabled(brush, snap)
        .on_hover_text(&tip)
        .on_disabled_hover_text(tip)
        .accessible_name("Snap brush to edges");
}

/// Draws the buttons that fill holes and remove specks, with their size limit.
fn clean_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    for (action, text) in [
        (Action::FillHoles, "Fill holes"),
        (Action::RemoveIslands, "Remove specks"),
    ] {
        let button = action_button(
            ui,
            &view.prefs.shortcuts,
            action,
            text,
            is_possible(action, session, view),
        );
        if button.accessible_name(action.text()).clicked() {
            actions.push(action);
        }
    }
    let size = egui::DragValue::new(&mut view.prefs.tidy_px)
        .range(2..=1_000_000)
        .speed(1.0)
        .prefix("< ")
        .suffix(" px");
    ui.add(size)
        .on_hover_text("Fill holes and remove specks smaller than this many pixels")
        .accessible_name("Size of holes and specks");
}

fn zoom_ui(ui: &mut Ui, view: &ViewState, zoom_percent: f32, actions: &mut Vec<Action>) {
    for (action, text) in [(Action::Fit, "Fit"), (Action::ActualSize, "100 %")] {
        if action_button(ui, &view.prefs.shortcuts, action, text, true).clicked() {
            actions.push(action);
        }
    }
    let text = egui::RichText::new(format!("{zoom_percent:.0} %")).weak();
    ui.add_sized([44.0, 18.0], egui::Label::new(text))
        .on_hover_text("Zoom: wheel over the image; middle drag or Space+drag moves it");
}

fn mask_appearance_ui(ui: &mut Ui, view: &mut ViewState) {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::ToggleMasks);
    together(ui, 150.0, |ui| {
        ui.checkbox(&mut view.masks_shown, "Masks")
            .on_hover_text(tip);
        let slider = Slider::new(&mut view.prefs.opacity, 0.0..=1.0).show_value(false);
        ui.spacing_mut().slider_width = 70.0;
        ui.add_enabled(view.masks_shown, slider)
            .on_hover_text("Opacity of the masks")
            .accessible_name("Mask opacity");
    });
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::ToggleOutlines);
    ui.add_enabled(
        view.masks_shown,
        Checkbox::new(&mut view.prefs.outlines, "Outlines"),
    )
    .on_hover_text(tip);
}

/// Draws the choice of the shown layer.
fn layer_ui(ui: &mut Ui, view: &mut ViewState) {
    let tip = view.prefs.shortcuts.tip(ui.ctx(), Action::NextLayer);
    let choice = ComboBox::from_id_salt("layer")
        .selected_text(view.layer.text())
        .width(92.0)
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
