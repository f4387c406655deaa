use egui::containers::menu::{MenuButton, MenuConfig};
use egui::{ComboBox, DragValue, PopupCloseBehavior, Slider, Ui};

use super::ruler::ruler_ui;
use crate::scene_prefs::{ClipSides, Slice};
use crate::session_view::labels_of;
use crate::tooltips::{action_button, together};
use crate::{Action, SessionView, Shown, ViewState};
use ostra_view::{Coloring, Side};

const COLORINGS: [(Coloring, &str, &str); 7] = [
    (Coloring::Rgb, "Colour", "Colour of the images"),
    (Coloring::Label, "Label", "Colour of the labels"),
    (
        Coloring::Confidence,
        "Confidence",
        "Share of the votes that each point's label won",
    ),
    (
        Coloring::Conflict,
        "Conflict",
        "Share of the votes for the strongest other label",
    ),
    (
        Coloring::Views,
        "Views",
        "Number of views that voted on each point",
    ),
    (
        Coloring::Normals,
        "Normals",
        "Direction of the surface: red along x, green along y, blue along z",
    ),
    (Coloring::Height, "Height", "Height of each point"),
];

const MODELS: [(Shown, &str, &str); 4] = [
    (Shown::Points, "Points", "The labelled points"),
    (Shown::Mesh, "Mesh", "Shaded surface"),
    (
        Shown::Wireframe,
        "Wireframe",
        "Edges of the surface's triangles",
    ),
    (Shown::Voxels, "Voxels", "Occupied voxels"),
];

/// Draws the tool bar of the 3-D view: model, colours, point size, frusta and viewpoint.
pub(super) fn scene_bar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    ui.horizontal_wrapped(|ui| {
        if session.has_surface {
            let text = MODELS.iter().find(|(shown, ..)| *shown == view.shown).map_or("Points", |(_, text, _)| text);
            let choice = ComboBox::from_id_salt("model").selected_text(text).width(88.0).show_ui(ui, |ui| {
                for (shown, text, tip) in MODELS {
                    ui.selectable_value(&mut view.shown, shown, text).on_hover_text(tip);
                }
            });
            choice.response.on_hover_text("Model to show").accessible_name("Shown model");
            ui.add_space(8.0);
        }
        coloring_ui(ui, session, view);
        ui.add_space(8.0);
        ui.spacing_mut().slider_width = 70.0;
        let slider = Slider::new(&mut view.prefs.point_size, 1.0..=12.0).show_value(false);
        together(ui, 110.0, |ui| {
            ui.label("Size");
            ui.add(slider).on_hover_text("Size of the points").accessible_name("Point size");
        });
        let has_cameras = session.project.frames.iter().any(|frame| frame.posed_camera().is_some());
        if has_cameras {
            ui.checkbox(&mut view.prefs.frusta, "Cameras")
                .on_hover_text("Show the cameras; click one to go to its frame");
            let tip = "Show the image in front of each camera";
            let images = egui::Checkbox::new(&mut view.prefs.scene.images, "Images");
            ui.add_enabled(view.prefs.frusta, images).on_hover_text(tip);
        }
        if session.sparse.is_some_and(|sparse| !sparse.links.is_empty()) {
            ui.checkbox(&mut view.prefs.links, "Links").on_hover_text(
                "Which frames hold each other: grey one after the other, green where they see the same, orange by their \
                 shape, red where the others contradict it",
            );
        }
        ui.add_space(8.0);
        display_ui(ui, view, actions);
        clip_ui(ui, &mut view.scene.clip);
        let shortcuts = &view.prefs.shortcuts;
        if action_button(ui, shortcuts, Action::FrameCloud, "All", true).clicked() {
            actions.push(Action::FrameCloud);
        }
        if has_cameras && action_button(ui, shortcuts, Action::LookThrough, "Camera view", true).clicked() {
            actions.push(Action::LookThrough);
        }
        if session.votes.is_some() {
            let tip = shortcuts.tip(ui.ctx(), Action::ChoosePoints);
            if ui.selectable_label(view.scene_select.in_hand, "Select").on_hover_text(tip).clicked() {
                actions.push(Action::ChoosePoints);
            }
        }
        if session.points().is_some() {
            ui.toggle_value(&mut view.ruler.in_hand, "Ruler")
                .on_hover_text("Click points to measure distances, lines and angles, and to set the scale by a distance");
        }
        // Controls that appear and disappear come last, so that the others do not move.
        if view.scene.through.is_some() {
            let slider = Slider::new(&mut view.prefs.scene.blend, 0.0..=1.0).show_value(false);
            let tip = "Opacity of the image over the 3-D view; the view follows the current frame";
            together(ui, 130.0, |ui| {
                ui.label("Image");
                ui.add(slider).on_hover_text(tip).accessible_name("Opacity of the image");
            });
        }
        isolated_ui(ui, session, view);
        if session.points().is_some() {
            ruler_ui(ui, session, view, actions);
        }
    });
}

/// Returns the short name of a colouring.
pub(super) fn coloring_text(coloring: Coloring) -> &'static str {
    COLORINGS
        .iter()
        .find(|(known, ..)| *known == coloring)
        .map_or("Colour", |(_, text, _)| text)
}

