use std::path::PathBuf;

use egui::{DragValue, Grid, TextEdit, Ui};

use super::picker::{PathPicker, Pick, PickTarget, path_field_ui};
use super::sources::{SourceForm, sources_ui};
use crate::tips::{field, modal, section_heading};
use crate::view_state::typed_path;
use crate::{Dialog, ViewState};
use ostra_frames::OpenRequest;
use ostra_frames::cameras::{DepthCameraSource, IntrinsicsSource};
use ostra_session::{Command, NewProject};

/// The dialog for a new project (and for more frames) as typed so far.
#[derive(Debug, Clone, PartialEq)]
pub struct NewProjectForm {
    sources: Vec<SourceForm>,
    /// Folder of the new project; beside the frames when empty.
    pub(super) root: String,
    /// Cameras in one of the formats known.
    pub(super) cameras: String,
    intrinsics: String,
    depth_unit: f64,
    depth_intrinsics: String,
    /// Where the depth camera stands.
    pub(super) depth_pose: String,
    every: usize,
    from: Option<usize>,
    to: Option<usize>,
}

impl Default for NewProjectForm {
    fn default() -> Self {
        Self {
            sources: vec![SourceForm::default()],
            root: String::new(),
            cameras: String::new(),
            intrinsics: String::new(),
            depth_unit: 0.001,
            depth_intrinsics: String::new(),
            depth_pose: String::new(),
            every: 1,
            from: None,
            to: None,
        }
    }
}

impl NewProjectForm {
    /// A form with one source filled in.
    #[must_use]
    pub fn with_frames(frames: String) -> Self {
        let mut form = Self::default();
        form.set_frames(0, frames);
        form
    }

    pub(super) fn set_frames(&mut self, index: usize, text: String) {
        if let Some(source) = self.sources.get_mut(index) {
            source.frames = text;
        }
    }

    pub(super) fn set_depth(&mut self, index: usize, text: String) {
        if let Some(source) = self.sources.get_mut(index) {
            source.depth = text;
        }
    }

    /// The folder beside the frames that is taken when none is typed.
    fn suggested_root(&self) -> Option<PathBuf> {
        let frames = typed_path(&self.sources.first()?.frames)?;
        let name = frames.file_stem()?.to_string_lossy().into_owned();
        Some(frames.with_file_name(format!("{name}-ostra")))
    }

    /// The request, or what is still missing.
    ///
    /// # Errors
    /// One sentence to show under the form.
    pub fn request(&self, needs_root: bool) -> Result<NewProject, String> {
        let sources: Vec<_> = self.sources.iter().filter_map(SourceForm::source).collect();
        if sources.is_empty() {
            return Err("Choose a folder of pictures or a film".into());
        }
        let root = typed_path(&self.root).or_else(|| self.suggested_root());
        let root = if needs_root {
            root.ok_or("Choose a folder for the project")?
        } else {
            PathBuf::new()
        };
        if let (Some(from), Some(to)) = (self.from, self.to)
            && from > to
        {
            return Err("The first frame lies behind the last".into());
        }
        Ok(NewProject {
            root,
            open: OpenRequest {
                sources,
                depth_unit: self.depth_unit,
                // Floats are metres unless another unit than that of most integers is chosen.
                float_depth_unit: if self.depth_unit == 0.001 {
                    1.0
                } else {
                    self.depth_unit
                },
                depth_camera: self.depth_camera()?,
                every: self.every,
                from: self.from,
                to: self.to,
            },
            cameras: typed_path(&self.cameras),
            intrinsics: intrinsics(&self.intrinsics)?,
        })
    }

    fn tells_of_depth(&self) -> bool {
        self.sources
            .iter()
            .any(|source| !source.depth.trim().is_empty())
            || self.has_depth_camera()
    }

    fn has_depth_camera(&self) -> bool {
        !self.depth_intrinsics.trim().is_empty() || !self.depth_pose.trim().is_empty()
    }

    fn depth_camera(&self) -> Result<Option<DepthCameraSource>, String> {
        let pose = typed_path(&self.depth_pose);
        let given =
            intrinsics(&self.depth_intrinsics).map_err(|what| format!("Depth camera: {what}"))?;
        if given.is_none() && pose.is_some() {
            return Err("Give the depth camera's intrinsics with its pose".into());
        }
        Ok(given.map(|intrinsics| DepthCameraSource { intrinsics, pose }))
    }
}

