//! File formats, chosen by file extension, and the file that stores the origin.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;

use super::las::{self, Packing};
use super::{glb, labels, npz, obj, pcd, vox};
use crate::ply::{SavedColors, save_mesh, save_ply};
use crate::whole_file::{unplaced, write_whole};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_core::lists::in_words;

/// A file format for labelled clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CloudFormat {
    /// Labels and confidences, with label names as comments.
    #[default]
    Ply,
    /// LAS 1.4: the top-level label as classification, everything else as extra bytes.
    Las,
    /// Compressed LAS 1.4.
    Laz,
    /// Binary PCD, the format of the Point Cloud Library.
    Pcd,
}

impl CloudFormat {
    /// All cloud formats.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Las, Self::Laz, Self::Pcd];

    /// Returns the file extension of this format, without the dot.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Las => "las",
            Self::Laz => "laz",
            Self::Pcd => "pcd",
        }
    }

    /// Returns the endings of all formats in words: `.ply, .las, .laz or .pcd`.
    #[must_use]
    pub fn endings() -> String {
        endings(Self::ALL.map(Self::ending))
    }

    /// Returns the format that the extension of `path` stands for.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Invalid`] if no cloud format has this extension.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        by_ending(
            path,
            Self::ALL.map(|format| (format, format.ending())),
            "a cloud",
        )
    }

    /// Writes a cloud to `path`.
    ///
    /// The previous file is left intact if the job is stopped or fails.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Io`] if the file cannot be written. Returns [`SceneError::Request`] if
    /// the cloud has no points or the format cannot hold it. Returns [`SceneError::Stopped`] if the
    /// job is stopped.
    pub fn save(
        self,
        path: &Path,
        cloud: &LabelledCloud,
        coloring: SavedColors,
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

    /// Writes the label table of a cloud at `path` to `STEM.classes.json` next to it.
    ///
    /// The file is a list of `{"id", "name", "parent", "color", "las_class"}`. A parent is an id or
    /// null; a colour is written as `#rrggbb`.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Io`] if the file cannot be written.
    pub fn save_classes(path: &Path, cloud: &LabelledCloud) -> Result<(), SceneError> {
        labels::save(&Self::classes_path(path), &cloud.tree)
    }

    /// Returns the path that [`Self::save_classes`] writes to for a cloud at `path`.
    #[must_use]
    pub fn classes_path(path: &Path) -> PathBuf {
        path.with_extension("classes.json")
    }
}

/// A file format for labelled meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MeshFormat {
    /// Labels and confidences per vertex, with label names as comments.
    #[default]
    Ply,
    /// Wavefront OBJ without confidences; an MTL file next to it has one material per label.
    Obj,
    /// Binary glTF 2.0 with one node per label, rotated so that up is up.
    Glb,
}

impl MeshFormat {
    /// All mesh formats.
    pub const ALL: [Self; 3] = [Self::Ply, Self::Obj, Self::Glb];

    /// Returns the file extension of this format, without the dot.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Obj => "obj",
            Self::Glb => "glb",
        }
    }

    /// Returns the endings of all formats in words: `.ply, .obj or .glb`.
    #[must_use]
    pub fn endings() -> String {
        endings(Self::ALL.map(Self::ending))
    }

    /// Returns the format that the extension of `path` stands for.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Invalid`] if no mesh format has this extension.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        by_ending(
            path,
            Self::ALL.map(|format| (format, format.ending())),
            "a mesh",
        )
    }

    /// Returns the path of the material file written next to a mesh at `path`.
    ///
    /// Returns `None` for formats without a material file.
    #[must_use]
    pub fn materials_path(path: &Path) -> Option<PathBuf> {
        Self::of(path)
            .is_ok_and(|format| format == Self::Obj)
            .then(|| obj::materials_path(path))
    }

    /// Writes a mesh to `path`.
    ///
    /// Every triangle must lie within one label; see [`LabelledMesh::split_at_labels`]. The
    /// previous file is left intact if the job is stopped or fails.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Io`] if the file cannot be written. Returns [`SceneError::Request`] if
    /// the format cannot hold the mesh. Returns [`SceneError::Stopped`] if the job is stopped.
    pub fn save(
        self,
        path: &Path,
        mesh: &LabelledMesh,
        coloring: SavedColors,
        progress: &Progress,
    ) -> Result<(), SceneError> {
        match self {
            Self::Ply => save_mesh(path, mesh, coloring, progress),
            Self::Obj => obj::save(path, mesh, coloring, progress),
            Self::Glb => glb::save(path, mesh, coloring, progress),
        }
    }
}

