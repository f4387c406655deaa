use egui::{DragValue, TextEdit, Ui};
use ostra_project::{DeviceId, RegistrationId};
use ostra_session::JobTask;

use super::jobs::{RunButton, progress_text, run_button_ui};
use super::track::engine_choice_ui;
use crate::tooltips::{action_button, automatic_ui, field};
use crate::{Action, SessionView, ViewState};
use ostra_project::ReconstructMethod;
use ostra_session::EngineKind;

const METHODS: [(ReconstructMethod, &str, &str); 4] = [
    (
        ReconstructMethod::Auto,
        "Automatic",
        "Choose by the frames; given poses and depth are kept",
    ),
    (
        ReconstructMethod::Rgbd,
        "RGB-D",
        "Register frames that have depth",
    ),
    (
        ReconstructMethod::Mvs,
        "Stereo",
        "Compute depth maps by multi-view stereo",
    ),
    (
        ReconstructMethod::Sfm,
        "Cameras only",
        "Compute cameras by structure from motion",
    ),
];
const DEVICES: [(DeviceId, &str, &str); 3] = [
    (
        DeviceId::Auto,
        "Automatic",
        "Use the graphics card if there is one",
    ),
    (DeviceId::Cpu, "Processor", "Use all processor cores"),
    (DeviceId::Gpu, "Graphics card", "The graphics card"),
];

/// Draws the button of reconstruction and its method.
pub(super) fn reconstruct_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    let button = RunButton {
        action: Action::Reconstruct,
        task: &JobTask::Reconstruct,
    };
    run_button_ui(ui, session, view, &button, actions);
    if let Some(job) = session.running(&JobTask::Reconstruct) {
        ui.weak(progress_text(job));
    } else {
        let frames = &session.project.frames;
        let (cameras, depths) = (
            frames
                .iter()
                .filter(|frame| frame.posed_camera().is_some())
                .count(),
            frames.iter().filter(|frame| frame.depth.is_some()).count(),
        );
        ui.weak(format!("{cameras} cameras, {depths} depth maps"))
            .on_hover_text("Frames with a camera and frames with a depth map");
    }
    egui::Grid::new("reconstruct")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(
                ui,
                "Method",
                "How cameras and depth maps are computed",
                |ui| {
                    method_ui(ui, &mut view.reconstruct.method);
                },
            );
        });
}

