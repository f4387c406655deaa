use std::path::{Path, PathBuf};

use super::las::{self, Packing};
use super::{classes, names, pcd};
use crate::ply::{Coloring, save_ply};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;

/// A kind of file that a labelled cloud can be written to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CloudFormat {
    /// Labels and confidences, label names as comments.
    #[default]
    Ply,
    /// LAS 1.4: the top label as classification, all else as extra bytes.
    Las,
    /// LAS 1.4, compressed.
    Laz,
    /// The binary files of the Point Cloud Library.
    Pcd,
}

impl CloudFormat {
    /// All.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Las, Self::Laz, Self::Pcd];

    /// What the names of its files end in.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Pcd => "pcd",
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
            "a cloud",
        )
    }

    /// Writes a cloud; a stop or fault leaves what was there.
    ///
    /// # Errors
    /// [`SceneError::Io`], [`SceneError::Request`] for a cloud without points or one that the format cannot hold,
    /// [`SceneError::Stopped`].
    pub fn save(
        self,
        path: &Path,
        cloud: &LabelledCloud,
        coloring: Coloring,
        progress: &Progress,
    ) -> Result<(), SceneError> {
        if cloud.is_empty() {
            return Err(SceneError::Request(
                "the cloud has no points to write; fuse again".into(),
            ));
        }
        match self {
            Self::Ply => save_ply(path, cloud, coloring, progress),
            Self::Las => las::save(path, cloud, coloring, Packing::Plain, progress),
            Self::Laz => las::save(path, cloud, coloring, Packing::Compressed, progress),
            Self::Pcd => pcd::save(path, cloud, coloring, progress),
        }
    }

    /// Writes what the label ids and classes of a cloud at `path` mean, beside it, as `STEM.classes.json`: a list of
    /// `{"id", "name", "parent", "color", "las_class"}`, parents by their id or null, colours as `#rrggbb`.
    ///
    /// # Errors
    /// [`SceneError::Io`].
    pub fn save_classes(path: &Path, cloud: &LabelledCloud) -> Result<(), SceneError> {
        classes::save(&Self::classes_path(path), &cloud.tree)
    }

    /// Where [`Self::save_classes`] writes for a cloud at `path`.
    #[must_use]
    pub fn classes_path(path: &Path) -> PathBuf {
        path.with_extension("classes.json")
    }
}
