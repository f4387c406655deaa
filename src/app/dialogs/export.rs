use egui::{DragValue, Ui};

use super::mask_format::{mask_format_name, mask_format_ui};
use super::picker::{Pick, PickTarget, path_field_ui};
use crate::panels::{MeasureView, ground_ui, unit_ui};
use crate::tips::{modal, section_heading};
use crate::view_state::typed_path;
use crate::{Look, ViewState};
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::MaskFormat;
use ostra_project::{ExportRequest, ResultKind};
use ostra_session::Command;

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
    undistorted: bool,
    depths: bool,
    traits: bool,
    twin: bool,
    per_label: bool,
    level: usize,
    mask_format: MaskFormat,
    cloud_format: CloudFormat,
    mesh_format: MeshFormat,
    voxel_format: VoxelFormat,
    camera_encoding: ModelEncoding,
    solid: bool,
    overwrite: bool,
    /// Of the mesh's triangles, percent.
    kept: u32,
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
            undistorted: false,
            depths: false,
            traits: false,
            twin: false,
            per_label: false,
            level: 0,
            mask_format: MaskFormat::default(),
            cloud_format: CloudFormat::default(),
            mesh_format: MeshFormat::default(),
            voxel_format: VoxelFormat::default(),
            camera_encoding: ModelEncoding::default(),
            solid: false,
            overwrite: false,
            kept: 100,
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
            surface: look
                .project
                .results
                .get(&ResultKind::Cloud)
                .is_some_and(|cloud| cloud.voxel.is_some()),
            masks: !look.project.masks.is_empty(),
            cameras: look
                .project
                .frames
                .iter()
                .any(|frame| frame.posed_camera().is_some()),
            depths: look
                .project
                .frames
                .iter()
                .any(|frame| frame.depth.is_some()),
        }
    }
}

impl ExportForm {
    /// Traits have the unit, the ground and the angles of the window of measures.
    fn request(&self, has: &Available, measures: &MeasureView) -> Option<ExportRequest> {
        let into = typed_path(&self.into)?;
        let path =
            |wanted: bool, there: bool, name: &str| (wanted && there).then(|| into.join(name));
        let request = ExportRequest {
            cloud: path(self.cloud, has.cloud, &self.cloud_name()),
            mesh: path(self.mesh, has.surface, &self.mesh_name()),
            voxels: path(self.voxels, has.surface, &self.voxels_name()),
            masks: path(self.masks, has.masks, "masks"),
            mask_format: (self.masks && has.masks)
                .then(|| mask_format_name(self.mask_format).into()),
            cameras: path(self.cameras, has.cameras, "sparse"),
            camera_encoding: self.camera_encoding,
            undistorted: path(self.undistorted, has.cameras, "undistorted"),
            depths: path(self.depths, has.depths, "depths"),
            solid: self.solid && self.voxels && has.surface,
            traits: path(self.traits, has.cloud, "traits.csv"),
            ground: measures.wish.ground,
            angles: if self.traits {
                measures.pairs().collect()
            } else {
                Vec::new()
            },
            unit: measures.unit,
            level: (self.level > 0).then_some(self.level),
            twin: self.twin,
            per_label: self.per_label,
            simplify: (self.mesh && has.surface && self.kept < 100)
                .then(|| f64::from(self.kept) / 100.0),
            overwrite: self.overwrite,
        };
        let ExportRequest {
            cloud,
            mesh,
            voxels,
            masks,
            cameras,
            undistorted,
            depths,
            traits,
            ..
        } = &request;
        let anything = [
            cloud,
            mesh,
            voxels,
            masks,
            cameras,
            undistorted,
            depths,
            traits,
        ];
        let anything = anything.iter().any(|path| path.is_some());
        anything.then_some(request)
    }

    fn cloud_name(&self) -> String {
        format!("cloud.{}", self.cloud_format.ending())
    }

    fn mesh_name(&self) -> String {
        format!("mesh.{}", self.mesh_format.ending())
    }

