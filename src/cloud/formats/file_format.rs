//! Formats by file ending, and the file that keeps the origin.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::las::{self, Packing};
use super::{glb, labels, npz, obj, pcd, vox};
use crate::ply::{Coloring, save_mesh, save_ply};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, LabelledMesh, SceneError};
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
        by_ending(
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
        labels::save(&Self::classes_path(path), &cloud.tree)
    }

    /// Where [`Self::save_classes`] writes for a cloud at `path`.
    #[must_use]
    pub fn classes_path(path: &Path) -> PathBuf {
        path.with_extension("classes.json")
    }
}

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
        by_ending(
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
        by_ending(
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

/// What the ending of a file stands for.
fn by_ending<T: Copy, const N: usize>(
    path: &Path,
    known: [(T, &str); N],
    what: &str,
) -> Result<T, SceneError> {
    let ending = path.extension().unwrap_or_default();
    let found = known
        .iter()
        .find(|(_, name)| ending.eq_ignore_ascii_case(name));
    found.map(|(format, _)| *format).ok_or_else(|| {
        let names: Vec<String> = known.iter().map(|(_, name)| format!(".{name}")).collect();
        let what = format!(
            "{what} cannot be written under this ending; give a name that ends in {}",
            names.join(", ")
        );
        SceneError::Invalid {
            path: path.to_path_buf(),
            what,
        }
    })
}

/// Where [`save_origin`] writes: by the whole name, because a cloud and a mesh of one stem have a file each.
#[must_use]
pub fn origin_path(path: &Path) -> PathBuf {
    path.with_file_name(format!(
        "{}.origin.json",
        path.file_name().unwrap_or_default().to_string_lossy()
    ))
}

/// Writes `NAME.origin.json` next to a file whose positions are relative to an origin other than zero, and returns what
/// the user should know. LAS, LAZ and NPZ hold global coordinates themselves; the file says the same of them.
///
/// # Errors
/// [`SceneError::Io`] where it cannot be written.
pub fn save_origin(path: &Path, origin: DVec3) -> Result<Option<String>, SceneError> {
    if origin == DVec3::ZERO {
        return Ok(None);
    }
    let ending = path
        .extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase();
    let (is_global, positions) = match ending.as_str() {
        "las" | "laz" | "npz" => (true, "global"),
        "glb" => (
            false,
            "relative to the origin, in the axes that the meshes have below the root node (x right, y down, z forward): \
             add it there for global coordinates",
        ),
        "vox" => (
            false,
            "whole voxels, without their place in the world; NPZ holds it",
        ),
        _ => (
            false,
            "relative to the origin: add it for global coordinates",
        ),
    };
    let beside = origin_path(path);
    let value = serde_json::json!({ "origin": origin.to_array(), "positions": positions });
    write_whole(&beside, |out| writeln!(out, "{value:#}").map_err(unplaced))?;
    let DVec3 { x, y, z } = origin;
    Ok((!is_global).then(|| {
        format!(
            "{}: the origin is {x} {y} {z}, as {} says; positions are {positions}",
            path.display(),
            beside.display()
        )
    }))
}
