use egui::{ComboBox, Slider, Ui};

use super::ruler::ruler_ui;
use super::scene_menus::{clip_ui, display_ui};
use crate::icons::{Icon, IconButton};
use crate::pane_buttons::pane_buttons_ui;
use crate::scene_prefs::ClipSides;
use crate::session_view::labels_of;
use crate::tool_row::{ICON, Slot, icon_menu, tool_row};
use crate::tooltips::together;
use crate::{Action, SessionView, Shown, ViewState};
use ostra_view::Coloring;

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

/// SceneTool of the tool row above the 3-D view.
#[derive(Clone, Copy)]
enum SceneTool {
    Gap,
    Model,
    Coloring,
    Level,
    Do(Action),
    Select,
    Ruler,
    Display,
    Clip,
    Cameras,
    Images,
    Links,
    Size,
}

/// Draws the tool row of the 3-D view: model, colours, point size, frusta and viewpoint.
///
/// Returns `true` if the pane is dragged away.
pub(super) fn scene_bar_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) -> bool {
    let mut is_dragged = false;
    let items = items(session, view);
    tool_row(ui, "More 3-D tools", &items, |ui, slot| match slot {
        Slot::End if session.has_frames() => {
            is_dragged = pane_buttons_ui(ui, view, Action::ShowScene, actions);
        }
        Slot::End => {}
        Slot::Row(SceneTool::Coloring) | Slot::Menu(SceneTool::Coloring) => {
            coloring_ui(ui, session, view);
        }
        Slot::Row(SceneTool::Level) | Slot::Menu(SceneTool::Level) => level_ui(ui, session, view),
        Slot::Row(item) => item_ui(ui, view, item, false, actions),
        Slot::Menu(item) => item_ui(ui, view, item, true, actions),
    });
    is_dragged
}

fn items(session: &SessionView<'_>, view: &ViewState) -> Vec<(SceneTool, f32)> {
    let has_cameras = session
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    let has_links = session
        .sparse
        .is_some_and(|sparse| !sparse.links.is_empty());
    let has_levels = view.coloring == Coloring::Label && deepest(session) > 1;
    let all = [
        (session.has_surface, SceneTool::Model, 96.0),
        (true, SceneTool::Coloring, 98.0),
        (true, SceneTool::Do(Action::FrameCloud), ICON),
        (has_cameras, SceneTool::Do(Action::LookThrough), ICON),
        (true, SceneTool::Gap, 8.0),
        (session.votes.is_some(), SceneTool::Select, ICON),
        (session.points().is_some(), SceneTool::Ruler, ICON),
        (true, SceneTool::Gap, 8.0),
        (true, SceneTool::Display, ICON + 4.0),
        (true, SceneTool::Clip, ICON + 4.0),
        (has_cameras, SceneTool::Cameras, ICON),
        (has_cameras, SceneTool::Images, ICON),
        (has_links, SceneTool::Links, ICON),
        (true, SceneTool::Size, 66.0),
        (has_levels, SceneTool::Level, 90.0),
    ];
    all.into_iter()
        .filter(|&(is_there, ..)| is_there)
        .map(|(_, item, width)| (item, width))
        .collect()
}

fn item_ui(
    ui: &mut Ui,
    view: &mut ViewState,
    item: SceneTool,
    in_menu: bool,
    actions: &mut Vec<Action>,
) {
    match item {
        SceneTool::Gap if in_menu => drop(ui.separator()),
        SceneTool::Gap => ui.add_space(4.0),
        SceneTool::Model => model_ui(ui, view),
        SceneTool::Do(action) => {
            let (icon, name) = if action == Action::FrameCloud {
                (Icon::Fit, "All")
            } else {
                (Icon::Camera, "Camera view")
            };
            if icon_ui(ui, view, (icon, name), action, in_menu) {
                actions.push(action);
            }
        }
        SceneTool::Select => {
            if icon_ui(
                ui,
                view,
                (Icon::Lasso, "Select"),
                Action::ChoosePoints,
                in_menu,
            ) {
                actions.push(Action::ChoosePoints);
            }
        }
        SceneTool::Display if in_menu => {
            ui.collapsing("Display", |ui| display_ui(ui, view, actions));
        }
        SceneTool::Display => {
            let menu = icon_menu(ui, Icon::Sliders, "Display", |ui| {
                display_ui(ui, view, actions);
            });
            menu.on_hover_text("Lighting, projection, background and view direction");
        }
        SceneTool::Clip if in_menu => {
            ui.collapsing("Clip", |ui| clip_ui(ui, &mut view.scene.clip));
        }
        SceneTool::Clip => {
            let is_on = view.scene.clip != ClipSides::default();
            let menu = icon_menu(ui, Icon::Clip, "Clip", |ui| {
                clip_ui(ui, &mut view.scene.clip);
            });
            if is_on {
                let at = menu.rect.right_top() + egui::vec2(-4.0, 4.0);
                ui.painter()
                    .circle_filled(at, 3.0, ui.visuals().warn_fg_color);
            }
            menu.on_hover_text("Hide the points outside a box or slice");
        }
        SceneTool::Size => {
            ui.spacing_mut().slider_width = 60.0;
            let slider = Slider::new(&mut view.prefs.point_size, 1.0..=12.0).show_value(false);
            ui.add(slider)
                .on_hover_text("Size of the points")
                .accessible_name("Point size");
        }
        SceneTool::Ruler | SceneTool::Cameras | SceneTool::Images | SceneTool::Links => {
            switch_ui(ui, view, item, in_menu);
        }
        SceneTool::Coloring | SceneTool::Level => {}
    }
}