/// A file format for voxels as returned by [`crate::voxelize`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VoxelFormat {
    /// One point at the centre of each voxel.
    #[default]
    Ply,
    /// NumPy arrays with grid indices and all attributes.
    ///
    /// The attributes are labels, confidences, colours, the origin of the grid, the voxel size and
    /// the label names.
    Npz,
    /// MagicaVoxel: one object per label in its colour, without confidences and voxel size.
    Vox,
}

impl VoxelFormat {
    /// All voxel formats.
    pub const ALL: [Self; 3] = [Self::Ply, Self::Npz, Self::Vox];

    /// Returns the file extension of this format, without the dot.
    #[must_use]
    pub const fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Npz => "npz",
            Self::Vox => "vox",
        }
    }

    /// Returns the endings of all formats in words: `.ply, .npz or .vox`.
    #[must_use]
    pub fn endings() -> String {
        endings(Self::ALL.map(Self::ending))
    }

    /// Returns the format that the extension of `path` stands for.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Invalid`] if no voxel format has this extension.
    pub fn of(path: &Path) -> Result<Self, SceneError> {
        by_ending(
            path,
            Self::ALL.map(|format| (format, format.ending())),
            "voxels",
        )
    }

    /// Returns whether a file in image colours differs from one in label colours.
    #[must_use]
    pub fn has_twin(self) -> bool {
        self != Self::Vox
    }

    /// Writes voxels with edge length `voxel` (world units) to `path`.
    ///
    /// The previous file is left intact if the job is stopped or fails.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Io`] if the file cannot be written. Returns [`SceneError::Request`] if
    /// the format cannot hold the voxels. Returns [`SceneError::Stopped`] if the job is stopped.
    pub fn save(
        self,
        path: &Path,
        voxels: &LabelledCloud,
        voxel: f64,
        coloring: SavedColors,
        progress: &Progress,
    ) -> Result<(), SceneError> {
        match self {
            Self::Ply => save_ply(path, voxels, coloring, progress),
            Self::Npz => npz::save(path, voxels, voxel, coloring, progress),
            Self::Vox => vox::save(path, voxels, voxel, progress),
        }
    }
}

/// Returns endings in words, each with its dot.
fn endings<const N: usize>(names: [&str; N]) -> String {
    in_words(names.map(|name| format!(".{name}")), "or")
}

/// Returns the entry of `known` whose extension matches that of `path`.
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
        let what = format!(
            "{what} cannot be written under this ending; give a name that ends in {}",
            endings(known.map(|(_, name)| name))
        );
        SceneError::Invalid {
            path: path.to_path_buf(),
            what,
        }
    })
}

/// Returns the path that [`save_origin`] writes to.
///
/// It is derived from the whole file name, because a cloud and a mesh with the same stem have
/// separate origin files.
#[must_use]
pub fn origin_path(path: &Path) -> PathBuf {
    path.with_file_name(format!(
        "{}.origin.json",
        path.file_name().unwrap_or_default().to_string_lossy()
    ))
}

/// Writes `NAME.origin.json` next to a file whose positions are relative to a non-zero origin.
///
/// Returns a note for the user, if there is one. LAS, LAZ and NPZ files already hold global
/// coordinates; for them the file says so and no note is returned.
///
/// # Errors
///
/// Returns [`SceneError::Io`] if the file cannot be written.
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
    let adjacent = origin_path(path);
    let value = serde_json::json!({ "origin": origin.to_array(), "positions": positions });
    write_whole(&adjacent, |out| {
        writeln!(out, "{value:#}").map_err(unplaced)
    })?;
    let DVec3 { x, y, z } = origin;
    Ok((!is_global).then(|| {
        format!(
            "{}: the origin is {x} {y} {z}, as {} says; positions are {positions}",
            path.display(),
            adjacent.display()
        )
    }))
}
