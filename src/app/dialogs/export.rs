use egui::{DragValue, Ui};

use super::picker::{Pick, PickTarget, path_field_ui};
use crate::app::tips::{modal, section_heading};
use crate::app::view_state::typed_path;
use crate::app::{Look, ViewState};
use crate::session::{Command, ExportRequest, ResultKind};

/// The export dialog as filled in so far.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportForm {
    /// Folder that everything is written into.
    pub(super) into: String,
    cloud: bool,
    mesh: bool,
    voxels: bool,
    masks: bool,
    cameras: bool,
    depths: bool,
    twin: bool,
    per_label: bool,
    level: usize,
}

impl Default for ExportForm {
    fn default() -> Self {
        Self {
            into: String::new(),
            cloud: true,
            mesh: false,
            voxels: false,
            masks: false,
            cameras: false,
            depths: false,
            twin: false,
            per_label: false,
            level: 0,
        }
    }
}

/// What there is to export.
struct Available {
    cloud: bool,
    surface: bool,
    masks: bool,
    cameras: bool,
    depths: bool,
}

impl Available {
    fn of(look: &Look<'_>) -> Self {
        Self {
            cloud: look.cloud.is_some(),
            surface: look.project.results.get(&ResultKind::Cloud).is_some_and(|cloud| cloud.voxel.is_some()),
            masks: !look.project.masks.is_empty(),
            cameras: look.project.frames.iter().any(|frame| frame.posed_camera().is_some()),
            depths: look.project.frames.iter().any(|frame| frame.depth.is_some()),
        }
    }
}

impl ExportForm {
    fn request(&self, has: &Available) -> Option<ExportRequest> {
        let into = typed_path(&self.into)?;
        let path = |wanted: bool, there: bool, name: &str| (wanted && there).then(|| into.join(name));
        let request = ExportRequest {
            cloud: path(self.cloud, has.cloud, "cloud.ply"),
            mesh: path(self.mesh, has.surface, "mesh.ply"),
            voxels: path(self.voxels, has.surface, "voxels.ply"),
            masks: path(self.masks, has.masks, "masks"),
            cameras: path(self.cameras, has.cameras, "sparse"),
            depths: path(self.depths, has.depths, "depths"),
            level: (self.level > 0).then_some(self.level),
            twin: self.twin,
            per_label: self.per_label,
            ..ExportRequest::default()
        };
        let ExportRequest { cloud, mesh, voxels, masks, cameras, depths, .. } = &request;
        let anything = [cloud, mesh, voxels, masks, cameras, depths].iter().any(|path| path.is_some());
        anything.then_some(request)
    }
}

/// The export dialog: what to write, and into which folder.
pub(in crate::app) fn export_ui(ui: &Ui, look: &Look<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    let has = Available::of(look);
    let response = modal(ui, "export", 520.0, |ui| {
        ui.heading("Export");
        ui.add_space(8.0);
        what_ui(ui, &mut view.export, &has);
        ui.add_space(8.0);
        section_heading(ui, "Options");
        options_ui(ui, &mut view.export);
        ui.add_space(8.0);
        section_heading(ui, "Into folder");
        ui.horizontal(|ui| {
            let target = (Pick::Folder, PickTarget::ExportInto);
            path_field_ui(
                ui,
                &mut view.picker,
                ("Export folder", "folder to write into"),
                &mut view.export.into,
                target,
            );
        });
        ui.add_space(12.0);
        end_ui(ui, view, &has, out);
    });
    if response.should_close() {
        view.dialog = None;
    }
}

fn what_ui(ui: &mut Ui, form: &mut ExportForm, has: &Available) {
    let rows = [
        (&mut form.cloud, has.cloud, "Labelled cloud", "cloud.ply", "Fuse first"),
        (&mut form.mesh, has.surface, "Mesh", "mesh.ply, each triangle in one label", "Fuse depths first"),
        (&mut form.voxels, has.surface, "Voxels", "voxels.ply, a point at the middle of each", "Fuse depths first"),
        (&mut form.masks, has.masks, "Masks", "masks/ palette PNGs and labels.json", "There are no masks yet"),
        (&mut form.cameras, has.cameras, "Cameras", "sparse/ COLMAP text model", "There are no cameras yet"),
        (&mut form.depths, has.depths, "Depths", "depths/ 32-bit float TIFFs", "There are no depths yet"),
    ];
    for (wanted, there, name, what, missing) in rows {
        ui.add_enabled_ui(there, |ui| {
            ui.horizontal(|ui| {
                ui.checkbox(wanted, name).on_hover_text(format!("Writes {what}")).on_disabled_hover_text(missing);
                ui.weak(if there { what } else { missing });
            });
        });
    }
}

fn options_ui(ui: &mut Ui, form: &mut ExportForm) {
    let tip = "Writes the same points or mesh in the colours of the labels beside the file";
    ui.checkbox(&mut form.twin, "Twin in label colours").on_hover_text(tip);
    ui.checkbox(&mut form.per_label, "One file per label too")
        .on_hover_text("Writes each label's points into a file of their own");
    ui.horizontal(|ui| {
        ui.label("Label level");
        let drag = DragValue::new(&mut form.level).range(0..=16).speed(0.05);
        let drag = drag.custom_formatter(|n, _| if n < 1.0 { "deepest".into() } else { format!("{n:.0}") });
        let tip = "Labels deeper than this are read as their ancestor there; 1 = top";
        ui.add(drag).on_hover_text(tip).accessible_name("Label level");
    });
}

fn end_ui(ui: &mut Ui, view: &mut ViewState, has: &Available, out: &mut Vec<Command>) {
    let request = view.export.request(has);
    ui.with_layout(egui::Layout::right_to_left(egui::Align::Min), |ui| {
        let button = ui.add_enabled(request.is_some(), egui::Button::new("Write files"));
        let button =
            button.on_hover_text("Writes what is ticked").on_disabled_hover_text("Tick something and name a folder");
        if button.clicked()
            && let Some(request) = request
        {
            out.push(Command::Export(request));
            view.dialog = None;
        }
        if ui.button("Cancel").on_hover_text("Closes the dialog (Esc)").clicked() {
            view.dialog = None;
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_there_and_ticked_is_written() {
        let mut form =
            ExportForm { into: "/out".into(), masks: true, depths: true, mesh: true, ..ExportForm::default() };
        let has = Available { cloud: true, surface: false, masks: true, cameras: true, depths: false };
        let request = form.request(&has).unwrap();
        assert_eq!(request.cloud, Some("/out/cloud.ply".into()));
        assert_eq!(request.masks, Some("/out/masks".into()));
        assert_eq!((request.cameras, request.depths, request.level), (None, None, None));
        assert_eq!(request.mesh, None, "the cloud has no surface");
        form.into.clear();
        assert!(form.request(&has).is_none());
    }
}
