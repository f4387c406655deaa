use std::path::{Path, PathBuf};

use egui::{DragValue, Ui};

use super::export::replace_ui;
use super::picker::{Pick, PickTarget, path_field_ui};
use crate::tips::modal;
use crate::view_state::typed_path;
use crate::{Panes, ViewState};

/// The dialog for a picture of the 3-D view as filled in so far.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureForm {
    pub(super) path: String,
    size: (u32, u32),
    transparent: bool,
    overwrite: bool,
    is_film: bool,
    seconds: f32,
    fps: u32,
}

impl Default for PictureForm {
    fn default() -> Self {
        let size = (1920, 1080);
        Self {
            path: String::new(),
            size,
            transparent: false,
            overwrite: false,
            is_film: false,
            seconds: 12.0,
            fps: 30,
        }
    }
}

/// A picture of what the 3-D view shows, and where to.
#[derive(Debug, Clone, PartialEq)]
pub struct PictureWish {
    /// The file.
    pub path: PathBuf,
    /// Columns and rows.
    pub size: (u32, u32),
    /// Whether a picture written before may be replaced though it was changed since.
    pub overwrite: bool,
    /// A still or a film.
    pub take: Take,
}

/// What is made of the view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Take {
    /// A PNG; without its background where that is transparent.
    Still {
        /// Whether the background is left out.
        transparent: bool,
    },
    /// A film of one turn about the vertical.
    Turntable {
        /// Number of pictures, at least 1.
        count: usize,
        /// Pictures a second.
        fps: u32,
    },
}

impl PictureForm {
    /// The largest side, pixels.
    const MOST: u32 = 8192;

    /// Gives a name with the ending of a film that of a picture, and the other way round, as is written now.
    fn follow_take(&mut self) {
        let path = Path::new(self.path.trim_end());
        let Some(ending) = path
            .extension()
            .map(|ending| ending.to_string_lossy().to_lowercase())
        else {
            return;
        };
        let other = match self.is_film {
            true => (ending == "png").then_some("mp4"),
            false => ["mp4", "mkv", "webm"]
                .contains(&ending.as_str())
                .then_some("png"),
        };
        if let Some(other) = other {
            self.path = path.with_extension(other).to_string_lossy().into_owned();
        }
    }

    /// What is asked for; a name without an ending gets one. `None` without a name, or where a picture's is not that of a PNG.
    fn wish(&self) -> Option<PictureWish> {
        let mut path = typed_path(&self.path)?;
        if path.extension().is_none() {
            path.set_extension(if self.is_film { "mp4" } else { "png" });
        }
        let is_png = |path: &Path| {
            path.extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
        };
        let count = (self.seconds * self.fps as f32).round().max(1.0) as usize;
        let take = match self.is_film {
            true => Take::Turntable {
                count,
                fps: self.fps,
            },
            false => Take::Still {
                transparent: self.transparent,
            },
        };
        (self.is_film != is_png(&path)).then_some(PictureWish {
            path,
            size: self.size,
            overwrite: self.overwrite,
            take,
        })
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_get_the_ending_of_what_is_written_and_others_are_refused() {
        let mut form = PictureForm {
            path: " /out/plant ".into(),
            transparent: true,
            ..PictureForm::default()
        };
        let wish = form.wish().unwrap();
        assert_eq!(
            (wish.path, wish.take),
            ("/out/plant.png".into(), Take::Still { transparent: true })
        );
        form.path = "/out/plant.jpg".into();
        assert_eq!(form.wish(), None);
        (form.is_film, form.seconds, form.fps) = (true, 2.0, 25);
        form.path = "/out/plant".into();
        let wish = form.wish().unwrap();
        assert_eq!(
            (wish.path, wish.take),
            (
                "/out/plant.mp4".into(),
                Take::Turntable { count: 50, fps: 25 }
            )
        );
        form.path = "/out/plant.png".into();
        assert_eq!(form.wish(), None);
        form.path = "  ".into();
        assert_eq!(form.wish(), None);
    }
}
