//! Contents of the menus Display and Clip of the 3-D view.

use egui::{ComboBox, DragValue, Slider, Ui};

use crate::scene_prefs::{ClipSides, Slice};
use crate::tooltips::{action_button, add_explained};
use crate::{Action, ViewState};
use ostra_view::Side;

/// Names of the two sides of each axis.
const SIDES: [[&str; 2]; 3] = [["Left", "Right"], ["Bottom", "Top"], ["Front", "Back"]];
const AXES: [&str; 3] = ["Left to right", "Bottom to top", "Front to back"];

/// Draws viewpoints, projection, lighting and background.
pub(super) fn display_ui(ui: &mut Ui, view: &mut ViewState, actions: &mut Vec<Action>) {
    ui.set_min_width(250.0);
    ui.horizontal_wrapped(|ui| {
        for side in Side::ALL {
            let action = Action::LookFrom(side);
            if action_button(ui, &view.prefs.shortcuts, action, side_text(side), None).clicked() {
                actions.push(action);
            }
        }
    });
    let scene = &mut view.prefs.scene;
    ui.checkbox(&mut scene.orthographic, "Orthographic")
        .on_hover_text("Use an orthographic projection");
    ui.checkbox(&mut view.scene.turning, "Turntable")
        .on_hover_text("Rotate the view about the vertical axis until you click or drag in it");
    ui.separator();
    ui.checkbox(&mut scene.edl, "Eye-dome lighting")
        .on_hover_text("Shade points that lie behind their neighbours");
    let strength = Slider::new(&mut scene.edl_strength, 0.1..=4.0)
        .logarithmic(true)
        .show_value(false);
    ui.horizontal(|ui| {
        ui.label("Strength");
        let reason = (!scene.edl).then_some("Switch on eye-dome lighting first");
        add_explained(ui, strength, "Strength of the lighting", reason)
            .accessible_name("Lighting strength");
    });
    background_ui(ui, &mut scene.background);
    ui.checkbox(&mut scene.scale_bar, "Scale bar")
        .on_hover_text("Show a scale bar for the depth at the centre");
    ui.checkbox(&mut scene.axes, "Axes")
        .on_hover_text("Show the directions of the world axes");
    ui.checkbox(&mut scene.frame_points, "Points of the frame")
        .on_hover_text("Show the depth of the shown frame over the fused cloud");
    ui.horizontal(|ui| {
        ui.label("Cameras");
        let frustum = Slider::new(&mut scene.frustum, 0.02..=0.5)
            .logarithmic(true)
            .show_value(false);
        let tip = "Size of cameras and their images";
        let reason = (!view.prefs.frusta).then_some("Show the cameras first");
        add_explained(ui, frustum, tip, reason).accessible_name("Size of cameras");
    });
    ui.horizontal(|ui| {
            ui.label("Others");
            let faint = Slider::new(&mut scene.faint, 0.0..=1.0).show_value(false);
            let tip = "Opacity of the other points while a label is isolated (Alt+click) or uncertain points are shown";
            ui.add(faint).on_hover_text(tip).accessible_name("Opacity of others");
        });
    uncertain_ui(ui, &mut view.scene.uncertain_below);
    least_views_ui(ui, &mut view.scene.least_views);
}

/// Largest number of views that the slider sets.
const MOST_VIEWS: u32 = 10;

fn least_views_ui(ui: &mut Ui, least: &mut u32) {
    ui.horizontal(|ui| {
        ui.label("Least views");
        let mut shown = (*least).max(1);
        let slider = ui
            .add(Slider::new(&mut shown, 1..=MOST_VIEWS).show_value(false))
            .on_hover_text("Hide points of a fused cloud that fewer views voted on")
            .accessible_name("Number of views");
        ui.weak(shown.to_string());
        if slider.changed() {
            *least = shown;
        }
    });
}

/// Initial vote share below which points count as uncertain.
const UNCERTAIN: f32 = 0.7;

