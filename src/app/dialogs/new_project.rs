//! Dialog for a new project, or for more frames of the open one.

use std::path::PathBuf;

use egui::{DragValue, Grid, Key, RichText, ScrollArea, TextEdit, Ui};

use super::new_project_form::{NewProjectForm, SourceKind, Stage, resolved};
use super::picker::{
    FileKind, NO_CHOOSER, PathField, PathPicker, Pick, PickTarget, path_field_ui, typed_path,
};
use super::survey::found_ui;
use crate::option_names::in_window_words;
use crate::textures::Textures;
use crate::tooltips::{add_explained, field, icon_button, modal};
use crate::{Dialog, SessionView, ViewState};
use ostra_session::{Command, Survey};

/// Draws the dialog for a new project, or for more frames of the open one.
pub(crate) fn new_project_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    textures: &mut Textures,
    out: &mut Vec<Command>,
) {
    let new = view.dialog == Some(Dialog::NewProject);
    let survey = current_survey(session, &view.new_project);
    let height = ui.ctx().content_rect().height();
    let response = modal(ui, "new project", 600.0, |ui| {
        ui.heading(heading(new, view.new_project.kind));
        ui.add_space(8.0);
        ScrollArea::vertical()
            .max_height((height - 150.0).max(120.0))
            .show(ui, |ui| {
                ui.add_enabled_ui(!view.new_project.is_sent(), |ui| {
                    frames_ui(ui, view);
                    ui.add_space(6.0);
                    found_ui(ui, session, &mut view.new_project, survey, textures);
                    ui.add_space(8.0);
                    if new {
                        root_ui(ui, &mut view.picker, &mut view.new_project, survey);
                    }
                    advanced_ui(ui, view);
                });
            });
        ui.add_space(8.0);
        end_ui(ui, view, survey, out);
    });
    if response.should_close() && !view.new_project.is_sent() {
        close(view);
    }
}

fn close(view: &mut ViewState) {
    view.dialog = None;
    view.new_project.resume(None);
    view.new_project.was_focused = false;
}

/// Returns what was found if it belongs to the form as it is now.
fn current_survey<'a>(session: &SessionView<'a>, form: &NewProjectForm) -> Option<&'a Survey> {
    let request = form.survey_request()?;
    session
        .survey
        .map(|survey| &**survey)
        .filter(|survey| survey.request == request)
}

fn heading(new: bool, kind: SourceKind) -> &'static str {
    match (new, kind) {
        (false, _) => "Add frames",
        (true, SourceKind::Any) => "New project",
        (true, SourceKind::Photos) => "New project from photos",
        (true, SourceKind::Video) => "New project from a video",
        (true, SourceKind::Recording) => "New project from an RGB-D recording",
    }
}

fn hint(kind: SourceKind) -> &'static str {
    match kind {
        SourceKind::Any => "Folder of images, or a video",
        SourceKind::Photos => "Folder of photos",
        SourceKind::Video => "Video file",
        SourceKind::Recording => "Folder of the recording",
    }
}

/// Draws the field that takes folders, images and videos.
fn frames_ui(ui: &mut Ui, view: &mut ViewState) {
    let (form, picker) = (&mut view.new_project, &mut view.picker);
    if form.chosen.is_empty() {
        let edit = TextEdit::singleline(&mut form.frames)
            .hint_text(hint(form.kind))
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit).accessible_name("Frames");
        if edit.changed() {
            form.error = None;
            form.stage = Stage::Editing;
        }
        if !std::mem::replace(&mut form.was_focused, true) {
            edit.request_focus();
        }
    } else {
        chosen_ui(ui, form);
    }
    let whole = match &form.paths()[..] {
        [path] => resolved(path),
        _ => None,
    };
    whole_path_ui(ui, whole);
    ui.horizontal(|ui| {
        let buttons = [
            (
                "Choose folder…",
                Pick::Folders,
                "Choose one or more folders",
            ),
            (
                "Choose files…",
                Pick::ImagesAndVideos,
                "Choose images, or a video",
            ),
        ];
        for (text, pick, tip) in buttons {
            if ui.button(text).on_hover_text(tip).clicked() {
                picker.ask(pick, PickTarget::Frames);
            }
        }
        if picker.is_unavailable() {
            ui.colored_label(ui.visuals().warn_fg_color, NO_CHOOSER);
        } else {
            ui.weak("or drop them here");
        }
    });
}