    fn voxels_name(&self) -> String {
        format!("voxels.{}", self.voxel_format.ending())
    }
}

/// The export dialog: what to write, and into which folder.
pub(crate) fn export_ui(ui: &Ui, look: &Look<'_>, view: &mut ViewState, out: &mut Vec<Command>) {
    let has = Available::of(look);
    let response = modal(ui, "export", 520.0, |ui| {
        ui.heading("Export");
        ui.add_space(8.0);
        what_ui(ui, &mut view.export, &has);
        ui.add_space(8.0);
        section_heading(ui, "Options");
        options_ui(ui, &mut view.export);
        ui.horizontal(|ui| {
            ui.label("Traits in");
            unit_ui(ui, "Unit of traits", &mut view.measures.unit, look);
            ground_ui(ui, look, &view.ruler, &mut view.measures.wish.ground);
        });
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
    let cloud = format!(
        "{}, what its labels are in a file beside it",
        form.cloud_name()
    );
    let mesh = format!("{}, each triangle in one label", form.mesh_name());
    let voxels = format!("{}, cubes that hold points", form.voxels_name());
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
            "traits.csv, measures of each label",
            "Fuse first",
        ),
        (
            &mut form.masks,
            has.masks,
            "Masks",
            "masks/, a file a frame or one for all",
            "There are no masks yet",
        ),
        (
            &mut form.cameras,
            has.cameras,
            "Cameras",
            "sparse/ COLMAP model",
            "There are no cameras yet",
        ),
        (
            &mut form.undistorted,
            has.cameras,
            "Undistorted",
            "undistorted/ pictures and masks without lens distortion, with cameras",
            "There are no cameras yet",
        ),
        (
            &mut form.depths,
            has.depths,
            "Depths",
            "depths/ 32-bit float TIFFs",
            "There are no depths yet",
        ),
    ];
    for (wanted, there, name, what, missing) in rows {
        ui.add_enabled_ui(there, |ui| {
            ui.horizontal(|ui| {
                ui.checkbox(wanted, name)
                    .on_hover_text(format!("Writes {what}"))
                    .on_disabled_hover_text(missing);
                ui.weak(if there { what } else { missing });
            });
        });
    }
}

/// Asks whether earlier exports may be replaced that were changed since.
pub(super) fn replace_ui(ui: &mut Ui, overwrite: &mut bool) {
    let tip = "Replaces files of an earlier export that were changed since, e.g. in a spreadsheet";
    ui.checkbox(overwrite, "Replace changed exports")
        .on_hover_text(tip);
}

fn options_ui(ui: &mut Ui, form: &mut ExportForm) {
    replace_ui(ui, &mut form.overwrite);
    let tip = "Writes the same points or mesh in the colours of the labels beside the file";
    ui.checkbox(&mut form.twin, "Twin in label colours")
        .on_hover_text(tip);
    ui.checkbox(&mut form.per_label, "One file per label too")
        .on_hover_text("Writes each label's points into a file of their own");
    ui.horizontal(|ui| {
        ui.label("Masks as");
        mask_format_ui(ui, "Mask format", &mut form.mask_format);
    });
    ui.horizontal(|ui| {
        ui.label("Cloud as");
        format_ui(
            ui,
            "Cloud format",
            &mut form.cloud_format,
            CloudFormat::ALL,
            CloudFormat::ending,
        );
    });
    ui.horizontal(|ui| {
        ui.label("Mesh as");
        format_ui(
            ui,
            "Mesh format",
            &mut form.mesh_format,
            MeshFormat::ALL,
            MeshFormat::ending,
        );
        ui.label("with");
        let drag = DragValue::new(&mut form.kept)
            .range(1..=100)
            .speed(0.5)
            .suffix(" %");
        let tip = "Fewer triangles, where that changes the surface least; borders of labels stay";
        ui.add(drag)
            .on_hover_text(tip)
            .accessible_name("Triangles kept");
        ui.label("of its triangles");
    });
    ui.horizontal(|ui| {
        ui.label("Voxels as");
        format_ui(
            ui,
            "Voxel format",
            &mut form.voxel_format,
            VoxelFormat::ALL,
            VoxelFormat::ending,
        );
        ui.checkbox(&mut form.solid, "solid")
            .on_hover_text("Fills voxels with what they enclose and no view saw empty");
    });
    ui.horizontal(|ui| {
        ui.label("Cameras as");
        let tip = "COLMAP's files of text, or its smaller binary ones; those of undistorted pictures are text";
        for (encoding, text) in [(ModelEncoding::Text, "text"), (ModelEncoding::Binary, "binary")] {
            ui.radio_value(&mut form.camera_encoding, encoding, text).on_hover_text(tip);
        }
    });
    ui.horizontal(|ui| {
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
    });
}

