//! Files of results, kept under a number for as long as the project or its history refers to them, so that undo
//! brings an earlier result back. The one in force also stands under its plain name.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::durable;
use crate::{Edit, History, Project, ResultKind};
use ostra_core::disk;
use ostra_frames::{DepthSource, Frame};

/// Results that have files of their own.
const KINDS: [ResultKind; 3] = [ResultKind::Cloud, ResultKind::Cameras, ResultKind::Depths];

/// Plain name of what is published, and what stands before and after the number under `versions/`.
const FILES: [(&str, &str, &str); 3] = [
    ("cloud.ply", "cloud-", ".ply"),
    ("votes.bin", "votes-", ".bin"),
    ("mesh.ply", "mesh-", ".ply"),
];

/// What stands before the number of a sparse model's folder, and of one with depth maps.
const SPARSE: &str = "sparse-";
const DEPTHS: &str = "depths-";

/// Earlier results of a kind beyond this many are not kept.
const KEPT: usize = 4;

/// Where a version of the labelled cloud lies.
pub fn cloud_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/cloud-{version}.ply"))
}

/// Where a version of the cloud's votes lies.
pub fn votes_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/votes-{version}.bin"))
}

/// Where the surface of a version of the labelled cloud lies; not every version has one.
pub fn mesh_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/mesh-{version}.ply"))
}

/// Where the votes on that surface's vertices lie, where they may be asked again.
pub fn mesh_votes_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/surface-votes-{version}.bin"))
}

/// Where features and matches are kept from one reconstruction to the next. No result: it may be deleted at any time.
pub fn feature_cache_path(root: &Path) -> PathBuf {
    root.join("cache")
}

/// Where a version of the sparse model lies: a folder with a COLMAP text model.
pub fn sparse_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/{SPARSE}{version}"))
}

/// Where a version of the depth maps lies, below the project's folder: a folder with a file per frame.
pub(super) fn depths_path(version: u64) -> PathBuf {
    PathBuf::from(format!("versions/{DEPTHS}{version}"))
}

/// A number that neither a file nor the project nor its history has; makes the folder.
///
/// # Errors
/// When the folder cannot be made or read.
pub fn next(root: &Path, project: &Project, history: &History) -> Result<u64> {
    durable::make_folder(&root.join("versions"))?;
    let on_disk = KINDS.iter().flat_map(|&kind| numbers(root, kind)).max();
    let named = KINDS
        .iter()
        .flat_map(|&kind| referred(project, history, kind))
        .max();
    Ok(on_disk.max(named).unwrap_or(0) + 1)
}

/// Puts the cloud's files of the version in force (`None` = there is no cloud) under their plain names.
///
/// # Errors
/// When a file cannot be put in place.
pub fn publish_cloud(root: &Path, version: Option<u64>) -> Result<()> {
    let mut changed = false;
    for (plain, before, after) in FILES {
        let place = root.join(plain);
        let source = version.map(|version| root.join(format!("versions/{before}{version}{after}")));
        let put = match source.filter(|source| source.exists()) {
            Some(source) if is_same(&source, &place) => continue,
            Some(source) => disk::link(&source, &place),
            None if place.exists() => fs::remove_file(&place),
            None => continue,
        };
        put.with_context(|| durable::cannot_write(&place))?;
        changed = true;
    }
    if changed {
        durable::sync_folder(root)
    } else {
        Ok(())
    }
}

/// Gives the mesh of one version to another one, as it is.
///
/// # Errors
/// When the file cannot be put in place, or is gone.
pub fn keep_mesh(root: &Path, from: u64, to: u64) -> Result<()> {
    let place = mesh_path(root, to);
    disk::link(&mesh_path(root, from), &place).with_context(|| durable::cannot_write(&place))
}

/// Gives the votes on the cloud and the surface of one version to another one, as they are; those that are not kept are
/// left out.
///
/// # Errors
/// When a file cannot be put in place.
pub fn keep_votes(root: &Path, from: u64, to: u64) -> Result<()> {
    for votes in [votes_path, mesh_votes_path] {
        let (source, place) = (votes(root, from), votes(root, to));
        if source.exists() {
            disk::link(&source, &place).with_context(|| durable::cannot_write(&place))?;
        }
    }
    Ok(())
}

/// Puts the depth maps that frames have now under `depths/`, by the frames' names, and takes away those that it put there
/// before. Other files in that folder are left alone.
///
/// # Errors
/// When a file cannot be put in place.
pub fn publish_depths(root: &Path, frames: &[Frame]) -> Result<()> {
    let folder = root.join("depths");
    let made = |frame: &Frame| match &frame.depth {
        Some(DepthSource::Made { made, .. }) => Some((depth_file(&frame.name), root.join(made))),
        _ => None,
    };
    let wanted: BTreeMap<String, PathBuf> = frames.iter().filter_map(made).collect();
    let maps: Vec<PathBuf> = depth_versions(root)
        .map(|version| root.join(depths_path(version)).join("maps"))
        .collect();
    for frame in frames {
        let name = depth_file(&frame.name);
        let place = folder.join(&name);
        if !wanted.contains_key(&name) && maps.iter().any(|maps| is_same(&maps.join(&name), &place))
        {
            fs::remove_file(&place).with_context(|| durable::cannot_write(&place))?;
        }
    }
    for (name, source) in wanted {
        let place = folder.join(name);
        if source.exists() && !is_same(&source, &place) {
            durable::make_folder(place.parent().unwrap_or(&folder))?;
            disk::link(&source, &place).with_context(|| durable::cannot_write(&place))?;
        }
    }
    Ok(())
}

