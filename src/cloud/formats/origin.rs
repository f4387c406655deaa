use std::io::Write;
use std::path::{Path, PathBuf};

use glam::DVec3;

use crate::SceneError;
use crate::whole_file::{unplaced, write_whole};

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
