use egui::{Checkbox, DragValue, Ui};
use ostra_session::JobTask;

use super::jobs::{RunButton, progress_text, run_button_ui};
use crate::option_names::in_window_words;
use crate::tooltips::{add_explained, field};
use crate::{Action, SessionView, ViewState};
use ostra_frames::Frame;
use ostra_masks::Direction;
use ostra_project::{EngineName, MaskOrigin, TrackerId};
use ostra_session::{EngineInfo, EngineKind};

/// Draws the button of tracking, its range, and the button that tracks a label again.
pub(super) fn track_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let keyframes = session
        .project
        .masks
        .values()
        .filter(|mask| mask.origin == MaskOrigin::Keyframe)
        .count();
    let button = RunButton {
        action: Action::Track,
        task: &JobTask::Track,
    };
    run_button_ui(ui, session, view, &button, actions);
    let text = match (session.running(&JobTask::Track), keyframes) {
        (Some(job), _) => progress_text(job),
        (None, 0) => "Click an object first".into(),
        (None, 1) => "1 keyframe".into(),
        (None, n) => format!("{n} keyframes"),
    };
    ui.weak(text).on_hover_text(
        "Keyframes are frames that you clicked, painted or confirmed; tracking does not overwrite them",
    );
    egui::Grid::new("track")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(
                ui,
                "Direction",
                "Direction of propagation from a keyframe",
                |ui| direction_ui(ui, &mut view.track.direction),
            );
            let last = session.project.frames.len().saturating_sub(1);
            field(ui, "From frame", "First frame to track", |ui| {
                bound_ui(ui, &mut view.track.from, 0, last);
            });
            field(ui, "To frame", "Last frame to track (included)", |ui| {
                bound_ui(ui, &mut view.track.to, last, last);
            });
        });
    retrack_ui(ui, session, view, actions);
}

/// Draws the settings of tracking that few people need.
pub(super) fn track_advanced_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    egui::Grid::new("track details").num_columns(2).spacing([8.0, 6.0]).show(ui, |ui| {
        field(ui, "Tracker", "Propagates masks from keyframes to the other frames", |ui| {
            engine_choice_ui(ui, "tracker", session.engines_of(EngineKind::Tracker), &mut view.track.tracker);
        });
        if view.track.tracker.has_image_size() {
            let tip = "Shorter image side for the network; larger values keep thinner structures and take longer";
            field(ui, "Network image size", tip, |ui| short_side_ui(ui, &mut view.track.short_side));
        }
    });
    constrain_ui(ui, session, view);
    pause_ui(ui, &mut view.track.pause_below);
    check_ui(ui, &mut view.prefs.flag_below);
    let tip = "Let re-tracked, interpolated and pasted labels overwrite other labels";
    ui.checkbox(&mut view.track.replace, "Replace other labels")
        .on_hover_text(tip);
}

/// Drops settings of tracking that the chosen tracker or the frames do not allow.
pub(crate) fn keep_track_valid(session: &SessionView<'_>, view: &mut ViewState) {
    if !view.track.tracker.has_image_size() {
        view.track.short_side = None;
    }
    view.track.constrain &= hindrance(session, view).is_none();
}

/// Returns why masks cannot be checked by geometry.
fn hindrance(session: &SessionView<'_>, view: &ViewState) -> Option<&'static str> {
    if view.track.tracker == TrackerId::Geometry {
        Some("The geometry tracker uses depth and cameras anyway")
    } else if session.project.frames.iter().any(Frame::has_posed_depth) {
        None
    } else {
        Some("Needs frames with depth and cameras: add them, or use Reconstruct first")
    }
}

/// Draws the option to check masks by geometry.
///
/// It is disabled for the geometry tracker and for projects without depth maps and cameras.
fn constrain_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    let hindrance = hindrance(session, view);
    let tip = "Compare the masks with keyframes re-projected through depth and cameras: where they disagree, geometry wins, and \
               an object that was swapped, drifted or lost is tracked again from there";
    let checkbox = Checkbox::new(&mut view.track.constrain, "Check by geometry");
    add_explained(ui, checkbox, tip, hindrance);
}

/// Draws the option to pause tracking below a confidence.
fn pause_ui(ui: &mut Ui, pause_below: &mut Option<f32>) {
    ui.horizontal(|ui| {
        let mut on = pause_below.is_some();
        let tip =
            "Pause at the first frame on which the confidence of a label is lower, and show it";
        if ui
            .checkbox(&mut on, "Pause when confidence <")
            .on_hover_text(tip)
            .changed()
        {
            *pause_below = on.then_some(0.4);
        }
        let mut percent = pause_below.unwrap_or(0.4) * 100.0;
        let drag = DragValue::new(&mut percent)
            .range(1.0..=99.0)
            .speed(0.3)
            .max_decimals(0)
            .suffix(" %");
        let reason = (!on).then_some("Tick the box before it first");
        let drag = add_explained(ui, drag, tip, reason).accessible_name("Pause below confidence");
        if drag.changed() {
            *pause_below = Some(percent / 100.0);
        }
    });
}

