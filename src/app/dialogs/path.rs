use std::path::PathBuf;

use egui::{Context, Grid, Key, Ui};

use super::export_form::mask_format_ui;
use super::forms::RecipeTarget;
use super::picker::{
    FileKind, NO_CHOOSER, PathField, PathRequest, Pick, PickTarget, path_field_ui, typed_path,
};
use crate::ViewState;
use crate::tooltips::{add_explained, field, modal};
use ostra_project::ExportRequest;
use ostra_session::{Command, MeasureSettings};

struct Texts {
    heading: &'static str,
    field: &'static str,
    hint: &'static str,
    verb: &'static str,
    pick: Pick,
}

/// Draws a dialog that asks for a single path.
pub(crate) fn path_ui(ui: &Ui, view: &mut ViewState, request: PathRequest, out: &mut Vec<Command>) {
    let texts = texts(request);
    let mut done = false;
    let response = modal(ui, "path", 480.0, |ui| {
        ui.heading(texts.heading);
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            let field = PathField {
                name: texts.field,
                hint: texts.hint,
                pick: texts.pick,
                target: PickTarget::Path(request),
            };
            let edit = path_field_ui(ui, &mut view.picker, &field, &mut view.path_text);
            done = edit.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if view.path_text.is_empty() && ui.memory(|memory| memory.focused().is_none()) {
                edit.request_focus();
            }
        });
        if view.picker.is_unavailable() {
            ui.colored_label(ui.visuals().warn_fg_color, NO_CHOOSER);
        }
        if request == PathRequest::ImportMasks {
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                ui.label("Format");
                mask_format_ui(ui, "Mask format", &mut view.mask_format);
            });
        }
        ui.add_space(12.0);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
            let typed = !view.path_text.trim().is_empty();
            let reason = (!typed).then_some("Enter or choose a path first");
            let button = egui::Button::new(texts.verb);
            done |= add_explained(ui, button, texts.heading, reason).clicked();
            if ui
                .button("Cancel")
                .on_hover_text("Close the dialog (Esc)")
                .clicked()
            {
                view.dialog = None;
            }
        });
    });
    if done && let Some(path) = typed_path(&view.path_text) {
        match request {
            PathRequest::OpenProject => out.push(Command::Open(path)),
            PathRequest::InspectPly => out.push(Command::Inspect(path)),
            PathRequest::ImportMasks => {
                let format = view.mask_format;
                out.push(Command::ImportMasks { dir: path, format });
            }
            PathRequest::SaveTraits => out.push(Command::Export(traits_request(view, path))),
            PathRequest::SaveRecipe => view.recipe_to = Some(recipe_target(view, path)),
        }
    }
    if done || response.should_close() {
        view.dialog = None;
    }
}

/// Returns the target of a recipe, which may replace a file only if the file chooser asked before.
fn recipe_target(view: &ViewState, path: PathBuf) -> RecipeTarget {
    let may_replace = view.confirmed_path.as_ref() == Some(&path);
    RecipeTarget { path, may_replace }
}

fn traits_request(view: &ViewState, path: PathBuf) -> ExportRequest {
    let MeasureSettings { level, ground } = view.measures.settings;
    let (angles, unit) = (view.measures.pairs().collect(), view.measures.unit);
    ExportRequest {
        traits: Some(path),
        level,
        ground,
        angles,
        unit,
        ..ExportRequest::default()
    }
}

fn texts(request: PathRequest) -> Texts {
    let (heading, field, hint, verb, pick) = match request {
        PathRequest::OpenProject => (
            "Open project",
            "Project folder",
            "folder with a project.toml",
            "Open",
            Pick::Folder,
        ),
        PathRequest::InspectPly => (
            "View a point cloud",
            "PLY file",
            "labelled point cloud (.ply)",
            "Open",
            Pick::File(FileKind::CLOUD),
        ),
        PathRequest::ImportMasks => (
            "Import masks",
            "Masks folder",
            "folder of masks",
            "Import",
            Pick::Folder,
        ),
        PathRequest::SaveTraits => (
            "Export traits",
            "Table file",
            "file to write (.csv)",
            "Save",
            Pick::Save(FileKind::TABLE),
        ),
        PathRequest::SaveRecipe => (
            "Save history as recipe",
            "Recipe file",
            "file to write (.json)",
            "Save",
            Pick::Save(FileKind::RECIPE),
        ),
    };
    Texts {
        heading,
        field,
        hint,
        verb,
        pick,
    }
}