/// Draws the choice of the colouring and, for labels, of the level in the label tree.
fn coloring_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let choice = ComboBox::from_id_salt("coloring")
        .selected_text(coloring_text(view.coloring))
        .width(92.0)
        .show_ui(ui, |ui| {
            for (coloring, text, tip) in COLORINGS {
                let is_known = !coloring.needs_votes()
                    || (session.votes.is_some() && view.shown == Shown::Points);
                ui.add_enabled_ui(is_known, |ui| {
                    let choice = ui
                        .selectable_value(&mut view.coloring, coloring, text)
                        .on_hover_text(tip);
                    choice.on_disabled_hover_text(
                        "Needs the votes of a cloud that this project fused",
                    );
                });
            }
        });
    choice
        .response
        .on_hover_text("Choose the colours of the points")
        .accessible_name("Colour by");
    let tree = labels_of(session);
    let deepest = tree
        .iter()
        .map(|label| tree.depth(label.id))
        .max()
        .unwrap_or(0);
    if view.coloring != Coloring::Label || deepest < 2 {
        return;
    }
    let name = |level: Option<usize>| {
        level.map_or_else(|| "All levels".into(), |level| format!("Level {level}"))
    };
    let choice = ComboBox::from_id_salt("level")
        .selected_text(name(view.scene.level))
        .width(84.0)
        .show_ui(ui, |ui| {
            for level in std::iter::once(None).chain((1..deepest).map(Some)) {
                ui.selectable_value(&mut view.scene.level, level, name(level));
            }
        });
    let tip =
        "Show deeper labels in the colour of their ancestor at this level; level 1 is the top";
    choice
        .response
        .on_hover_text(tip)
        .accessible_name("Level of labels");
}

/// Shows the isolated label and the vote threshold, with buttons to reset them.
fn isolated_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    if let Some(below) = view.scene.uncertain_below {
        let text = format!("Only below {:.0} %", 100.0 * below);
        let button = ui.button(text).on_hover_text("Show all points again");
        if button.accessible_name("Show all points").clicked() {
            view.scene.uncertain_below = None;
        }
    }
    let Some(label) = view
        .scene
        .isolated
        .and_then(|id| labels_of(session).get(id))
    else {
        return;
    };
    let button = ui
        .button(format!("Only {}", label.name))
        .on_hover_text("Show all labels again");
    if button.accessible_name("Show all labels").clicked() {
        view.scene.isolated = None;
    }
}

/// Names of the two sides of each axis.
const SIDES: [[&str; 2]; 3] = [["Left", "Right"], ["Bottom", "Top"], ["Front", "Back"]];
const AXES: [&str; 3] = ["Left to right", "Bottom to top", "Front to back"];

/// Draws the menu of viewpoints, projection, lighting and background.
fn display_ui(ui: &mut Ui, view: &mut ViewState, actions: &mut Vec<Action>) {
    let menu = staying("Display").ui(ui, |ui| {
        ui.set_min_width(250.0);
        ui.horizontal_wrapped(|ui| {
            for side in Side::ALL {
                let action = Action::LookFrom(side);
                if action_button(ui, &view.prefs.shortcuts, action, side_text(side), true).clicked() {
                    actions.push(action);
                }
            }
        });
        let scene = &mut view.prefs.scene;
        ui.checkbox(&mut scene.orthographic, "Orthographic").on_hover_text("Use an orthographic projection");
        ui.checkbox(&mut view.scene.turning, "Turntable")
            .on_hover_text("Rotate the view about the vertical axis until you click or drag in it");
        ui.separator();
        ui.checkbox(&mut scene.edl, "Eye-dome lighting")
            .on_hover_text("Shade points that lie behind their neighbours");
        let strength = Slider::new(&mut scene.edl_strength, 0.1..=4.0).logarithmic(true).show_value(false);
        ui.add_enabled_ui(scene.edl, |ui| {
            ui.horizontal(|ui| {
                ui.label("Strength");
                ui.add(strength).on_hover_text("Strength of the lighting").accessible_name("Lighting strength");
            });
        });
        background_ui(ui, &mut scene.background);
        ui.checkbox(&mut scene.scale_bar, "Scale bar")
            .on_hover_text("Show a scale bar for the depth at the centre");
        ui.checkbox(&mut scene.axes, "Axes").on_hover_text("Show the directions of the world axes");
        ui.horizontal(|ui| {
            ui.label("Cameras");
            let frustum = Slider::new(&mut scene.frustum, 0.02..=0.5).logarithmic(true).show_value(false);
            let tip = "Size of cameras and their images";
            ui.add_enabled(view.prefs.frusta, frustum).on_hover_text(tip).accessible_name("Size of cameras");
        });
        ui.horizontal(|ui| {
            ui.label("Others");
            let faint = Slider::new(&mut scene.faint, 0.0..=1.0).show_value(false);
            let tip = "Opacity of the other points while a label is isolated (Alt+click) or uncertain points are shown";
            ui.add(faint).on_hover_text(tip).accessible_name("Opacity of others");
        });
        uncertain_ui(ui, &mut view.scene.uncertain_below);
    });
    menu.0
        .on_hover_text("Lighting, projection, background and view direction");
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

/// Draws the menu of the clipping box and slice; nothing outside them is drawn or picked.
fn clip_ui(ui: &mut Ui, clip: &mut ClipSides) {
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
    });
    menu.0
        .on_hover_text("Hide the points outside a box or slice")
        .accessible_name("Clip");
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

/// Returns a menu that stays open while its contents are changed.
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