fn uncertain_ui(ui: &mut Ui, below: &mut Option<f32>) {
    ui.horizontal(|ui| {
        let mut on = below.is_some();
        let tip = "Highlight points whose label won less than this share of the votes";
        if ui
            .checkbox(&mut on, "Uncertain points only")
            .on_hover_text(tip)
            .changed()
        {
            *below = on.then_some(UNCERTAIN);
        }
        if let Some(below) = below {
            let mut percent = *below * 100.0;
            let share = DragValue::new(&mut percent)
                .range(1.0..=100.0)
                .speed(0.5)
                .suffix(" %")
                .max_decimals(0);
            if ui
                .add(share)
                .on_hover_text(tip)
                .accessible_name("Uncertain below")
                .changed()
            {
                *below = percent / 100.0;
            }
        }
    });
}

fn background_ui(ui: &mut Ui, background: &mut Option<[u8; 3]>) {
    ui.horizontal(|ui| {
        let mut own = background.is_some();
        if ui
            .checkbox(&mut own, "Custom background")
            .on_hover_text("Use this colour instead of the theme's")
            .changed()
        {
            *background = own.then_some([255; 3]);
        }
        if let Some(color) = background {
            ui.color_edit_button_srgb(color)
                .on_hover_text("Change the colour")
                .accessible_name("Background colour");
        }
    });
}

/// Draws the clipping box and slice; nothing outside them is drawn or picked.
pub(super) fn clip_ui(ui: &mut Ui, clip: &mut ClipSides) {
    ui.set_min_width(250.0);
    egui::Grid::new("clip sides").num_columns(2).show(ui, |ui| {
        for (sides, names) in clip.sides.iter_mut().zip(SIDES) {
            let [low, high] = sides;
            share_ui(ui, low, names[0], "Move this side of the box inwards");
            share_ui(ui, high, names[1], "Move this side of the box inwards");
            (*low, *high) = (low.min(*high - 0.001), high.max(*low + 0.001));
        }
    });
    ui.separator();
    slice_ui(ui, &mut clip.slice);
    ui.separator();
    if ui
        .button("Show everything")
        .on_hover_text("Remove box and slice")
        .clicked()
    {
        *clip = ClipSides::default();
    }
}

fn slice_ui(ui: &mut Ui, slice: &mut Option<Slice>) {
    let mut on = slice.is_some();
    if ui
        .checkbox(&mut on, "Slice")
        .on_hover_text("Show only points near a plane")
        .changed()
    {
        *slice = on.then(Slice::default);
    }
    let Some(slice) = slice else { return };
    let choice = ComboBox::from_id_salt("slice axis")
        .selected_text(AXES[slice.axis])
        .show_ui(ui, |ui| {
            for (axis, text) in AXES.into_iter().enumerate() {
                ui.selectable_value(&mut slice.axis, axis, text);
            }
        });
    choice
        .response
        .on_hover_text("Axis of the slice")
        .accessible_name("Slice axis");
    egui::Grid::new("slice").num_columns(2).show(ui, |ui| {
        share_ui(ui, &mut slice.at, "Position", "Position of the slice");
        share_ui(
            ui,
            &mut slice.thickness,
            "Thickness",
            "Thickness of the slice",
        );
    });
    slice.thickness = slice.thickness.max(0.002);
}

fn share_ui(ui: &mut Ui, share: &mut f32, name: &str, tip: &str) {
    ui.label(name);
    ui.add(Slider::new(share, 0.0..=1.0).show_value(false))
        .on_hover_text(tip)
        .accessible_name(format!("Clip {name}"));
    ui.end_row();
}

fn side_text(side: Side) -> &'static str {
    match side {
        Side::Front => "Front",
        Side::Back => "Back",
        Side::Left => "Left",
        Side::Right => "Right",
        Side::Top => "Top",
        Side::Bottom => "Bottom",
    }
}