/// Draws the dialog for frames whose files have moved.
pub(crate) fn relocate_ui(ui: &Ui, view: &mut ViewState, out: &mut Vec<Command>) {
    let response = modal(ui, "relocate", 560.0, |ui| {
        ui.heading("Locate missing frames");
        ui.add_space(8.0);
        Grid::new("relocate")
            .num_columns(2)
            .spacing([8.0, 6.0])
            .show(ui, |ui| {
                let form = &mut view.relocate;
                let places = [
                    (
                        "Old path",
                        "Folder or video that is missing",
                        &mut form.from,
                        PickTarget::MovedFrom,
                    ),
                    (
                        "Is now",
                        "New path of the same files",
                        &mut form.to,
                        PickTarget::MovedTo,
                    ),
                ];
                for (name, tip, text, target) in places {
                    let path_field = PathField {
                        name,
                        hint: "folder or video",
                        pick: Pick::Folder,
                        target,
                    };
                    field(ui, name, tip, |ui| {
                        path_field_ui(ui, &mut view.picker, &path_field, text);
                    });
                }
            });
        ui.add_space(12.0);
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
            let command = view.relocate.command();
            let reason = command.is_none().then_some("Enter both paths first");
            let button = egui::Button::new("Update paths");
            let tip = "Update the paths of all frames from the old folder";
            if add_explained(ui, button, tip, reason).clicked() {
                out.extend(command);
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
    });
    if response.should_close() {
        view.dialog = None;
    }
}

/// Writes paths from the file chooser into the field that it was opened for.
///
/// A chosen project or point cloud is opened at once.
pub(crate) fn take_picked(ctx: &Context, view: &mut ViewState, out: &mut Vec<Command>) {
    let Some((target, paths)) = view.picker.poll(ctx) else {
        return;
    };
    let first = paths.first().cloned().unwrap_or_default();
    let command = match target {
        PickTarget::Path(PathRequest::OpenProject) => Some(Command::Open(first)),
        PickTarget::Path(PathRequest::InspectPly) => Some(Command::Inspect(first)),
        _ => None,
    };
    if command.is_some() {
        view.dialog = None;
        out.extend(command);
    } else {
        put_picked(view, target, paths);
    }
}

/// Opens the file chooser of a dialog with a single path field, if the system has one.
pub(crate) fn choose_path(view: &mut ViewState, request: PathRequest) {
    let pick = texts(request).pick;
    view.picker.ask_if_native(pick, PickTarget::Path(request));
}

fn put_picked(view: &mut ViewState, target: PickTarget, paths: Vec<PathBuf>) {
    let path = paths.first().cloned().unwrap_or_default();
    let text = path.display().to_string();
    match target {
        PickTarget::Frames => view.new_project.set_paths(paths),
        PickTarget::Depth => view.new_project.depth = text,
        PickTarget::Cameras => view.new_project.cameras = text,
        PickTarget::Intrinsics => view.new_project.intrinsics = text,
        PickTarget::DepthIntrinsics => view.new_project.depth_intrinsics = text,
        PickTarget::DepthPose => view.new_project.depth_pose = text,
        PickTarget::Root => view.new_project.root = text,
        PickTarget::ExportInto => view.export.into = text,
        PickTarget::Onto => view.onto_text = text,
        PickTarget::MovedFrom => view.relocate.from = text,
        PickTarget::MovedTo => view.relocate.to = text,
        PickTarget::Network => view.models.path = text,
        PickTarget::Image => view.image.path = text,
        PickTarget::Path(request) => {
            view.path_text = text;
            view.confirmed_path = matches!(texts(request).pick, Pick::Save(_)).then_some(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Prefs;

    #[test]
    fn only_the_path_from_the_file_chooser_may_be_replaced() {
        let mut view = ViewState::new(Prefs::default());
        let (chosen, typed) = (
            PathBuf::from("/a/chosen.json"),
            PathBuf::from("/a/typed.json"),
        );
        let may_replace =
            |view: &ViewState, path: &PathBuf| recipe_target(view, path.clone()).may_replace;
        view.path_text = "/a/typed.json".into();
        assert!(!may_replace(&view, &typed));
        put_picked(
            &mut view,
            PickTarget::Path(PathRequest::SaveRecipe),
            vec![chosen.clone()],
        );
        assert!(may_replace(&view, &chosen) && !may_replace(&view, &typed));
        view.clear_path();
        assert!(!may_replace(&view, &chosen), "the dialog was opened again");
        put_picked(
            &mut view,
            PickTarget::Path(PathRequest::OpenProject),
            vec![chosen.clone()],
        );
        assert!(
            !may_replace(&view, &chosen),
            "choosing a folder asks nothing"
        );
    }
}