/// Adds the button of an action and returns `true` if it is clicked.
fn icon_ui(
    ui: &mut Ui,
    view: &ViewState,
    (icon, name): (Icon, &str),
    action: Action,
    in_menu: bool,
) -> bool {
    let selected = (action == Action::ChoosePoints).then_some(view.scene_select.in_hand);
    let button = IconButton {
        icon,
        name,
        tip: &view.prefs.shortcuts.tip(ui.ctx(), action),
        selected,
        unavailable: None,
    };
    button.show(ui, in_menu).clicked()
}

fn switch_ui(ui: &mut Ui, view: &mut ViewState, item: SceneTool, in_menu: bool) {
    let has_frusta = view.prefs.frusta;
    let (icon, name, tip, value) = match item {
        SceneTool::Ruler => (
            Icon::Ruler,
            "Ruler",
            "Click points to measure distances, lines and angles, and to set the scale by a distance",
            &mut view.ruler.in_hand,
        ),
        SceneTool::Cameras => (
            Icon::Frustum,
            "Cameras",
            "Show the cameras; click one to go to its frame",
            &mut view.prefs.frusta,
        ),
        SceneTool::Images => (
            Icon::Picture,
            "Images",
            "Show the image in front of each camera",
            &mut view.prefs.scene.images,
        ),
        _ => (
            Icon::Links,
            "Links",
            "Which frames hold each other: grey one after the other, green where they see the same, orange by their \
             shape, red where the others contradict it",
            &mut view.prefs.links,
        ),
    };
    let button = IconButton {
        icon,
        name,
        tip,
        selected: Some(*value),
        unavailable: (!has_frusta && name == "Images").then_some("Show the cameras first"),
    };
    if button.show(ui, in_menu).clicked() {
        *value = !*value;
    }
}

fn model_ui(ui: &mut Ui, view: &mut ViewState) {
    let text = MODELS
        .iter()
        .find(|(shown, ..)| *shown == view.shown)
        .map_or("Points", |(_, text, _)| text);
    let choice = ComboBox::from_id_salt("model")
        .selected_text(text)
        .width(88.0)
        .show_ui(ui, |ui| {
            for (shown, text, tip) in MODELS {
                ui.selectable_value(&mut view.shown, shown, text)
                    .on_hover_text(tip);
            }
        });
    choice
        .response
        .on_hover_text("Model to show")
        .accessible_name("Shown model");
}

/// Draws what belongs to the ruler, the isolated label and the camera view over the 3-D view.
///
/// It lies over the view, which keeps its size.
pub(super) fn scene_context_ui(
    ui: &mut Ui,
    rect: egui::Rect,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let has_ruler = view.ruler.in_hand && session.points().is_some();
    let is_filtered = view.scene.uncertain_below.is_some()
        || view
            .scene
            .isolated
            .is_some_and(|id| labels_of(session).get(id).is_some());
    if !has_ruler && !is_filtered && view.scene.through.is_none() {
        return;
    }
    let builder = egui::UiBuilder::new()
        .max_rect(rect.shrink(8.0))
        .layout(egui::Layout::left_to_right(egui::Align::Min));
    let fill = ui.visuals().window_fill.gamma_multiply(0.92);
    let frame = egui::Frame::new()
        .fill(fill)
        .corner_radius(6)
        .inner_margin(egui::Margin::symmetric(8, 4));
    frame.show(&mut ui.new_child(builder), |ui| {
        ui.spacing_mut().item_spacing = egui::vec2(6.0, 4.0);
        ui.vertical(|ui| {
            if is_filtered || view.scene.through.is_some() {
                ui.horizontal_wrapped(|ui| shown_ui(ui, session, view));
            }
            if has_ruler {
                ruler_ui(ui, session, view, actions);
            }
        });
    });
}

/// Draws the opacity of the image that the view looks through, and what is isolated.
fn shown_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    if view.scene.through.is_some() {
        let slider = Slider::new(&mut view.prefs.scene.blend, 0.0..=1.0).show_value(false);
        let tip = "Opacity of the image over the 3-D view; the view follows the current frame";
        ui.spacing_mut().slider_width = 70.0;
        together(ui, 130.0, |ui| {
            ui.label("Image");
            ui.add(slider)
                .on_hover_text(tip)
                .accessible_name("Opacity of the image");
        });
    }
    isolated_ui(ui, session, view);
}

/// Returns the short name of a colouring.
pub(super) fn coloring_text(coloring: Coloring) -> &'static str {
    COLORINGS
        .iter()
        .find(|(known, ..)| *known == coloring)
        .map_or("Colour", |(_, text, _)| text)
}

/// Draws the choice of the colouring.
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
}

/// Returns the depth of the label tree.
fn deepest(session: &SessionView<'_>) -> usize {
    let tree = labels_of(session);
    tree.iter()
        .map(|label| tree.depth(label.id))
        .max()
        .unwrap_or(0)
}

/// Draws the choice of the level in the label tree.
fn level_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let deepest = deepest(session);
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
