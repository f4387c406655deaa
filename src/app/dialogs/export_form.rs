//! State of the export dialog.

use std::path::{Path, PathBuf};

use egui::{ComboBox, Ui};

use super::picker::typed_path;
use crate::SessionView;
use crate::panels::MeasureView;
use ostra_cloud::formats::{CloudFormat, MeshFormat, VoxelFormat};
use ostra_frames::cameras::ModelEncoding;
use ostra_masks::MaskFormat;
use ostra_project::{ExportRequest, ResultKind};

/// State of the export dialog.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExportForm {
    /// Folder that everything is written into.
    pub(super) into: String,
    pub(super) cloud: bool,
    pub(super) mesh: bool,
    pub(super) voxels: bool,
    pub(super) masks: bool,
    pub(super) cameras: bool,
    pub(super) undistorted: bool,
    pub(super) depths: bool,
    pub(super) traits: bool,
    pub(super) twin: bool,
    pub(super) per_label: bool,
    pub(super) level: usize,
    pub(super) mask_format: MaskFormat,
    pub(super) cloud_format: CloudFormat,
    pub(super) mesh_format: MeshFormat,
    pub(super) voxel_format: VoxelFormat,
    pub(super) camera_encoding: ModelEncoding,
    pub(super) solid: bool,
    pub(super) overwrite: bool,
    /// Share of the mesh's triangles to keep, in percent.
    pub(super) kept: u32,
    /// Whether a folder was suggested; the user may have emptied the field since.
    pub(super) is_suggested: bool,
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
            is_suggested: false,
        }
    }
}

/// Kinds of results that are ticked and available.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Ticked {
    pub(super) cloud: bool,
    pub(super) mesh: bool,
    pub(super) voxels: bool,
    pub(super) masks: bool,
    pub(super) cameras: bool,
    pub(super) undistorted: bool,
    pub(super) depths: bool,
    pub(super) traits: bool,
}

impl Ticked {
    /// Returns whether one of these results has labels.
    pub(super) fn has_labels(self) -> bool {
        self.cloud || self.mesh || self.voxels || self.masks || self.traits
    }
}

impl ExportForm {
    /// Returns the kinds of results that are ticked and available.
    pub(super) fn ticked(&self, has: &Available) -> Ticked {
        Ticked {
            cloud: self.cloud && has.cloud,
            mesh: self.mesh && has.surface,
            voxels: self.voxels && has.surface,
            masks: self.masks && has.masks,
            cameras: self.cameras && has.cameras,
            undistorted: self.undistorted && has.cameras,
            depths: self.depths && has.depths,
            traits: self.traits && has.cloud,
        }
    }

    /// Suggests a new folder next to the project, once.
    pub(super) fn suggest_folder(&mut self, session: &SessionView<'_>) {
        if std::mem::replace(&mut self.is_suggested, true) || !self.into.is_empty() {
            return;
        }
        let open = session.root.or(session.inspected);
        if let Some(folder) = open.and_then(|path| free_folder(path, dirs::document_dir())) {
            self.into = folder.display().to_string();
        }
    }

    /// Returns the files that masks are written as.
    pub(super) fn mask_text(&self) -> &'static str {
        mask_format_text(self.mask_format)
    }

    /// Returns the export request, or `None` without a folder or anything to export.
    ///
    /// Unit, ground and angles of traits are those of the traits window.
    pub(super) fn request(&self, has: &Available, measures: &MeasureView) -> Option<ExportRequest> {
        let into = typed_path(&self.into)?;
        let path =
            |wanted: bool, there: bool, name: &str| (wanted && there).then(|| into.join(name));
        let request = ExportRequest {
            cloud: path(self.cloud, has.cloud, &self.cloud_name()),
            mesh: path(self.mesh, has.surface, &self.mesh_name()),
            voxels: path(self.voxels, has.surface, &self.voxels_name()),
            masks: path(self.masks, has.masks, "masks"),
            mask_format: (self.masks && has.masks).then_some(self.mask_format),
            cameras: path(self.cameras, has.cameras, "sparse"),
            camera_encoding: self.camera_encoding,
            undistorted: path(self.undistorted, has.cameras, "undistorted"),
            depths: path(self.depths, has.depths, "depths"),
            solid: self.solid && self.voxels && has.surface,
            traits: path(self.traits, has.cloud, "traits.csv"),
            ground: measures.settings.ground,
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

    pub(super) fn cloud_name(&self) -> String {
        format!("cloud.{}", self.cloud_format.ending())
    }

    pub(super) fn mesh_name(&self) -> String {
        format!("mesh.{}", self.mesh_format.ending())
    }

    pub(super) fn voxels_name(&self) -> String {
        format!("voxels.{}", self.voxel_format.ending())
    }
}

/// Returns a folder `NAME-export` next to a project or file that does not exist yet.
///
/// Without write permission there, it is in `documents`.
fn free_folder(path: &Path, documents: Option<PathBuf>) -> Option<PathBuf> {
    let name = path.file_stem()?.to_string_lossy();
    let is_writable = |folder: &Path| {
        let data = std::fs::metadata(folder);
        data.is_ok_and(|data| !data.permissions().readonly())
    };
    let parent = path.parent()?;
    let parent = match documents {
        Some(documents) if !is_writable(parent) => documents,
        _ => parent.to_owned(),
    };
    let numbered = |number: usize| match number {
        1 => parent.join(format!("{name}-export")),
        _ => parent.join(format!("{name}-export-{number}")),
    };
    (1..100).map(numbered).find(|folder| !folder.exists())
}

/// Results that can be exported.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Available {
    pub(super) cloud: bool,
    pub(super) surface: bool,
    pub(super) masks: bool,
    pub(super) cameras: bool,
    pub(super) depths: bool,
}

