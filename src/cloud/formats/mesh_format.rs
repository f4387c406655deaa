use std::path::{Path, PathBuf};

use super::{glb, names, obj};
use crate::ply::{Coloring, save_mesh};
use crate::{LabelledMesh, SceneError};
use ostra_core::job::Progress;

/// A kind of file that a labelled mesh can be written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeshFormat {
    /// Labels and confidences of the vertices, label names as comments.
    #[default]
    Ply,
    /// Wavefront OBJ, with a material for each label in an MTL beside it; without confidences.
    Obj,
    /// Binary glTF 2.0 with a node for each label, turned upright.
    Glb,
}

impl MeshFormat {
    /// All.
    pub const ALL: [Self; 3] = [Self::Ply, Self::Obj, Self::Glb];

    /// What the names of its files end in.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Glb => "glb",
        }
    }

    /// The format of a file, told from its ending.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] for an ending of none.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        names::by_ending(
            path,
            Self::ALL.map(|format| (format, format.ending())),
            "a mesh",
        )
    }

    /// The file of materials that is written next to a mesh at `path`; `None` where its format has none.
    #[must_use]
    pub fn materials_path(path: &Path) -> Option<PathBuf> {
        Self::of(path)
            .is_ok_and(|format| format == Self::Obj)
            .then(|| obj::materials_path(path))
    }

    /// Writes a mesh whose triangles lie in one label each ([`LabelledMesh::split_at_labels`]); a stop or fault leaves
    /// what was there.
    ///
    /// # Errors
    /// [`SceneError::Io`], [`SceneError::Request`] for what the format cannot hold, [`SceneError::Stopped`].
    pub fn save(
        self,
        path: &Path,
        mesh: &LabelledMesh,
        coloring: Coloring,
        progress: &Progress,
    ) -> Result<(), SceneError> {
        match self {
            Self::Ply => save_mesh(path, mesh, coloring, progress),
            Self::Obj => obj::save(path, mesh, coloring, progress),
            Self::Glb => glb::save(path, mesh, coloring, progress),
        }
    }
}