/// Draws several chosen paths, which are not edited as text.
fn chosen_ui(ui: &mut Ui, form: &mut NewProjectForm) {
    let count = form.chosen.len();
    let first = &form.chosen[0];
    let folder = first.parent().unwrap_or(first);
    let text = if form.chosen.iter().all(|path| path.parent() == Some(folder)) {
        format!("{count} items in {}", folder.display())
    } else {
        format!("{count} items, the first is {}", first.display())
    };
    let names: Vec<String> = form
        .chosen
        .iter()
        .take(20)
        .map(|path| path.display().to_string())
        .collect();
    let more = if count > 20 { "\n…" } else { "" };
    let tip = format!("{}{more}", names.join("\n"));
    let mut is_cleared = false;
    egui::Frame::new()
        .fill(ui.visuals().text_edit_bg_color())
        .corner_radius(4.0)
        .inner_margin(egui::Margin::symmetric(6, 3))
        .show(ui, |ui| {
            ui.horizontal(|ui| {
                let width = ui.available_width() - 26.0;
                let label = egui::Label::new(text).truncate();
                ui.scope(|ui| {
                    ui.set_width(width);
                    ui.add(label).on_hover_text(tip);
                });
                is_cleared =
                    icon_button(ui, "×", "Clear selection", "Choose other files").clicked();
            });
        });
    if is_cleared {
        form.set_paths(Vec::new());
        form.was_focused = false;
    }
}

/// Draws the field of the project's folder, with the whole path below it.
fn root_ui(
    ui: &mut Ui,
    picker: &mut PathPicker,
    form: &mut NewProjectForm,
    survey: Option<&Survey>,
) {
    let suggested = survey.and_then(|survey| survey.root.as_ref());
    let hint = suggested.map_or("chosen by the frames".into(), |path| {
        path.display().to_string()
    });
    ui.horizontal(|ui| {
        ui.label("Project folder")
            .on_hover_text("Folder for the project; images stay where they are");
        let field = PathField {
            name: "Project folder",
            hint: &hint,
            pick: Pick::Folder,
            target: PickTarget::Root,
        };
        path_field_ui(ui, picker, &field, &mut form.root);
    });
    // The row is there from the start, so that the buttons below stay where they are.
    let whole = typed_path(&form.root).and_then(|path| resolved(&path));
    whole_path_ui(ui, whole);
}

/// Draws the whole path of what was typed, or keeps its place free.
fn whole_path_ui(ui: &mut Ui, path: Option<PathBuf>) {
    match path {
        Some(path) => {
            ui.weak(path.display().to_string());
        }
        None => {
            ui.allocate_space(egui::vec2(
                1.0,
                ui.text_style_height(&egui::TextStyle::Body),
            ));
        }
    }
}

fn advanced_ui(ui: &mut Ui, view: &mut ViewState) {
    let is_open =
        view.new_project.kind == SourceKind::Recording && view.new_project.has_depth_camera();
    egui::CollapsingHeader::new("Advanced")
        .id_salt("advanced")
        .default_open(is_open)
        .show_unindented(ui, |ui| {
            let (form, picker) = (&mut view.new_project, &mut view.picker);
            Grid::new("sources")
                .num_columns(2)
                .spacing([12.0, 6.0])
                .show(ui, |ui| {
                    places_ui(ui, picker, form);
                    depth_ui(ui, picker, form);
                    ui.label("Use")
                        .on_hover_text("Frames of the sources to use");
                    ui.horizontal(|ui| range_ui(ui, form));
                    ui.end_row();
                });
        });
}

