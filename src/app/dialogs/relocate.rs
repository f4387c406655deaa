use std::path::{Path, PathBuf};

use egui::{Grid, Ui};

use super::picker::{Pick, PickTarget, path_field_ui};
use crate::ViewState;
use crate::tips::{field, modal};
use crate::view_state::typed_path;
use ostra_frames::{DepthSource, Frame, PictureSource};
use ostra_session::Command;

/// Where frames were and where they are now.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RelocateForm {
    pub(super) from: String,
    pub(super) to: String,
}

impl RelocateForm {
    /// Begins with the folder that all pictures, films and depths of the project lie in.
    #[must_use]
    pub fn of(frames: &[Frame]) -> Self {
        let common = frames
            .iter()
            .flat_map(folders)
            .reduce(|a, b| shared(&a, &b))
            .unwrap_or_default();
        Self {
            from: common.display().to_string(),
            to: String::new(),
        }
    }

    fn command(&self) -> Option<Command> {
        Some(Command::Relocate {
            from: typed_path(&self.from)?,
            to: typed_path(&self.to)?,
        })
    }
}

fn folders(frame: &Frame) -> impl Iterator<Item = PathBuf> {
    let picture = match &frame.picture {
        PictureSource::File { path, .. } => path.parent(),
        PictureSource::Film { path, .. } => Some(path.as_path()),
    };
    let depth = frame
        .depth
        .as_ref()
        .and_then(DepthSource::sensor_path)
        .and_then(Path::parent);
    picture.into_iter().chain(depth).map(Path::to_owned)
}

/// The part that two paths have in common.
fn shared(a: &Path, b: &Path) -> PathBuf {
    a.components()
        .zip(b.components())
        .take_while(|(a, b)| a == b)
        .map(|(part, _)| part)
        .collect()
}

/// The dialog for frames whose files were moved.
pub(crate) fn relocate_ui(ui: &Ui, view: &mut ViewState, out: &mut Vec<Command>) {
    let response = modal(ui, "relocate", 560.0, |ui| {
        ui.heading("Frames were moved");
        ui.add_space(8.0);
        Grid::new("relocate")
            .num_columns(2)
            .spacing([8.0, 6.0])
            .show(ui, |ui| {
                let form = &mut view.relocate;
                let places = [
                    (
                        "Was",
                        "The folder (or film) that is gone",
                        &mut form.from,
                        PickTarget::MovedFrom,
                    ),
                    (
                        "Is now",
                        "Where the same files lie below now",
                        &mut form.to,
                        PickTarget::MovedTo,
                    ),
                ];
                for (name, tip, text, target) in places {
                    field(ui, name, tip, |ui| {
                        path_field_ui(
                            ui,
                            &mut view.picker,
                            (name, "folder or film"),
                            text,
                            (Pick::Folder, target),
                        );
                    });
                }
            });
        ui.add_space(12.0);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
            let command = view.relocate.command();
            let button = ui.add_enabled(command.is_some(), egui::Button::new("Look there"));
            let button = button.on_hover_text("Points all frames that lay there to the new place");
            if button.on_disabled_hover_text("Name both places").clicked() {
                out.extend(command);
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
    });
    if response.should_close() {
        view.dialog = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn begins_with_the_folder_of_all_files() {
        let frame = |path: &str, depth: Option<&str>| Frame {
            name: path.into(),
            width: 4,
            height: 3,
            picture: PictureSource::File {
                path: path.into(),
                orientation: Default::default(),
            },
            depth: depth.map(|path| DepthSource::Sensor {
                path: path.into(),
                unit: 0.001,
                orientation: Default::default(),
                camera: None,
            }),
            camera: None,
        };
        let frames = [
            frame("/a/b/color/0.png", Some("/a/b/depth/0.png")),
            frame("/a/b/color/more/1.png", None),
        ];
        let mut form = RelocateForm::of(&frames);
        assert_eq!(form.from, "/a/b");
        assert_eq!(form.command(), None);
        form.to = "/c".into();
        assert_eq!(
            form.command(),
            Some(Command::Relocate {
                from: "/a/b".into(),
                to: "/c".into()
            })
        );
    }
}
