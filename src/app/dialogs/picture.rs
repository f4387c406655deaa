use egui::{DragValue, Ui};

use super::export::replace_ui;
use super::forms::PictureForm;
use super::picker::{Pick, PickTarget, path_field_ui};
use crate::tips::modal;
use crate::{Panes, ViewState};

/// The dialog that asks for a picture or a turntable film of the 3-D view.
pub(crate) fn picture_ui(ui: &Ui, view: &mut ViewState) {
    let response = modal(ui, "picture", 480.0, |ui| {
        ui.heading("Picture of the 3-D view");
        ui.add_space(8.0);
        let form = &mut view.picture;
        ui.horizontal(|ui| {
            let tip = "A PNG of what the view shows, without cameras, lines and signs";
            let still = ui
                .radio_value(&mut form.is_film, false, "Picture")
                .on_hover_text(tip);
            let film = ui.radio_value(&mut form.is_film, true, "Turntable film");
            let film =
                film.on_hover_text("A film of one turn about the vertical, made with ffmpeg");
            if still.union(film).changed() {
                form.follow_take();
            }
        });
        ui.horizontal(|ui| {
            size_ui(ui, &mut form.size.0, "Width");
            size_ui(ui, &mut form.size.1, "Height");
            ui.label("pixels");
        });
        if form.is_film {
            film_ui(ui, form);
        } else {
            let tip = "Leaves the background out";
            ui.checkbox(&mut form.transparent, "Transparent background")
                .on_hover_text(tip);
        }
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let name = if form.is_film {
                ("Film file", "film.mp4, .mkv or .webm")
            } else {
                ("Picture file", "picture.png")
            };
            path_field_ui(
                ui,
                &mut view.picker,
                name,
                &mut form.path,
                (Pick::Save, PickTarget::Picture),
            );
        });
        replace_ui(ui, &mut view.picture.overwrite);
        ui.add_space(12.0);
        end_ui(ui, view);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

fn size_ui(ui: &mut Ui, side: &mut u32, name: &str) {
    ui.label(name);
    let drag = DragValue::new(side).range(16..=PictureForm::MOST);
    ui.add(drag)
        .on_hover_text("Of the picture, in pixels")
        .accessible_name(format!("Picture {name}"));
}

fn film_ui(ui: &mut Ui, form: &mut PictureForm) {
    ui.horizontal(|ui| {
        ui.label("One turn in");
        let seconds = DragValue::new(&mut form.seconds)
            .range(0.5..=600.0)
            .speed(0.1)
            .suffix(" s");
        ui.add(seconds)
            .on_hover_text("How long the film is")
            .accessible_name("Film seconds");
        ui.label("at");
        let fps = DragValue::new(&mut form.fps)
            .range(1..=120)
            .suffix(" pictures a second");
        ui.add(fps)
            .on_hover_text("Pictures a second")
            .accessible_name("Film rate");
    });
}

fn end_ui(ui: &mut Ui, view: &mut ViewState) {
    let wish = view.picture.wish();
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
        let button = ui.add_enabled(wish.is_some(), egui::Button::new("Write"));
        let missing = "Name a file: a picture ends in .png, a film in .mp4, .mkv or .webm";
        let button = button
            .on_hover_text("Draws what the view shows now")
            .on_disabled_hover_text(missing);
        if button.clicked() {
            view.picture_wish = wish;
            if view.prefs.panes == Panes::Picture {
                view.prefs.panes = Panes::Both;
            }
            view.dialog = None;
        }
        if ui
            .button("Cancel")
            .on_hover_text("Closes the dialog (Esc)")
            .clicked()
        {
            view.dialog = None;
        }
    });
}