/// Draws the confidence below which frames are flagged for checking.
fn check_ui(ui: &mut Ui, flag_below: &mut f32) {
    ui.horizontal(|ui| {
        let tip = "Frames on which the tracker's own confidence in a label is lower are listed for checking; it is no measured accuracy";
        ui.label("Flag when confidence <").on_hover_text(tip);
        let mut percent = *flag_below * 100.0;
        let drag = DragValue::new(&mut percent)
            .range(0.0..=100.0)
            .speed(0.3)
            .max_decimals(0)
            .suffix(" %");
        if ui
            .add(drag)
            .on_hover_text(tip)
            .accessible_name("Flag below confidence")
            .changed()
        {
            *flag_below = percent / 100.0;
        }
    });
}

/// Draws the button that tracks one label again after a correction.
fn retrack_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let action = Action::Retrack;
    let tip = view.prefs.shortcuts.tip(ui.ctx(), action);
    let button = egui::Button::new(action.text()).wrap();
    if add_explained(ui, button, &tip, action.unavailable(session, view)).clicked() {
        actions.push(action);
    }
}

fn direction_ui(ui: &mut Ui, direction: &mut Direction) {
    let choices = [
        (Direction::Backward, "Back", "Only to earlier frames"),
        (Direction::Both, "Both", "To earlier and later frames"),
        (Direction::Forward, "Forward", "Only to later frames"),
    ];
    // Three names side by side fit the panel at its least width.
    ui.spacing_mut().button_padding.x = 4.0;
    ui.spacing_mut().item_spacing.x = 2.0;
    for (value, text, tip) in choices {
        ui.selectable_value(direction, value, text)
            .on_hover_text(tip);
    }
}

/// Draws a frame number that stays `None`, the end of the sequence, until it is changed.
fn bound_ui(ui: &mut Ui, bound: &mut Option<usize>, default: usize, last: usize) {
    let mut value = bound.unwrap_or(default);
    let drag = ui.add(DragValue::new(&mut value).range(0..=last).speed(0.2));
    if drag.on_hover_text("Drag or click to change").changed() {
        *bound = (value != default).then_some(value);
    }
    if bound.is_some()
        && ui
            .small_button("Reset")
            .on_hover_text("Reset to the end of the sequence")
            .clicked()
    {
        *bound = None;
    }
}

/// Draws an image size that stays `None`, the network's default, until it is chosen.
fn short_side_ui(ui: &mut Ui, short_side: &mut Option<u32>) {
    let mut own = short_side.is_some();
    if ui
        .checkbox(&mut own, "custom")
        .on_hover_text("Off: use the model's default size")
        .changed()
    {
        *short_side = own.then_some(480);
    }
    if let Some(side) = short_side {
        let drag = DragValue::new(side).range(64..=4096).speed(2).suffix(" px");
        ui.add(drag).accessible_name("Network image size in pixels");
    }
}

/// Draws the choice of the segmenter, with its installation state.
pub(super) fn segmenter_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    egui::Grid::new("segmenter").num_columns(2).show(ui, |ui| {
        field(
            ui,
            "Segmenter",
            "Engine that turns clicks and boxes into masks",
            |ui| {
                engine_choice_ui(
                    ui,
                    "segmenter",
                    session.engines_of(EngineKind::Segmenter),
                    &mut view.segmenter,
                );
            },
        );
    });
}

/// Draws a list of engines.
///
/// Engines that are not installed are shown with what they need, but cannot be selected.
pub(super) fn engine_choice_ui<'a, I: EngineName>(
    ui: &mut Ui,
    salt: &str,
    engines: impl Iterator<Item = &'a EngineInfo>,
    chosen: &mut I,
) {
    let text = if *chosen == I::AUTO {
        "Automatic"
    } else {
        chosen.name()
    };
    egui::ComboBox::from_id_salt(salt)
        .selected_text(text)
        .width((ui.available_width() - 4.0).clamp(60.0, 150.0))
        .show_ui(ui, |ui| {
            for engine in engines {
                let Some(id) = I::from_name(engine.name) else {
                    continue;
                };
                if engine_row_ui(ui, engine, id, *chosen == id) {
                    *chosen = id;
                }
            }
        });
}

fn engine_row_ui<I: EngineName>(ui: &mut Ui, engine: &EngineInfo, id: I, selected: bool) -> bool {
    let text = match (id.name(), engine.installed) {
        _ if id == I::AUTO => "Automatic".into(),
        (name, true) => name.to_owned(),
        (name, false) => format!("{name} (not installed)"),
    };
    let tip = format!("Needs {}", in_window_words(engine.needs));
    let reason = (!engine.installed).then_some("It is not installed; see File › Networks");
    add_explained(ui, egui::Button::selectable(selected, text), &tip, reason).clicked()
}
