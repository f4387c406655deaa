use egui::{ComboBox, Slider, Ui};

use super::ruler::ruler_ui;
use super::scene_display::{clip_ui, display_ui};
use crate::tips::{action_button, together};
use crate::{Action, Look, Shown, ViewState};
use ostra_masks::LabelTree;
use ostra_view::Coloring;

const COLORINGS: [(Coloring, &str, &str); 7] = [
    (
        Coloring::Rgb,
        "Colour",
        "Points in the colour of the pictures",
    ),
    (
        Coloring::Label,
        "Label",
        "Points in the colour of their label",
    ),
    (
        Coloring::Confidence,
        "Confidence",
        "How large a share of the votes each point's label won",
    ),
    (
        Coloring::Conflict,
        "Conflict",
        "How large a share of the votes went to the strongest other label",
    ),
    (
        Coloring::Views,
        "Views",
        "How many views voted on each point",
    ),
    (
        Coloring::Normals,
        "Normals",
        "Which way the surface faces: red along x, green along y, blue along z",
    ),
    (Coloring::Height, "Height", "How high each point lies"),
];

const MODELS: [(Shown, &str, &str); 4] = [
    (Shown::Points, "Points", "The labelled points"),
    (Shown::Mesh, "Mesh", "The surface, lit from where you look"),
    (
        Shown::Wireframe,
        "Wireframe",
        "The sides of the surface's triangles",
    ),
    (Shown::Voxels, "Voxels", "The cubes that hold points"),
];

/// What is shown, what colours show, point size, frusta and where to look from.
pub(super) fn scene_bar_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    wishes: &mut Vec<Action>,
) {
    ui.horizontal_wrapped(|ui| {
        if look.has_surface {
            let text = MODELS.iter().find(|(shown, ..)| *shown == view.shown).map_or("Points", |(_, text, _)| text);
            let choice = ComboBox::from_id_salt("model").selected_text(text).width(88.0).show_ui(ui, |ui| {
                for (shown, text, tip) in MODELS {
                    ui.selectable_value(&mut view.shown, shown, text).on_hover_text(tip);
                }
            });
            choice.response.on_hover_text("What is shown of the result").accessible_name("Shown model");
            ui.add_space(8.0);
        }
        coloring_ui(ui, look, view);
        ui.add_space(8.0);
        ui.spacing_mut().slider_width = 70.0;
        let slider = Slider::new(&mut view.prefs.point_size, 1.0..=12.0).show_value(false);
        together(ui, 110.0, |ui| {
            ui.label("Size");
            ui.add(slider).on_hover_text("Size of the points").accessible_name("Point size");
        });
        let has_cameras = look.project.frames.iter().any(|frame| frame.posed_camera().is_some());
        if has_cameras {
            ui.checkbox(&mut view.prefs.frusta, "Cameras")
                .on_hover_text("Shows the cameras; click one to go to its frame");
            let tip = "Shows each camera's picture where it looks";
            let pictures = egui::Checkbox::new(&mut view.prefs.scene.pictures, "Pictures");
            ui.add_enabled(view.prefs.frusta, pictures).on_hover_text(tip);
        }
        if look.sparse.is_some_and(|sparse| !sparse.links.is_empty()) {
            ui.checkbox(&mut view.prefs.links, "Links").on_hover_text(
                "Which frames hold each other: grey one after the other, green where they see the same, orange by their \
                 shape, red where the others contradict it",
            );
        }
        ui.add_space(8.0);
        display_ui(ui, view, wishes);
        clip_ui(ui, &mut view.scene.clip);
        let shortcuts = &view.prefs.shortcuts;
        if action_button(ui, shortcuts, Action::FrameCloud, "All", true).clicked() {
            wishes.push(Action::FrameCloud);
        }
        if has_cameras && action_button(ui, shortcuts, Action::LookThrough, "Camera view", true).clicked() {
            wishes.push(Action::LookThrough);
        }
        if look.votes.is_some() {
            let tip = shortcuts.tip(ui.ctx(), Action::ChoosePoints);
            if ui.selectable_label(view.scene_select.in_hand, "Select").on_hover_text(tip).clicked() {
                wishes.push(Action::ChoosePoints);
            }
        }
        if look.points().is_some() {
            ui.toggle_value(&mut view.ruler.in_hand, "Ruler")
                .on_hover_text("Click points to measure distances, lines and angles, and to set the scale by a distance");
        }
        // What comes and goes stands last, so that nothing else moves.
        if view.scene.through.is_some() {
            let slider = Slider::new(&mut view.prefs.scene.blend, 0.0..=1.0).show_value(false);
            let tip = "How much of the picture is laid over what its camera sees; the view follows the frame shown";
            together(ui, 130.0, |ui| {
                ui.label("Picture");
                ui.add(slider).on_hover_text(tip).accessible_name("Opacity of the picture");
            });
        }
        isolated_ui(ui, look, view);
        if look.points().is_some() {
            ruler_ui(ui, look, view, wishes);
        }
    });
}

/// What colours show, in a word.
pub(super) fn coloring_text(coloring: Coloring) -> &'static str {
    COLORINGS
        .iter()
        .find(|(known, ..)| *known == coloring)
        .map_or("Colour", |(_, text, _)| text)
}

/// What colours show; of labels, at which level of their tree.
fn coloring_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    let choice = ComboBox::from_id_salt("coloring")
        .selected_text(coloring_text(view.coloring))
        .width(92.0)
        .show_ui(ui, |ui| {
            for (coloring, text, tip) in COLORINGS {
                let is_known = !coloring.needs_votes()
                    || (look.votes.is_some() && view.shown == Shown::Points);
                ui.add_enabled_ui(is_known, |ui| {
                    let choice = ui
                        .selectable_value(&mut view.coloring, coloring, text)
                        .on_hover_text(tip);
                    choice.on_disabled_hover_text(
                        "Known for the points of a cloud that this project voted on",
                    );
                });
            }
        });
    choice
        .response
        .on_hover_text("What colours show")
        .accessible_name("Colour by");
    let tree = labels_of(look);
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
    let tip = "Deeper labels take the colour of what they belong to; level 1 is the top";
    choice
        .response
        .on_hover_text(tip)
        .accessible_name("Level of labels");
}

/// What stands out alone, and the way back.
fn isolated_ui(ui: &mut Ui, look: &Look<'_>, view: &mut ViewState) {
    if let Some(below) = view.scene.doubtful_below {
        let text = format!("Only below {:.0} %", 100.0 * below);
        let button = ui
            .button(text)
            .on_hover_text("Shows the points again on which frames agree");
        if button.accessible_name("Show all points").clicked() {
            view.scene.doubtful_below = None;
        }
    }
    let Some(label) = view.scene.isolated.and_then(|id| labels_of(look).get(id)) else {
        return;
    };
    let button = ui
        .button(format!("Only {}", label.name))
        .on_hover_text("Shows all labels again");
    if button.accessible_name("Show all labels").clicked() {
        view.scene.isolated = None;
    }
}

/// The project's labels, or those of the PLY that is inspected.
pub(super) fn labels_of<'a>(look: &Look<'a>) -> &'a LabelTree {
    match look.cloud {
        Some(cloud) if look.root.is_none() => &cloud.tree,
        _ => &look.project.labels,
    }
}
