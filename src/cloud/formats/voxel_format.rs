use std::path::Path;

use super::{names, npz, vox};
use crate::ply::{Coloring, save_ply};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;

/// A kind of file that voxels (as [`crate::voxelize`] makes them) can be written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VoxelFormat {
    /// A point at the middle of each.
    #[default]
    Ply,
    /// NumPy arrays: places in the grid, labels, confidences, colours, the grid's origin and edge, label names.
    Npz,
    /// MagicaVoxel: an object for each label, in the labels' colours; without confidences and the edge's length.
    Vox,
}

impl VoxelFormat {
    /// All.
    pub const ALL: [Self; 3] = [Self::Ply, Self::Npz, Self::Vox];

    /// What the names of its files end in.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Npz => "npz",
            Self::Vox => "vox",
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
            "voxels",
        )
    }

    /// Whether a file in the pictures' colours and one in the labels' differ.
    #[must_use]
    pub fn has_twin(self) -> bool {
        self != Self::Vox
    }

    /// Writes voxels of edge `voxel` (world units); a stop or fault leaves what was there.
    ///
    /// # Errors
    /// [`SceneError::Io`], [`SceneError::Request`] for what the format cannot hold, [`SceneError::Stopped`].
    pub fn save(
        self,
        path: &Path,
        voxels: &LabelledCloud,
        voxel: f64,
        coloring: Coloring,
        progress: &Progress,
    ) -> Result<(), SceneError> {
        match self {
            Self::Ply => save_ply(path, voxels, coloring, progress),
            Self::Npz => npz::save(path, voxels, voxel, coloring, progress),
            Self::Vox => vox::save(path, voxels, voxel, progress),
        }
    }
}