/// Draws the settings of reconstruction that few people need.
pub(super) fn reconstruct_advanced_ui(
    ui: &mut Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    actions: &mut Vec<Action>,
) {
    egui::Grid::new("reconstruct details")
        .num_columns(2)
        .spacing([8.0, 6.0])
        .show(ui, |ui| {
            field(ui, "Every Nth frame", "1 uses all frames", |ui| {
                ui.add(
                    DragValue::new(&mut view.reconstruct.every)
                        .range(1..=1000)
                        .speed(0.1),
                );
            });
            field(ui, "Device", "Device for the computation", |ui| {
                device_ui(ui, &mut view.reconstruct.device);
            });
        });
    finding_ui(ui, session, view);
    if session.sparse.is_some() {
        let action = Action::ToggleMatches;
        let text = "Cameras and matches";
        if action_button(ui, &view.prefs.shortcuts, action, text, None).clicked() {
            actions.push(action);
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
        .width((ui.available_width() - 4.0).clamp(60.0, 150.0))
        .show_ui(ui, |ui| {
            for (value, text, tip) in METHODS {
                ui.selectable_value(method, value, text).on_hover_text(tip);
            }
        });
}

fn device_ui(ui: &mut Ui, device: &mut DeviceId) {
    let text = DEVICES
        .iter()
        .find(|row| row.0 == *device)
        .map_or("", |row| row.1);
    egui::ComboBox::from_id_salt("device")
        .selected_text(text)
        .width((ui.available_width() - 4.0).clamp(60.0, 150.0))
        .show_ui(ui, |ui| {
            for (value, text, tip) in DEVICES {
                ui.selectable_value(device, value, text).on_hover_text(tip);
            }
        });
}

/// Selectable image sizes (longest side), in pixels.
const SIDES: std::ops::RangeInclusive<u32> = 256..=8192;

/// Draws the settings of camera estimation: features, matching, image pairs, image size.
fn finding_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState) {
    egui::Grid::new("finding").num_columns(2).spacing([8.0, 6.0]).show(ui, |ui| {
        let request = &mut view.reconstruct;
        field(ui, "Features", "Feature detector", |ui| {
            engine_choice_ui(ui, "features", session.engines_of(EngineKind::Features), &mut request.features);
        });
        field(ui, "Matching", "How features are matched between images", |ui| {
            engine_choice_ui(ui, "matcher", session.engines_of(EngineKind::Matcher), &mut request.matcher);
        });
        field(ui, "Fragments", "How fragments of an RGB-D recording without other links are registered", |ui| {
            registration_ui(ui, &mut request.registration);
        });
        let tip = "Larger images are reduced to this size; automatic is 3200 px for cameras and 1600 px for depth maps";
        field(ui, "Longest side", tip, |ui| side_ui(ui, &mut request.max_side));
        let tip = "Pairs of frames to match in any case, for example 0,12 3,40";
        field(ui, "Pairs", tip, |ui| {
            let text = TextEdit::singleline(&mut view.pairs_text).hint_text("0,12 3,40").desired_width(110.0);
            ui.add(text).on_hover_text(tip).accessible_name("Pairs");
        });
    });
    if let Err(wrong) = pairs_in(&view.pairs_text) {
        ui.colored_label(ui.visuals().error_fg_color, wrong);
    }
    ui.checkbox(&mut view.reconstruct.only_labelled, "Only labelled pixels")
        .on_hover_text("Ignore unlabelled pixels, such as the still background of a turntable");
}

fn registration_ui(ui: &mut Ui, chosen: &mut RegistrationId) {
    const METHODS: [(RegistrationId, &str, &str); 3] = [
        (
            RegistrationId::Auto,
            "Automatic",
            "Try one method after the other",
        ),
        (
            RegistrationId::Fgr,
            "FGR",
            "Fast Global Registration: one robust fit to all matches",
        ),
        (
            RegistrationId::Ransac,
            "RANSAC",
            "RANSAC: the best of many fits to a few matches",
        ),
    ];
    let text = METHODS
        .iter()
        .find(|row| row.0 == *chosen)
        .map_or("", |row| row.1);
    egui::ComboBox::from_id_salt("registration")
        .selected_text(text)
        .width((ui.available_width() - 4.0).clamp(60.0, 150.0))
        .show_ui(ui, |ui| {
            for (value, text, tip) in METHODS {
                ui.selectable_value(chosen, value, text).on_hover_text(tip);
            }
        });
}

fn side_ui(ui: &mut Ui, max_side: &mut Option<u32>) {
    let mut full = max_side.is_none();
    let tip = "Automatic: 3200 px for cameras and 1600 px for depth maps";
    if automatic_ui(ui, &mut full, tip) {
        *max_side = (!full).then_some(1600);
    }
    if let Some(side) = max_side {
        ui.add(DragValue::new(side).range(SIDES).suffix(" px"))
            .accessible_name("Longest side");
    }
}

/// Parses pairs of frames such as `0,12 3,40`, or returns an error message.
pub(crate) fn pairs_in(text: &str) -> Result<Vec<[usize; 2]>, String> {
    let pair = |word: &str| {
        let (first, second) = word.split_once(',')?;
        Some([first.parse().ok()?, second.parse().ok()?])
    };
    let read = |word| {
        pair(word)
            .ok_or_else(|| format!("'{word}' is not a pair of frames; enter for example 0,12 3,40"))
    };
    text.split_whitespace().map(read).collect()
}

#[cfg(test)]
mod tests {
    use super::pairs_in;

    #[test]
    fn pairs_are_parsed_and_the_first_invalid_one_is_reported() {
        assert_eq!(pairs_in(""), Ok(vec![]));
        assert_eq!(pairs_in("0,12  3,40"), Ok(vec![[0, 12], [3, 40]]));
        assert!(pairs_in("0,12 3-40 x").unwrap_err().contains("'3-40'"));
        assert!(pairs_in("0,1x").unwrap_err().contains("'0,1x'"));
    }
}
