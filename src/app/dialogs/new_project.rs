use egui::{DragValue, Grid, TextEdit, Ui};

use super::forms::{NewProjectForm, SourceForm};
use super::picker::{PathField, PathPicker, Pick, PickTarget, path_field_ui};
use crate::tooltips::{field, icon_button, modal, section_heading};
use crate::{Dialog, ViewState};
use ostra_session::Command;

/// Draws the dialog for a new project, or for more frames of the open one.
pub(crate) fn new_project_ui(
    ui: &Ui,
    view: &mut ViewState,
    dialog: Dialog,
    out: &mut Vec<Command>,
) {
    let new = dialog == Dialog::NewProject;
    let response = modal(ui, "new project", 600.0, |ui| {
        ui.heading(if new { "New project" } else { "Add frames" });
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
    if form.describes_depth() {
        depth_ui(ui, picker, form);
    }
    ui.label("Cameras").on_hover_text(
        "COLMAP model, transforms.json, TUM or Redwood trajectory, pose files; optional",
    );
    ui.horizontal(|ui| {
        let field = PathField {
            name: "Cameras file or folder",
            hint: "none",
            pick: Pick::Folder,
            target: PickTarget::Cameras,
        };
        path_field_ui(ui, picker, &field, &mut form.cameras);
    });
    ui.end_row();
    intrinsics_ui(
        ui,
        "Intrinsics",
        "fx, fy, cx, cy of all frames in pixels; optional",
        "fx, fy, cx, cy, or a file",
        &mut form.intrinsics,
    );
    if new {
        let hint = form
            .suggested_root()
            .map_or("folder of the project".into(), |path| {
                path.display().to_string()
            });
        ui.label("Project folder")
            .on_hover_text("Folder for the project; images stay where they are");
        ui.horizontal(|ui| {
            let field = PathField {
                name: "Project folder",
                hint: &hint,
                pick: Pick::Folder,
                target: PickTarget::Root,
            };
            path_field_ui(ui, picker, &field, &mut form.root);
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
               images, pixel for pixel";
    intrinsics_ui(
        ui,
        "Depth camera",
        tip,
        "same as the images",
        &mut form.depth_intrinsics,
    );
    if form.has_depth_camera() {
        ui.label("Depth pose").on_hover_text(
            "Text file with the 4 × 4 matrix from depth camera to image camera, in metres; optional",
        );
        ui.horizontal(|ui| {
            let field = PathField {
                name: "Depth pose",
                hint: "same position",
                pick: Pick::File,
                target: PickTarget::DepthPose,
            };
            path_field_ui(ui, picker, &field, &mut form.depth_pose);
        });
        ui.end_row();
    }
}

fn intrinsics_ui(ui: &mut Ui, name: &str, tip: &str, hint: &str, text: &mut String) {
    field(ui, name, tip, |ui| {
        ui.add(
            TextEdit::singleline(text)
                .hint_text(hint)
                .desired_width(360.0),
        );
    });
}

fn range_ui(ui: &mut Ui, form: &mut NewProjectForm) {
    section_heading(ui, "Frames to use");
    ui.horizontal(|ui| {
        ui.label("Every");
        let every = ui.add(DragValue::new(&mut form.every).range(1..=10_000).speed(0.1));
        every
            .on_hover_text("1 uses all frames, 10 every tenth")
            .accessible_name("Use every Nth frame");
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
                ("Create", "Create the project and open it")
            } else {
                ("Add", "Add the frames")
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
                .on_hover_text("Close the dialog (Esc)")
                .clicked()
            {
                view.dialog = None;
            }
        });
    });
}

/// Draws the rows of all sources, each with its depth folder.
fn sources_ui(ui: &mut Ui, picker: &mut PathPicker, sources: &mut Vec<SourceForm>) {
    let mut removed = None;
    let several = sources.len() > 1;
    for (index, source) in sources.iter_mut().enumerate() {
        let number = if several {
            format!(" {}", index + 1)
        } else {
            String::new()
        };
        ui.label(format!("Frames{number}"))
            .on_hover_text("Folder of images, single image or video");
        ui.horizontal(|ui| {
            let name = format!("Frames folder or video{number}");
            let field = PathField {
                name: &name,
                hint: "folder of images, or a video",
                pick: Pick::Folder,
                target: PickTarget::Frames(index),
            };
            path_field_ui(ui, picker, &field, &mut source.frames);
            if several
                && icon_button(
                    ui,
                    "×",
                    &format!("Remove source{number}"),
                    "Remove this source",
                )
                .clicked()
            {
                removed = Some(index);
            }
        });
        ui.end_row();
        ui.label(format!("Depth{number}"))
            .on_hover_text("Folder of depth images that belong to these frames");
        ui.horizontal(|ui| {
            let name = format!("Depth folder{number}");
            let field = PathField {
                name: &name,
                hint: "none",
                pick: Pick::Folder,
                target: PickTarget::Depth(index),
            };
            path_field_ui(ui, picker, &field, &mut source.depth);
        });
        ui.end_row();
    }
    if let Some(index) = removed {
        sources.remove(index);
    }
    ui.label("");
    if ui
        .small_button("+ More frames")
        .on_hover_text("Add another folder or video to this project")
        .clicked()
    {
        sources.push(SourceForm::default());
    }
    ui.end_row();
}
