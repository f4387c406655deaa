use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{ComboBox, DragValue, PopupCloseBehavior, Slider, Ui};

use crate::scene_look::{ClipSides, Slice};
use crate::tips::action_button;
use crate::{Action, ViewState};
use ostra_view::Side;

/// Names of the axes' two sides.
const SIDES: [[&str; 2]; 3] = [["Left", "Right"], ["Bottom", "Top"], ["Front", "Back"]];
const AXES: [&str; 3] = ["Left to right", "Bottom to top", "Front to back"];

/// Light, projection, background, and where to look from.
pub(super) fn display_ui(ui: &mut Ui, view: &mut ViewState, wishes: &mut Vec<Action>) {
    let menu = staying("Display").ui(ui, |ui| {
        ui.set_min_width(250.0);
        ui.horizontal_wrapped(|ui| {
            for side in Side::ALL {
                let action = Action::LookFrom(side);
                if action_button(ui, &view.prefs.shortcuts, action, side_text(side), true).clicked() {
                    wishes.push(action);
                }
            }
        });
        let scene = &mut view.prefs.scene;
        ui.checkbox(&mut scene.orthographic, "Orthographic").on_hover_text("Things do not shrink with distance");
        ui.checkbox(&mut view.scene.turning, "Turntable")
            .on_hover_text("Turns the view about the vertical until you click or turn it yourself");
        ui.separator();
        ui.checkbox(&mut scene.edl, "Eye-dome lighting")
            .on_hover_text("Darkens points by how much farther they lie than those beside them");
        let strength = Slider::new(&mut scene.edl_strength, 0.1..=4.0).logarithmic(true).show_value(false);
        ui.add_enabled_ui(scene.edl, |ui| {
            ui.horizontal(|ui| {
                ui.label("Strength");
                ui.add(strength).on_hover_text("Strength of the lighting").accessible_name("Lighting strength");
            });
        });
        background_ui(ui, &mut scene.background);
        ui.checkbox(&mut scene.scale_bar, "Scale bar")
            .on_hover_text("Draws a length to compare with, at the middle's depth");
        ui.checkbox(&mut scene.axes, "Axes").on_hover_text("Draws which way the world's axes point");
        ui.horizontal(|ui| {
            ui.label("Cameras");
            let frustum = Slider::new(&mut scene.frustum, 0.02..=0.5).logarithmic(true).show_value(false);
            let tip = "How large cameras and their pictures are drawn";
            ui.add_enabled(view.prefs.frusta, frustum).on_hover_text(tip).accessible_name("Size of cameras");
        });
        ui.horizontal(|ui| {
            ui.label("Others");
            let faint = Slider::new(&mut scene.faint, 0.0..=1.0).show_value(false);
            let tip = "Opacity of all but the isolated label (Alt+click a point or a label to isolate it) or the doubtful points";
            ui.add(faint).on_hover_text(tip).accessible_name("Opacity of others");
        });
        doubtful_ui(ui, &mut view.scene.doubtful_below);
    });
    menu.0
        .on_hover_text("Light, projection, background, and where to look from");
}

/// The share of the votes below which a label is doubtful, when first asked for.
const DOUBTFUL: f32 = 0.7;

fn doubtful_ui(ui: &mut Ui, below: &mut Option<f32>) {
    ui.horizontal(|ui| {
        let mut on = below.is_some();
        let tip =
            "Only points stand out that frames do not agree on: whose label won less than this share of the votes";
        if ui.checkbox(&mut on, "Doubtful points only").on_hover_text(tip).changed() {
            *below = on.then_some(DOUBTFUL);
        }
        if let Some(below) = below {
            let mut percent = *below * 100.0;
            let share = DragValue::new(&mut percent).range(1.0..=100.0).speed(0.5).suffix(" %").max_decimals(0);
            if ui.add(share).on_hover_text(tip).accessible_name("Doubtful below").changed() {
                *below = percent / 100.0;
            }
        }
    });
}

fn background_ui(ui: &mut Ui, background: &mut Option<[u8; 3]>) {
    ui.horizontal(|ui| {
        let mut own = background.is_some();
        if ui
            .checkbox(&mut own, "Own background")
            .on_hover_text("A colour in place of the theme's")
            .changed()
        {
            *background = own.then_some([255; 3]);
        }
        if let Some(color) = background {
            ui.color_edit_button_srgb(color)
                .on_hover_text("Changes the colour")
                .accessible_name("Background colour");
        }
    });
}

/// The box outside of which nothing is drawn or picked, and a slice of it.
pub(super) fn clip_ui(ui: &mut Ui, clip: &mut ClipSides) {
    let text = if *clip == ClipSides::default() {
        "Clip"
    } else {
        "Clip (on)"
    };
    let menu = staying(text).ui(ui, |ui| {
        ui.set_min_width(250.0);
        egui::Grid::new("clip sides").num_columns(2).show(ui, |ui| {
            for (sides, names) in clip.sides.iter_mut().zip(SIDES) {
                let [low, high] = sides;
                share_ui(ui, low, names[0], "Moves this side of the box inwards");
                share_ui(ui, high, names[1], "Moves this side of the box inwards");
                (*low, *high) = (low.min(*high - 0.001), high.max(*low + 0.001));
            }
        });
        ui.separator();
        slice_ui(ui, &mut clip.slice);
        ui.separator();
        if ui
            .button("Show everything")
            .on_hover_text("Takes box and slice away")
            .clicked()
        {
            *clip = ClipSides::default();
        }
    });
    menu.0
        .on_hover_text("A box and a slice; what lies outside is neither drawn nor picked")
        .accessible_name("Clip");
}

fn slice_ui(ui: &mut Ui, slice: &mut Option<Slice>) {
    let mut on = slice.is_some();
    if ui
        .checkbox(&mut on, "Slice")
        .on_hover_text("Shows only what lies about a plane")
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
        .on_hover_text("Which way the slice moves")
        .accessible_name("Slice axis");
    egui::Grid::new("slice").num_columns(2).show(ui, |ui| {
        share_ui(ui, &mut slice.at, "Position", "Where the slice is");
        share_ui(
            ui,
            &mut slice.thickness,
            "Thickness",
            "How much of the scene it shows",
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

/// A menu that stays open while things in it are changed.
fn staying(text: &str) -> MenuButton<'_> {
    let config = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    MenuButton::new(text).config(config)
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