/// The choice of a kind of file, by its ending.
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
        let button = ui.add_enabled(request.is_some(), egui::Button::new("Write files"));
        let button = button
            .on_hover_text("Writes what is ticked")
            .on_disabled_hover_text("Tick something and name a folder");
        if button.clicked()
            && let Some(request) = request
        {
            out.push(Command::Export(request));
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
    use ostra_cloud::measure::{GroundChoice, LengthUnit};
    use ostra_masks::LabelId;
    use ostra_session::MeasureWish;

    #[test]
    fn only_what_is_there_and_ticked_is_written() {
        let mut form = ExportForm {
            into: "/out".into(),
            masks: true,
            depths: true,
            mesh: true,
            ..ExportForm::default()
        };
        let has = Available {
            cloud: true,
            surface: false,
            masks: true,
            cameras: true,
            depths: false,
        };
        let measures = MeasureView::default();
        let request = form.request(&has, &measures).unwrap();
        assert_eq!(request.cloud, Some("/out/cloud.ply".into()));
        assert_eq!(request.masks, Some("/out/masks".into()));
        assert_eq!(
            (request.cameras, request.depths, request.level),
            (None, None, None)
        );
        assert_eq!(request.mesh, None, "the cloud has no surface");
        (form.mesh_format, form.kept) = (MeshFormat::Glb, 25);
        assert_eq!(
            form.request(&has, &measures).unwrap().simplify,
            None,
            "there is no mesh to simplify"
        );
        let request = form
            .request(
                &Available {
                    surface: true,
                    ..has
                },
                &measures,
            )
            .unwrap();
        assert_eq!(
            (request.mesh, request.simplify),
            (Some("/out/mesh.glb".into()), Some(0.25))
        );
        let has = Available {
            cloud: true,
            surface: false,
            masks: true,
            cameras: true,
            depths: false,
        };
        (form.mask_format, form.traits) = (MaskFormat::Coco, true);
        let request = form.request(&has, &measures).unwrap();
        assert_eq!(
            (request.mask_format.as_deref(), request.traits),
            (Some("coco"), Some("/out/traits.csv".into()))
        );
        form.cloud_format = CloudFormat::Laz;
        assert_eq!(
            form.request(&has, &measures).unwrap().cloud,
            Some("/out/cloud.laz".into())
        );
        (form.undistorted, form.camera_encoding) = (true, ModelEncoding::Binary);
        let ground = GroundChoice::Label(LabelId(3));
        let wish = MeasureWish {
            ground,
            ..MeasureWish::default()
        };
        let mut measures = MeasureView::default();
        (measures.wish, measures.unit) = (wish, Some(LengthUnit::Millimetre));
        let request = form.request(&has, &measures).unwrap();
        assert_eq!(request.undistorted, Some("/out/undistorted".into()));
        assert_eq!(
            (request.camera_encoding, request.ground),
            (ModelEncoding::Binary, ground)
        );
        assert_eq!(request.unit, Some(LengthUnit::Millimetre));
        form.into.clear();
        assert!(form.request(&has, &measures).is_none());
    }
}
