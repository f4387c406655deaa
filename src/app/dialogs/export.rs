//! The export dialog: what to write, and into which folder.

use egui::{Button, Checkbox, DragValue, ScrollArea, Ui};

use super::export_form::{Available, ExportForm, mask_format_ui};
use super::export_presets::Preset;
use super::picker::{PathField, Pick, PickTarget, path_field_ui};
use crate::panels::{ground_ui, scale_note_ui, unit_ui};
use crate::tooltips::{add_explained, modal, section_heading};
use crate::{SessionView, ViewState};
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat};
use ostra_frames::cameras::ModelEncoding;
use ostra_session::Command;

/// Draws the export dialog: what to write, and into which folder.
pub(crate) fn export_ui(
    ui: &Ui,
    session: &SessionView<'_>,
    view: &mut ViewState,
    out: &mut Vec<Command>,
) {
    let has = Available::of(session);
    view.export.suggest_folder(session);
    // Heading, buttons and margins keep their place around what scrolls.
    let height = (ui.ctx().content_rect().height() - 150.0).max(160.0);
    let response = modal(ui, "export", 520.0, |ui| {
        ui.heading("Export");
        ui.add_space(6.0);
        ScrollArea::vertical()
            .max_height(height)
            .show(ui, |ui| content_ui(ui, session, view, &has));
        ui.add_space(8.0);
        end_ui(ui, view, &has, out);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

fn content_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState, has: &Available) {
    presets_ui(ui, &mut view.export, has);
    ui.add_space(6.0);
    what_ui(ui, &mut view.export, has);
    if view.export.traits && has.cloud {
        ui.horizontal(|ui| {
            ui.label("Unit of traits");
            unit_ui(ui, "Unit of traits", &mut view.measures.unit, session);
        });
        scale_note_ui(ui, session, view);
    }
    section_heading(ui, "Folder");
    ui.horizontal(|ui| {
        let field = PathField {
            name: "Export folder",
            hint: "folder for the exported files",
            pick: Pick::Folder,
            target: PickTarget::ExportInto,
        };
        path_field_ui(ui, &mut view.picker, &field, &mut view.export.into);
    });
    ui.add_space(4.0);
    egui::CollapsingHeader::new("Advanced options")
        .id_salt("export options")
        .show_unindented(ui, |ui| options_ui(ui, session, view, has));
}

/// Draws the buttons that tick what is needed for a purpose.
fn presets_ui(ui: &mut Ui, form: &mut ExportForm, has: &Available) {
    ui.horizontal_wrapped(|ui| {
        for preset in Preset::ALL {
            let missing = preset.missing(has);
            let is_chosen = form.is(preset, has);
            let button = Button::selectable(is_chosen, preset.text()).frame_when_inactive(true);
            if add_explained(ui, button, preset.tip(), missing).clicked() {
                form.apply(preset, has);
            }
        }
    });
}

fn what_ui(ui: &mut Ui, form: &mut ExportForm, has: &Available) {
    let cloud = format!("{} plus a label list", form.cloud_name());
    let mesh = format!("{}, one label per triangle", form.mesh_name());
    let voxels = format!("{}, occupied voxels", form.voxels_name());
    let masks = format!("masks/, {}", form.mask_text());
    let rows = [
        (
            &mut form.cloud,
            has.cloud,
            "Labelled cloud",
            cloud.as_str(),
            "Fuse first",
        ),
        (
            &mut form.mesh,
            has.surface,
            "Mesh",
            mesh.as_str(),
            "Fuse depths first",
        ),
        (
            &mut form.voxels,
            has.surface,
            "Voxels",
            voxels.as_str(),
            "Fuse depths first",
        ),
        (
            &mut form.traits,
            has.cloud,
            "Traits",
            "traits.csv, a table of traits per label",
            "Fuse first",
        ),
        (
            &mut form.masks,
            has.masks,
            "Masks",
            masks.as_str(),
            "No masks yet",
        ),
        (
            &mut form.cameras,
            has.cameras,
            "Cameras",
            "sparse/, a COLMAP model",
            "No cameras yet",
        ),
        (
            &mut form.undistorted,
            has.cameras,
            "Undistorted",
            "undistorted/, images and masks without lens distortion, with cameras",
            "No cameras yet",
        ),
        (
            &mut form.depths,
            has.depths,
            "Depths",
            "depths/, 32-bit float TIFFs",
            "No depth maps yet",
        ),
    ];
    for (wanted, there, name, what, missing) in rows {
        ui.horizontal(|ui| {
            let (tip, reason) = (format!("Write {what}"), (!there).then_some(missing));
            add_explained(ui, Checkbox::new(wanted, name), &tip, reason);
            ui.weak(if there { what } else { missing });
        });
    }
}

/// Draws the option to replace exported files that were changed since.
pub(super) fn replace_ui(ui: &mut Ui, overwrite: &mut bool) {
    let tip =
        "Replace exported files even if they were changed since, for example in a spreadsheet";
    ui.checkbox(overwrite, "Replace changed exports")
        .on_hover_text(tip);
}

fn options_ui(ui: &mut Ui, session: &SessionView<'_>, view: &mut ViewState, has: &Available) {
    let form = &mut view.export;
    let ticked = form.ticked(has);
    replace_ui(ui, &mut form.overwrite);
    if ticked.cloud || ticked.mesh || ticked.voxels {
        ui.checkbox(&mut form.twin, "Copy in label colours")
            .on_hover_text("Also save a copy in label colours");
        ui.checkbox(&mut form.per_label, "One file per label")
            .on_hover_text("Also save one file per label");
    }
    if ticked.cloud {
        let (format, all) = (&mut form.cloud_format, CloudFormat::ALL);
        ui.horizontal(|ui| {
            ui.label("Cloud as");
            format_ui(ui, "Cloud format", format, all, CloudFormat::ending);
        });
    }
    if ticked.mesh {
        ui.horizontal(|ui| mesh_options_ui(ui, form));
    }
    if ticked.voxels {
        let (format, all) = (&mut form.voxel_format, VoxelFormat::ALL);
        ui.horizontal(|ui| {
            ui.label("Voxels as");
            format_ui(ui, "Voxel format", format, all, VoxelFormat::ending);
            ui.checkbox(&mut form.solid, "solid")
                .on_hover_text("Fill the inside of closed surfaces that no view shows as empty");
        });
    }
    if ticked.masks {
        ui.horizontal(|ui| {
            ui.label("Masks as");
            mask_format_ui(ui, "Mask format", &mut form.mask_format);
        });
    }
    if ticked.cameras || ticked.undistorted {
        ui.horizontal(|ui| camera_options_ui(ui, form));
    }
    if ticked.has_labels() {
        ui.horizontal(|ui| level_ui(ui, form));
    }
    if ticked.traits {
        ui.horizontal_wrapped(|ui| {
            ground_ui(ui, session, &view.ruler, &mut view.measures.settings.ground);
        });
    }
}

fn mesh_options_ui(ui: &mut Ui, form: &mut ExportForm) {
    ui.label("Mesh as");
    let (format, all) = (&mut form.mesh_format, MeshFormat::ALL);
    format_ui(ui, "Mesh format", format, all, MeshFormat::ending);
    ui.label("with");
    let drag = DragValue::new(&mut form.kept)
        .range(1..=100)
        .speed(0.5)
        .suffix(" %");
    let tip =
        "Reduce the number of triangles where it changes the surface least, keeping label borders";
    ui.add(drag)
        .on_hover_text(tip)
        .accessible_name("Triangles kept");
    ui.label("of its triangles");
}

fn camera_options_ui(ui: &mut Ui, form: &mut ExportForm) {
    ui.label("Cameras as");
    let tip = "COLMAP text files, or the smaller binary files; cameras of undistorted images are always text";
    for (encoding, text) in [
        (ModelEncoding::Text, "text"),
        (ModelEncoding::Binary, "binary"),
    ] {
        ui.radio_value(&mut form.camera_encoding, encoding, text)
            .on_hover_text(tip);
    }
}

fn level_ui(ui: &mut Ui, form: &mut ExportForm) {
    ui.label("Label level");
    let drag = DragValue::new(&mut form.level).range(0..=16).speed(0.05);
    let drag = drag.custom_formatter(|n, _| {
        if n < 1.0 {
            "deepest".into()
        } else {
            format!("{n:.0}")
        }
    });
    let tip = "Labels deeper than this are read as their ancestor there; 1 = top";
    ui.add(drag)
        .on_hover_text(tip)
        .accessible_name("Label level");
}

/// Draws the choice of a file format by its extension.
fn format_ui<T: Copy + PartialEq, const N: usize>(
    ui: &mut Ui,
    name: &str,
    chosen: &mut T,
    all: [T; N],
    ending: fn(T) -> &'static str,
) {
    let text = ending(*chosen).to_uppercase();
    let choice = egui::ComboBox::from_id_salt(name)
        .selected_text(text)
        .width(70.0)
        .show_ui(ui, |ui| {
            for format in all {
                ui.selectable_value(chosen, format, ending(format).to_uppercase());
            }
        });
    choice
        .response
        .on_hover_text("The kind of file")
        .accessible_name(name);
}

fn end_ui(ui: &mut Ui, view: &mut ViewState, has: &Available, out: &mut Vec<Command>) {
    let request = view.export.request(has, &view.measures);
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
        let reason = request
            .is_none()
            .then_some("Tick something and name a folder first");
        let button = add_explained(
            ui,
            Button::new("Write files"),
            "Write what is ticked",
            reason,
        );
        if button.clicked()
            && let Some(request) = request
        {
            out.push(Command::Export(request));
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
