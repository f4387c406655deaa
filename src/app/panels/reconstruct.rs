use egui::{DragValue, Ui};

use super::finding::finding_ui;
use super::jobs::{progress_text, run_button_ui};
use crate::tips::{action_button, field};
use crate::{Action, Look, ViewState};
use ostra_project::ReconstructMethod;

const METHODS: [(ReconstructMethod, &str, &str); 4] = [
    (
        ReconstructMethod::Auto,
        "Automatic",
        "What the frames allow: given poses and depths are kept",
    ),
    (
        ReconstructMethod::Rgbd,
        "RGB-D",
        "Registers frames with depth",
    ),
    (
        ReconstructMethod::Mvs,
        "Stereo",
        "Depths by multi-view stereo",
    ),
    (
        ReconstructMethod::Sfm,
        "Cameras only",
        "Cameras by structure from motion",
    ),
];
const DEVICES: [(&str, &str, &str); 3] = [
    (
        "auto",
        "Automatic",
        "The graphics card where there is a real one",
    ),
    ("cpu", "Processor", "All processor cores"),
    ("gpu", "Graphics card", "The graphics card"),
];

/// Settings and button for cameras and depths.
pub(crate) fn reconstruct_ui(
    ui: &mut Ui,
    look: &Look<'_>,
    view: &mut ViewState,
    wishes: &mut Vec<Action>,
) {
    egui::Grid::new("reconstruct")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(ui, "Method", "How cameras and depths are made", |ui| {
                method_ui(ui, &mut view.reconstruct.method)
            });
            field(ui, "Every x-th frame", "1 = all frames take part", |ui| {
                ui.add(
                    DragValue::new(&mut view.reconstruct.every)
                        .range(1..=1000)
                        .speed(0.1),
                );
            });
            field(ui, "Device", "What computes", |ui| {
                device_ui(ui, &mut view.reconstruct.device)
            });
        });
    let more = egui::CollapsingHeader::new("Details").id_salt("details of reconstruct");
    more.show_unindented(ui, |ui| finding_ui(ui, look, view));
    ui.horizontal(|ui| {
        run_button_ui(
            ui,
            look,
            view,
            (Action::Reconstruct, "Reconstruct"),
            look.has_frames(),
            wishes,
        );
        if let Some(job) = look.running("Reconstruct") {
            ui.weak(progress_text(job));
            return;
        }
        let frames = &look.project.frames;
        let (cameras, depths) = (
            frames
                .iter()
                .filter(|frame| frame.posed_camera().is_some())
                .count(),
            frames.iter().filter(|frame| frame.depth.is_some()).count(),
        );
        ui.weak(format!("{cameras} cameras, {depths} depths"))
            .on_hover_text("Of all frames, how many have a camera and a depth map");
    });
    if look.sparse.is_some() {
        let shortcuts = &view.prefs.shortcuts;
        if action_button(
            ui,
            shortcuts,
            Action::ToggleMatches,
            "Cameras and matches",
            true,
        )
        .clicked()
        {
            wishes.push(Action::ToggleMatches);
        }
    }
}

fn method_ui(ui: &mut Ui, method: &mut ReconstructMethod) {
    let text = METHODS
        .iter()
        .find(|row| row.0 == *method)
        .map_or("", |row| row.1);
    egui::ComboBox::from_id_salt("method")
        .selected_text(text)
        .width(150.0)
        .show_ui(ui, |ui| {
            for (value, text, tip) in METHODS {
                ui.selectable_value(method, value, text).on_hover_text(tip);
            }
        });
}

fn device_ui(ui: &mut Ui, device: &mut String) {
    let text = DEVICES
        .iter()
        .find(|row| row.0 == device)
        .map_or(device.as_str(), |row| row.1)
        .to_owned();
    egui::ComboBox::from_id_salt("device")
        .selected_text(text)
        .width(150.0)
        .show_ui(ui, |ui| {
            for (value, text, tip) in DEVICES {
                ui.selectable_value(device, value.to_owned(), text)
                    .on_hover_text(tip);
            }
        });
}
