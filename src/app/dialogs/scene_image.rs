use egui::{DragValue, Ui};

use super::export::replace_ui;
use super::forms::ImageForm;
use super::picker::{FileKind, PathField, Pick, PickTarget, path_field_ui};
use crate::tooltips::{add_explained, modal};
use crate::{Panes, ViewState};

/// Draws the dialog that saves the 3-D view as an image or a turntable video.
pub(crate) fn image_ui(ui: &Ui, view: &mut ViewState) {
    let response = modal(ui, "picture", 480.0, |ui| {
        ui.heading("Save 3-D view");
        ui.add_space(8.0);
        let form = &mut view.image;
        ui.horizontal(|ui| {
            let tip = "PNG of the view without cameras, lines and labels";
            let still = ui
                .radio_value(&mut form.is_video, false, "Image")
                .on_hover_text(tip);
            let video = ui.radio_value(&mut form.is_video, true, "Turntable video");
            let video =
                video.on_hover_text("Video of one turn about the vertical axis (needs ffmpeg)");
            if still.union(video).changed() {
                form.follow_take();
            }
        });
        ui.horizontal(|ui| {
            size_ui(ui, &mut form.size.0, "Width");
            size_ui(ui, &mut form.size.1, "Height");
            ui.label("pixels");
        });
        if form.is_video {
            video_ui(ui, form);
        } else {
            let tip = "Make the background transparent";
            ui.checkbox(&mut form.transparent, "Transparent background")
                .on_hover_text(tip);
        }
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let (name, hint, kind) = if form.is_video {
                let hint = "turntable.mp4, .mkv or .webm";
                ("Video file", hint, FileKind::VIDEO)
            } else {
                ("Image file", "view.png", FileKind::IMAGE)
            };
            let field = PathField {
                name,
                hint,
                pick: Pick::Save(kind),
                target: PickTarget::Image,
            };
            path_field_ui(ui, &mut view.picker, &field, &mut form.path);
        });
        replace_ui(ui, &mut view.image.overwrite);
        ui.add_space(12.0);
        end_ui(ui, view);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

fn size_ui(ui: &mut Ui, side: &mut u32, name: &str) {
    ui.label(name);
    let drag = DragValue::new(side).range(16..=ImageForm::MOST);
    ui.add(drag)
        .on_hover_text("In pixels")
        .accessible_name(format!("Image {name}"));
}

fn video_ui(ui: &mut Ui, form: &mut ImageForm) {
    ui.horizontal(|ui| {
        ui.label("Duration");
        let seconds = DragValue::new(&mut form.seconds)
            .range(0.5..=600.0)
            .speed(0.1)
            .suffix(" s");
        ui.add(seconds)
            .on_hover_text("Duration of the video in seconds")
            .accessible_name("Video duration");
        ui.label("at");
        let fps = DragValue::new(&mut form.fps)
            .range(1..=120)
            .suffix(" frames per second");
        ui.add(fps)
            .on_hover_text("Frames per second of the video")
            .accessible_name("Video frame rate");
    });
}

fn end_ui(ui: &mut Ui, view: &mut ViewState) {
    let request = view.image.request();
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
        let missing = "Enter a file name: .png for an image; .mp4, .mkv or .webm for a video";
        let reason = request.is_none().then_some(missing);
        let button = egui::Button::new("Save");
        if add_explained(ui, button, "Save the current view", reason).clicked() {
            view.screenshot_request = request;
            if view.prefs.panes == Panes::Image {
                view.prefs.panes = Panes::Both;
            }
            view.dialog = None;
        }
        if ui
            .button("Cancel")
            .on_hover_text("Close the dialog (Esc)")
            .clicked()
        {
            view.dialog = None;
        }
    });
}