/// The numbers of all folders with depth maps, the newest first.
pub fn depth_versions(root: &Path) -> impl Iterator<Item = u64> {
    numbers(root, ResultKind::Depths).into_iter().rev()
}

/// The file of a frame's depth map, below the folder of all.
pub(super) fn depth_file(frame: &str) -> String {
    format!("{frame}.tiff")
}

fn is_same(a: &Path, b: &Path) -> bool {
    let stamp = |path: &Path| {
        fs::metadata(path)
            .ok()
            .map(|meta| (meta.len(), meta.modified().ok()))
    };
    stamp(a).is_some_and(|a| Some(a) == stamp(b))
}

/// Takes away versions that nothing refers to, and the oldest beyond a few. Numbers above all that are referred to
/// may be in the making and are left alone.
pub fn collect(root: &Path, project: &Project, history: &History) {
    for kind in KINDS {
        collect_kind(root, project, history, kind);
    }
}

fn collect_kind(root: &Path, project: &Project, history: &History, kind: ResultKind) {
    let referred = referred(project, history, kind);
    let Some(&newest) = referred.last() else {
        return;
    };
    let in_force = version_in_force(project, kind);
    let too_old = referred
        .iter()
        .rev()
        .skip(KEPT + 1)
        .copied()
        .collect::<BTreeSet<_>>();
    for version in numbers(root, kind)
        .into_iter()
        .filter(|&version| version < newest && Some(version) != in_force)
    {
        if !referred.contains(&version) || too_old.contains(&version) {
            remove(root, version, kind);
        }
    }
}

fn remove(root: &Path, version: u64, kind: ResultKind) {
    match kind {
        ResultKind::Cameras => drop(fs::remove_dir_all(sparse_path(root, version))),
        ResultKind::Depths => drop(fs::remove_dir_all(root.join(depths_path(version)))),
        ResultKind::Cloud | ResultKind::Tracking => {
            let _ = fs::remove_file(cloud_path(root, version));
            let _ = fs::remove_file(votes_path(root, version));
            let _ = fs::remove_file(mesh_path(root, version));
            let _ = fs::remove_file(mesh_votes_path(root, version));
        }
    }
}

/// The version of a result's files that the project has now.
pub fn version_in_force(project: &Project, kind: ResultKind) -> Option<u64> {
    project
        .results
        .get(&kind)
        .map(|record| record.version)
        .filter(|&version| version > 0)
}

fn referred(project: &Project, history: &History, kind: ResultKind) -> BTreeSet<u64> {
    let of_depth = |depth: &Option<DepthSource>| match depth {
        Some(DepthSource::Made { made, .. }) if kind == ResultKind::Depths => made
            .iter()
            .nth(1)?
            .to_str()?
            .strip_prefix(DEPTHS)?
            .parse()
            .ok(),
        _ => None,
    };
    let of_edit = |edit: &Edit| match edit {
        Edit::SetResult {
            kind: of,
            record: Some(record),
        } if *of == kind => Some(record.version),
        Edit::SetDepth { depth, .. } => of_depth(depth),
        Edit::SetFrame { value, .. } => of_depth(&value.depth),
        _ => None,
    };
    let (steps, _) = history.steps();
    let changes = steps
        .flat_map(|step| &step.changes)
        .flat_map(|change| [&change.edit, &change.inverse]);
    let now = project
        .frames
        .iter()
        .filter_map(|frame| of_depth(&frame.depth));
    let named = changes
        .filter_map(of_edit)
        .chain(version_in_force(project, kind))
        .chain(now);
    named.filter(|&version| version > 0).collect()
}

fn numbers(root: &Path, kind: ResultKind) -> BTreeSet<u64> {
    let Ok(entries) = fs::read_dir(root.join("versions")) else {
        return BTreeSet::new();
    };
    let number = |name: &str| match kind {
        ResultKind::Cameras => name.strip_prefix(SPARSE)?.parse().ok(),
        ResultKind::Depths => name.strip_prefix(DEPTHS)?.parse().ok(),
        _ => FILES.iter().find_map(|(_, before, after)| {
            name.strip_prefix(before)?.strip_suffix(after)?.parse().ok()
        }),
    };
    entries
        .flatten()
        .filter_map(|entry| number(entry.file_name().to_str()?))
        .collect()
}