impl Available {
    pub(super) fn of(session: &SessionView<'_>) -> Self {
        Self {
            cloud: session.cloud.is_some(),
            surface: session
                .project
                .results
                .get(&ResultKind::Cloud)
                .is_some_and(|cloud| cloud.voxel.is_some()),
            masks: !session.project.masks.is_empty(),
            cameras: session
                .project
                .frames
                .iter()
                .any(|frame| frame.posed_camera().is_some()),
            depths: session
                .project
                .frames
                .iter()
                .any(|frame| frame.depth.is_some()),
        }
    }
}

/// Draws the choice of a mask format.
pub(super) fn mask_format_ui(ui: &mut Ui, name: &str, chosen: &mut MaskFormat) {
    let choice = ComboBox::from_id_salt(name)
        .selected_text(mask_format_text(*chosen))
        .width(230.0)
        .show_ui(ui, |ui| {
            for format in MaskFormat::ALL {
                ui.selectable_value(chosen, format, mask_format_text(format));
            }
        });
    choice
        .response
        .on_hover_text("How masks are written in files")
        .accessible_name(name);
}

/// Returns the name of a mask format in the window.
fn mask_format_text(format: MaskFormat) -> &'static str {
    match format {
        MaskFormat::Davis => "indexed PNG per frame (DAVIS)",
        MaskFormat::Binary => "black and white PNG per label and frame",
        MaskFormat::Coco => "one COCO JSON file",
        MaskFormat::Yolo => "YOLO outlines, one file per frame",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::tempdir;

    use ostra_cloud::measure::{GroundChoice, LengthUnit};
    use ostra_masks::LabelId;
    use ostra_session::MeasureSettings;

    #[test]
    fn suggested_folder_is_next_to_the_project_and_new() {
        let dir = tempdir().unwrap();
        let project = dir.path().join("rice");
        let suggested = || free_folder(&project, None).unwrap();
        assert_eq!(suggested(), dir.path().join("rice-export"));
        std::fs::create_dir(dir.path().join("rice-export")).unwrap();
        assert_eq!(suggested(), dir.path().join("rice-export-2"));
        let ply = dir.path().join("pot.ply");
        assert_eq!(free_folder(&ply, None), Some(dir.path().join("pot-export")));
        let elsewhere = free_folder(
            Path::new("/nowhere/rice"),
            Some(dir.path().join("Documents")),
        );
        assert_eq!(elsewhere, Some(dir.path().join("Documents/rice-export")));
    }

    #[test]
    fn only_available_and_ticked_results_are_exported() {
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
            (request.mask_format, request.traits),
            (Some(MaskFormat::Coco), Some("/out/traits.csv".into()))
        );
        form.cloud_format = CloudFormat::Laz;
        assert_eq!(
            form.request(&has, &measures).unwrap().cloud,
            Some("/out/cloud.laz".into())
        );
        (form.undistorted, form.camera_encoding) = (true, ModelEncoding::Binary);
        let ground = GroundChoice::Label(LabelId(3));
        let settings = MeasureSettings {
            ground,
            ..MeasureSettings::default()
        };
        let mut measures = MeasureView::default();
        (measures.settings, measures.unit) = (settings, Some(LengthUnit::Millimetre));
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
