use egui::{DragValue, RichText, Ui};
use ostra_session::JobTask;

use super::jobs::{RunButton, progress_text, run_button_ui};
use crate::dialogs::{FileKind, PathField, Pick, PickTarget, path_field_ui};
use crate::tooltips::{add_explained, automatic_ui, field, grouped, section_heading};
use crate::{Action, SessionView, ViewState};
use ostra_project::ResultKind;
use ostra_session::Command;

/// Draws the button of fusion and its voxel size.
pub(super) fn fuse_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let ready = session
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    let button = RunButton {
        action: Action::Fuse,
        task: &JobTask::Fuse,
    };
    run_button_ui(ui, session, view, &button, actions);
    let text = match (session.running(&JobTask::Fuse), session.cloud) {
        (Some(job), _) => progress_text(job),
        (None, Some(cloud)) => format!("{} points", grouped(cloud.len())),
        (None, None) if ready => "No cloud yet".into(),
        (None, None) => "Reconstruct first".into(),
    };
    ui.weak(text);
    egui::Grid::new("fuse")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(
                ui,
                "Voxel size",
                "Edge of the voxels in which points are merged, in metres if the scale is known",
                |ui| voxel_ui(ui, view),
            );
        });
}

/// Draws the settings of fusion that few people need.
pub(super) fn fuse_advanced_ui(ui: &mut Ui, view: &mut ViewState) {
    let tip = "Remove labels that won a smaller share of the votes";
    ui.horizontal(|ui| {
        ui.label("Minimum confidence").on_hover_text(tip);
        let mut percent = view.fuse.min_confidence.unwrap_or(0.0) * 100.0;
        let drag = DragValue::new(&mut percent)
            .range(0.0..=100.0)
            .speed(0.5)
            .suffix(" %")
            .max_decimals(0);
        let drag = ui
            .add(drag)
            .on_hover_text(tip)
            .accessible_name("Minimum confidence");
        if drag.changed() {
            view.fuse.min_confidence = (percent > 0.0).then_some(percent / 100.0);
        }
    });
    let tip = "Leave out points without a label";
    ui.checkbox(&mut view.fuse.drop_unlabelled, "Drop unlabelled points")
        .on_hover_text(tip);
    ui.label("Label an existing point cloud");
    ui.horizontal(|ui| {
        let field = PathField {
            name: "Cloud to label",
            hint: "labelled PLY, or empty",
            pick: Pick::File(FileKind::CLOUD),
            target: PickTarget::Onto,
        };
        path_field_ui(ui, &mut view.picker, &field, &mut view.onto_text);
    });
}

fn voxel_ui(ui: &mut Ui, view: &mut ViewState) {
    let mut chosen = view.fuse.voxel.is_none();
    if automatic_ui(ui, &mut chosen, "Automatic: derived from the data") {
        view.fuse.voxel = (!chosen).then_some(0.005);
    }
    if let Some(voxel) = &mut view.fuse.voxel {
        let speed = (*voxel * 0.02).max(1e-6);
        ui.add(
            DragValue::new(voxel)
                .range(1e-6..=1e6)
                .speed(speed)
                .max_decimals(6),
        );
    }
}

/// Draws the settings of the instance preview, with buttons to create or discard the instances.
pub(crate) fn instances_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let Some(request) = &mut view.instances else {
        return;
    };
    let Some(label) = session.project.labels.get(request.label) else {
        view.instances = None;
        return;
    };
    ui.separator();
    section_heading(ui, &format!("Instances of {}", label.name));
    egui::Grid::new("instances")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            let options = &mut request.options;
            let tip = "Largest gap between connected points, in multiples of the point spacing";
            field(ui, "Reach", tip, |ui| {
                ui.add(
                    DragValue::new(&mut options.radius)
                        .range(1.5..=20.0)
                        .speed(0.05),
                )
                .on_hover_text(tip);
            });
            let tip = "Ignore groups of fewer points";
            field(ui, "Minimum points", tip, |ui| {
                ui.add(DragValue::new(&mut options.min_points).range(1..=1_000_000))
                    .on_hover_text(tip);
            });
        });
    let found = session.proposed.map_or(0, |proposed| proposed.labels.len());
    match session.proposed {
        None => ui.spinner(),
        Some(_) if found == 0 => ui.weak("No connected points of this label."),
        Some(_) => ui.weak(format!("{found} found, shown in 3-D")),
    };
    for (label, points) in session
        .proposed
        .iter()
        .flat_map(|proposed| &proposed.labels)
    {
        ui.horizontal(|ui| {
            let (rect, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
            let [r, g, b] = label.color;
            ui.painter()
                .rect_filled(rect, 3.0, egui::Color32::from_rgb(r, g, b));
            ui.label(&label.name);
            ui.label(RichText::new(grouped(*points)).weak().size(11.0))
                .on_hover_text("Points of this instance");
        });
    }
    let request = *request;
    ui.horizontal(|ui| {
        let tip = "Create a label for each instance in the cloud and in every mask (can be undone)";
        let reason = (found == 0).then_some("No instance was found with these settings");
        let accept = egui::Button::new("Create instances");
        if add_explained(ui, accept, tip, reason).clicked() {
            out.push(Command::Instances(request));
            view.instances = None;
        }
        if ui
            .button("Cancel")
            .on_hover_text("Keep the label unchanged")
            .clicked()
        {
            view.instances = None;
        }
    });
}

/// Draws the project's results, how they were made, and whether they are stale.
pub(super) fn results_ui(ui: &mut Ui, session: &SessionView<'_>) {
    if session.project.results.is_empty() {
        ui.weak("No results yet");
    }
    egui::Grid::new("results")
        .num_columns(3)
        .spacing([10.0, 4.0])
        .show(ui, |ui| {
            for (kind, record) in &session.project.results {
                let name = match kind {
                    ResultKind::Tracking => "Tracking",
                    ResultKind::Cameras => "Cameras",
                    ResultKind::Depths => "Depths",
                    ResultKind::Cloud => "Cloud",
                };
                let tip = format!(
                    "{} frames in {:.1} s\n{}",
                    record.frames, record.seconds, record.settings
                );
                ui.label(name).on_hover_text(&tip);
                ui.weak(record.engine.name()).on_hover_text(tip);
                // Masks say themselves whether they are up to date, as the step Track shows.
                let is_stale = match kind {
                    ResultKind::Tracking => {
                        let mut masks = session.project.masks.values();
                        masks.any(|mask| mask.stale)
                    }
                    _ => record.stale,
                };
                if is_stale {
                    let text = RichText::new("stale").color(ui.visuals().warn_fg_color);
                    ui.label(text).on_hover_text(
                        "Out of date: its inputs have changed since; run it again when needed",
                    );
                }
                ui.end_row();
            }
        });
}
