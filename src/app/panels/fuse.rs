use egui::{DragValue, Ui};

use super::jobs::{progress_text, run_button_ui};
use crate::dialogs::{Pick, PickTarget, path_field_ui};
use crate::tips::field;
use crate::{Action, Look, ViewState};

/// Settings and button for the labelled cloud.
pub(crate) fn fuse_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    wishes: &mut Vec<Action>,
) {
    egui::Grid::new("fuse")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(
                ui,
                "Voxel size",
                "Points closer than this become one; in world units (metres)",
                |ui| voxel_ui(ui, view),
            );
            field(
                ui,
                "Least confidence",
                "Points whose label won a smaller share of the votes are dropped",
                |ui| {
                    let mut percent = view.fuse.min_confidence.unwrap_or(0.0) * 100.0;
                    let drag = DragValue::new(&mut percent)
                        .range(0.0..=100.0)
                        .speed(0.5)
                        .suffix(" %")
                        .max_decimals(0);
                    if ui.add(drag).changed() {
                        view.fuse.min_confidence = (percent > 0.0).then_some(percent / 100.0);
                    }
                },
            );
        });
    let tip = "Leaves out points that no mask names";
    ui.checkbox(&mut view.fuse.drop_unlabelled, "Drop unlabelled points")
        .on_hover_text(tip);
    let onto =
        egui::CollapsingHeader::new("Onto a given cloud").default_open(!view.onto_text.is_empty());
    onto.show(ui, |ui| {
        ui.horizontal(|ui| {
            let (name, target) = (
                ("Cloud to vote on", "labelled PLY, or empty"),
                (Pick::File, PickTarget::Onto),
            );
            path_field_ui(ui, &mut view.picker, name, &mut view.onto_text, target);
        });
    });
    let ready = look
        .project
        .frames
        .iter()
        .any(|frame| frame.posed_camera().is_some());
    ui.horizontal(|ui| {
        run_button_ui(ui, look, view, (Action::Fuse, "Fuse"), ready, wishes);
        if let Some(job) = look.running("Fuse") {
            ui.weak(progress_text(job));
            return;
        }
        let text = match look.cloud {
            Some(cloud) => format!("{} points", grouped(cloud.len())),
            None if ready => "No cloud yet".into(),
            None => "Reconstruct first".into(),
        };
        ui.weak(text);
    });
}

fn voxel_ui(ui: &mut Ui, view: &mut ViewState) {
    let mut chosen = view.fuse.voxel.is_none();
    if ui
        .checkbox(&mut chosen, "Automatic")
        .on_hover_text("Chosen from the data")
        .changed()
    {
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

/// A number with thin gaps between thousands.
pub(super) fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn thousands_are_apart() {
        assert_eq!(super::grouped(5_000_123), "5 000 123");
        assert_eq!(super::grouped(12), "12");
    }
}