/// Draws the fields of depth, cameras and intrinsics that are not found by themselves.
fn places_ui(ui: &mut Ui, picker: &mut PathPicker, form: &mut NewProjectForm) {
    let rows = [
        (
            "Depth folder",
            "Folder of depth images that belong to the frames",
            "found by name",
            PickTarget::Depth,
            &mut form.depth,
        ),
        (
            "Cameras",
            "COLMAP model, transforms.json, TUM or Redwood trajectory, pose files",
            "found by name",
            PickTarget::Cameras,
            &mut form.cameras,
        ),
    ];
    for (name, tip, hint, target, text) in rows {
        ui.label(name).on_hover_text(tip);
        ui.horizontal(|ui| {
            let field = PathField {
                name,
                hint,
                pick: Pick::Folder,
                target,
            };
            path_field_ui(ui, picker, &field, text);
        });
        ui.end_row();
    }
    let field = PathField {
        name: "Intrinsics",
        hint: "fx, fy, cx, cy, or a file",
        pick: Pick::File(FileKind::TEXT),
        target: PickTarget::Intrinsics,
    };
    let tip = "fx, fy, cx, cy of all frames in pixels";
    intrinsics_ui(ui, picker, &field, tip, &mut form.intrinsics);
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
    let field = PathField {
        name: "Depth camera",
        hint: "same as the images",
        pick: Pick::File(FileKind::TEXT),
        target: PickTarget::DepthIntrinsics,
    };
    intrinsics_ui(ui, picker, &field, tip, &mut form.depth_intrinsics);
    if form.has_depth_camera() {
        ui.label("Depth pose").on_hover_text(
            "Text file with the 4 × 4 matrix from depth camera to image camera, in metres; optional",
        );
        ui.horizontal(|ui| {
            let field = PathField {
                name: "Depth pose",
                hint: "same position",
                pick: Pick::File(FileKind::TEXT),
                target: PickTarget::DepthPose,
            };
            path_field_ui(ui, picker, &field, &mut form.depth_pose);
        });
        ui.end_row();
    }
}

fn intrinsics_ui(
    ui: &mut Ui,
    picker: &mut PathPicker,
    field: &PathField<'_>,
    tip: &str,
    text: &mut String,
) {
    ui.label(field.name).on_hover_text(tip);
    ui.horizontal(|ui| path_field_ui(ui, picker, field, text));
    ui.end_row();
}

fn range_ui(ui: &mut Ui, form: &mut NewProjectForm) {
    ui.label("every");
    let every = ui.add(DragValue::new(&mut form.every).range(1..=10_000).speed(0.1));
    every
        .on_hover_text("1 uses all frames, 10 every tenth")
        .accessible_name("Use every Nth frame");
    ui.label("frames, from");
    optional_ui(ui, &mut form.from, "From source frame", "first");
    ui.label("to");
    optional_ui(ui, &mut form.to, "To source frame", "last");
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

/// Draws the error and the buttons, and sends the request.
fn end_ui(ui: &mut Ui, view: &mut ViewState, survey: Option<&Survey>, out: &mut Vec<Command>) {
    let new = view.dialog == Some(Dialog::NewProject);
    let form = &mut view.new_project;
    if let Some(error) = &form.error {
        let text = RichText::new(in_window_words(error)).color(ui.visuals().error_fg_color);
        ui.add(egui::Label::new(text).wrap());
        ui.add_space(4.0);
    }
    let is_sent = form.is_sent();
    // Enter in a text field leaves it; on a button, it presses the button.
    let is_entered = ui.input(|input| input.key_pressed(Key::Enter))
        && ui.memory(|memory| memory.focused().is_none());
    let mut cancelled = false;
    ui.horizontal(|ui| {
        if form.stage != Stage::Editing {
            ui.spinner();
            ui.weak(if is_sent {
                "Creating…"
            } else {
                "Reading the files…"
            });
        }
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let (text, tip) = if new {
                ("Create", "Create the project and open it (Enter)")
            } else {
                ("Add", "Add the frames (Enter)")
            };
            let has_frames = !form.paths().is_empty();
            let button = egui::Button::new(text).fill(ui.visuals().selection.bg_fill);
            let reason = if is_sent {
                Some("The files are being read")
            } else {
                (!has_frames).then_some("Choose images or a video first")
            };
            let button = add_explained(ui, button, tip, reason);
            if (button.clicked() || is_entered) && has_frames && !is_sent {
                form.stage = Stage::Waiting;
                form.error = None;
            }
            let tip = if is_sent {
                "Stop and keep the form"
            } else {
                "Close the dialog (Esc)"
            };
            cancelled = ui.button("Cancel").on_hover_text(tip).clicked();
        });
    });
    if form.stage == Stage::Waiting
        && let Some(survey) = survey
    {
        match form.request(survey, new) {
            Ok(request) if new => out.push(Command::New(request)),
            Ok(request) => out.push(Command::AddFrames(request)),
            // An error of the files is shown with them.
            Err(error) => {
                return form.resume(survey.error.is_none().then_some(error));
            }
        }
        form.stage = Stage::Sent;
        let warnings = survey.warnings.iter().map(|text| in_window_words(text));
        view.notices.set_read_before(warnings.collect());
    }
    if cancelled && is_sent {
        out.push(Command::Stop);
    } else if cancelled {
        close(view);
    }
}