fn intrinsics(text: &str) -> Result<Option<IntrinsicsSource>, String> {
    let text = text.trim();
    let source = (!text.is_empty()).then(|| text.parse()).transpose()?;
    Ok(source.map(|source| match source {
        IntrinsicsSource::File(path) => IntrinsicsSource::File(typed_path(text).unwrap_or(path)),
        values => values,
    }))
}

/// The dialog for a new project, or for more frames in the open one.
pub(crate) fn new_project_ui(
    ui: &Ui,
    view: &mut ViewState,
    dialog: Dialog,
    out: &mut Vec<Command>,
) {
    let new = dialog == Dialog::NewProject;
    let response = modal(ui, "new project", 600.0, |ui| {
        ui.heading(if new {
            "New project from frames"
        } else {
            "Add frames"
        });
        ui.add_space(8.0);
        Grid::new("sources")
            .num_columns(2)
            .spacing([12.0, 8.0])
            .show(ui, |ui| form_ui(ui, view, new));
        ui.add_space(8.0);
        range_ui(ui, &mut view.new_project);
        ui.add_space(12.0);
        end_ui(ui, view, new, out);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

fn form_ui(ui: &mut Ui, view: &mut ViewState, new: bool) {
    let (form, picker) = (&mut view.new_project, &mut view.picker);
    sources_ui(ui, picker, &mut form.sources);
    if form.tells_of_depth() {
        depth_ui(ui, picker, form);
    }
    ui.label("Cameras").on_hover_text(
        "COLMAP model, transforms.json, TUM or Redwood trajectory, pose files; may stay empty",
    );
    ui.horizontal(|ui| {
        let target = (Pick::Folder, PickTarget::Cameras);
        path_field_ui(
            ui,
            picker,
            ("Cameras file or folder", "none"),
            &mut form.cameras,
            target,
        );
    });
    ui.end_row();
    intrinsics_ui(
        ui,
        (
            "Intrinsics",
            "fx, fy, cx, cy in pixels for every frame; may stay empty",
        ),
        "fx, fy, cx, cy, or a file of them",
        &mut form.intrinsics,
    );
    if new {
        let hint = form
            .suggested_root()
            .map_or("folder of the project".into(), |path| {
                path.display().to_string()
            });
        ui.label("Project folder")
            .on_hover_text("Where the project is kept; pictures stay where they are");
        ui.horizontal(|ui| {
            let target = (Pick::Folder, PickTarget::Root);
            path_field_ui(
                ui,
                picker,
                ("Project folder", &hint),
                &mut form.root,
                target,
            );
        });
        ui.end_row();
    }
}

fn depth_ui(ui: &mut Ui, picker: &mut PathPicker, form: &mut NewProjectForm) {
    field(
        ui,
        "Depth unit",
        "World units per step of the 16-bit depth: 0.001 for millimetres",
        |ui| {
            ui.add(
                DragValue::new(&mut form.depth_unit)
                    .range(1e-9..=1e6)
                    .speed(0.0001)
                    .max_decimals(9),
            );
            ui.weak("metres per step");
        },
    );
    let tip = "fx, fy, cx, cy of the camera that measured the depths, in their pixels; empty where depths lie on the \
               pictures, pixel for pixel";
    intrinsics_ui(
        ui,
        ("Depth camera", tip),
        "as the pictures'",
        &mut form.depth_intrinsics,
    );
    if form.has_depth_camera() {
        ui.label("Depth pose").on_hover_text(
            "A text of the 4 × 4 matrix that takes points of the depth camera to the pictures', in metres; may stay empty",
        );
        ui.horizontal(|ui| {
            let target = (Pick::File, PickTarget::DepthPose);
            path_field_ui(
                ui,
                picker,
                ("Depth pose", "in the same place"),
                &mut form.depth_pose,
                target,
            );
        });
        ui.end_row();
    }
}

fn intrinsics_ui(ui: &mut Ui, (name, tip): (&str, &str), hint: &str, text: &mut String) {
    field(ui, name, tip, |ui| {
        ui.add(
            TextEdit::singleline(text)
                .hint_text(hint)
                .desired_width(360.0),
        );
    });
}

fn range_ui(ui: &mut Ui, form: &mut NewProjectForm) {
    section_heading(ui, "Which frames");
    ui.horizontal(|ui| {
        ui.label("Every");
        let every = ui.add(DragValue::new(&mut form.every).range(1..=10_000).speed(0.1));
        every
            .on_hover_text("1 = all frames, 10 = every tenth")
            .accessible_name("Every n-th frame");
        ui.label("from");
        optional_ui(ui, &mut form.from, "From source frame", "first");
        ui.label("to");
        optional_ui(ui, &mut form.to, "To source frame", "last");
    });
}

fn optional_ui(ui: &mut Ui, value: &mut Option<usize>, name: &str, without: &str) {
    let mut number = value.map_or(-1, |value| i64::try_from(value).unwrap_or(i64::MAX));
    let without = without.to_owned();
    let drag = DragValue::new(&mut number)
        .range(-1..=10_000_000_i64)
        .speed(0.2)
        .custom_formatter(move |n, _| {
            if n < 0.0 {
                without.clone()
            } else {
                format!("{n:.0}")
            }
        });
    if ui
        .add(drag)
        .on_hover_text("Frame number, counted from 0")
        .accessible_name(name)
        .changed()
    {
        *value = usize::try_from(number).ok();
    }
}

fn end_ui(ui: &mut Ui, view: &mut ViewState, new: bool, out: &mut Vec<Command>) {
    let request = view.new_project.request(new);
    ui.horizontal(|ui| {
        ui.weak(request.as_ref().err().map_or("", String::as_str));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let (text, tip) = if new {
                ("Create", "Makes the project and opens it")
            } else {
                ("Add", "Adds the frames")
            };
            if ui
                .add_enabled(request.is_ok(), egui::Button::new(text))
                .on_hover_text(tip)
                .clicked()
                && let Ok(request) = request
            {
                out.push(if new {
                    Command::New(request)
                } else {
                    Command::AddFrames(request)
                });
                view.dialog = None;
                view.new_project = NewProjectForm::default();
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
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_project_folder_beside_the_frames_is_suggested() {
        let form = NewProjectForm::with_frames("/photos/rice".into());
        assert_eq!(
            form.request(true).unwrap().root,
            PathBuf::from("/photos/rice-ostra")
        );
        assert!(NewProjectForm::default().request(true).is_err());
    }

    #[test]
    fn intrinsics_are_four_numbers_or_a_file_or_nothing() {
        let mut form = NewProjectForm::with_frames("/a".into());
        form.intrinsics = "500, 500, 320.5, 240".into();
        assert_eq!(
            form.request(true).unwrap().intrinsics,
            Some(IntrinsicsSource::Values([500.0, 500.0, 320.5, 240.0]))
        );
        form.intrinsics = "/recording/intrinsic.json".into();
        let file = Some(IntrinsicsSource::File("/recording/intrinsic.json".into()));
        assert_eq!(form.request(true).unwrap().intrinsics, file);
        form.intrinsics = "500, x".into();
        assert!(form.request(true).unwrap_err().contains("four numbers"));
    }

    #[test]
    fn a_depth_camera_has_intrinsics_and_may_have_a_pose() {
        let mut form = NewProjectForm::with_frames("/a".into());
        assert_eq!(form.request(true).unwrap().open.depth_camera, None);
        form.depth_intrinsics = "580, 580, 320, 240".into();
        let intrinsics = IntrinsicsSource::Values([580.0, 580.0, 320.0, 240.0]);
        let camera = |pose| {
            Some(DepthCameraSource {
                intrinsics: intrinsics.clone(),
                pose,
            })
        };
        assert_eq!(form.request(true).unwrap().open.depth_camera, camera(None));
        form.depth_pose = "/depth.txt".into();
        assert_eq!(
            form.request(true).unwrap().open.depth_camera,
            camera(Some("/depth.txt".into()))
        );
        form.depth_intrinsics.clear();
        assert!(form.request(true).unwrap_err().contains("intrinsics"));
    }
}
