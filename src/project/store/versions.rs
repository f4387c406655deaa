//! Numbered files of results.
//!
//! They are kept as long as the project or its history refers to them, so that undo restores an
//! earlier result. The current version is also published under its plain name.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::durable;
use crate::{Edit, History, Project, ResultKind, ResultRecord};
use ostra_core::disk;
use ostra_frames::{DepthSource, Frame};

/// Kinds of results that have files of their own.
const KINDS: [ResultKind; 3] = [ResultKind::Cloud, ResultKind::Cameras, ResultKind::Depths];

/// Plain name of each published file, and the prefix and suffix of its number under `versions/`.
const FILES: [(&str, &str, &str); 3] = [
    ("cloud.ply", "cloud-", ".ply"),
    ("votes.bin", "votes-", ".bin"),
    ("mesh.ply", "mesh-", ".ply"),
];

/// Prefixes of the folders of sparse models and of depth maps.
const SPARSE: &str = "sparse-";
const DEPTHS: &str = "depths-";

/// Maximum number of earlier results of a kind that are kept.
const KEPT: usize = 4;

/// Returns the path of a version of the labelled cloud.
pub fn cloud_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/cloud-{version}.ply"))
}

/// Returns the path of a version of the cloud's votes.
pub fn votes_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/votes-{version}.bin"))
}

/// Returns the path of the surface of a version of the cloud; not every version has one.
pub fn mesh_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/mesh-{version}.ply"))
}

/// Returns the path of the votes on the vertices of that surface, which exist if it can vote again.
pub fn mesh_votes_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/surface-votes-{version}.bin"))
}

/// Returns the folder of the cache of features and matches, which may be deleted at any time.
pub fn feature_cache_path(root: &Path) -> PathBuf {
    root.join("cache")
}

/// Returns the folder of a version of the sparse model, which is a COLMAP text model.
pub fn sparse_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/{SPARSE}{version}"))
}

/// Returns the folder of a version of the depth maps, relative to the project's folder.
///
/// It holds one file per frame.
pub(super) fn depths_path(version: u64) -> PathBuf {
    PathBuf::from(format!("versions/{DEPTHS}{version}"))
}

/// Returns a number not used by any file, the project or its history, and creates the folder.
///
/// # Errors
///
/// Returns an error if the folder cannot be created or read.
pub fn next(root: &Path, project: &Project, history: &History) -> Result<u64> {
    durable::make_folder(&root.join("versions"))?;
    let on_disk = KINDS.iter().flat_map(|&kind| numbers(root, kind)).max();
    let named = KINDS
        .iter()
        .flat_map(|&kind| referred(project, history, kind).into_keys())
        .max();
    Ok(on_disk.max(named).unwrap_or(0) + 1)
}

/// Publishes the cloud's files of the current version under their plain names.
///
/// `None` means that there is no cloud.
///
/// # Errors
///
/// Returns an error if a file cannot be put in place.
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

/// Gives the mesh of one version to another version, unchanged.
///
/// # Errors
///
/// Returns an error if the file is missing or cannot be put in place.
pub fn keep_mesh(root: &Path, from: u64, to: u64) -> Result<()> {
    let place = mesh_path(root, to);
    disk::link(&mesh_path(root, from), &place).with_context(|| durable::cannot_write(&place))
}

/// Gives the votes on the cloud and the surface of one version to another version, unchanged.
///
/// Votes that do not exist are skipped.
///
/// # Errors
///
/// Returns an error if a file cannot be put in place.
pub fn keep_votes(root: &Path, from: u64, to: u64) -> Result<()> {
    for votes in [votes_path, mesh_votes_path] {
        let (source, place) = (votes(root, from), votes(root, to));
        if source.exists() {
            disk::link(&source, &place).with_context(|| durable::cannot_write(&place))?;
        }
    }
    Ok(())
}

/// Publishes the frames' current depth maps under `depths/`, by the frames' names.
///
/// Depth maps that were published there before are removed. Other files in that folder are left
/// alone.
///
/// # Errors
///
/// Returns an error if a file cannot be put in place.
pub fn publish_depths(root: &Path, frames: &[Frame]) -> Result<()> {
    let folder = root.join("depths");
    let made = |frame: &Frame| match &frame.depth {
        Some(DepthSource::Estimated { made, .. }) => {
            Some((depth_file(&frame.name), root.join(made)))
        }
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

/// Returns the numbers of all folders with depth maps, the newest first.
pub fn depth_versions(root: &Path) -> impl Iterator<Item = u64> {
    numbers(root, ResultKind::Depths).into_iter().rev()
}

/// Returns the file name of a frame's depth map, relative to the folder of the maps.
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

/// Removes versions that nothing refers to, and the oldest of the others if there are many.
///
/// Numbers above all referenced ones may belong to results in progress and are left alone.
pub fn collect(root: &Path, project: &Project, history: &History) {
    for kind in KINDS {
        collect_kind(root, project, history, kind);
    }
}

fn collect_kind(root: &Path, project: &Project, history: &History, kind: ResultKind) {
    let referred = referred(project, history, kind);
    let Some(&newest) = referred.keys().last() else {
        return;
    };
    let in_force = project.results.get(&kind).map(versions_of);
    let in_force = in_force.unwrap_or_default();
    let runs: BTreeSet<u64> = referred.values().copied().collect();
    let kept: BTreeSet<u64> = runs.into_iter().rev().take(KEPT + 1).collect();
    for version in numbers(root, kind)
        .into_iter()
        .filter(|version| *version < newest && !in_force.contains(version))
    {
        if !referred.get(&version).is_some_and(|run| kept.contains(run)) {
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

/// Returns the version of a result's files that the project currently uses.
pub fn version_in_force(project: &Project, kind: ResultKind) -> Option<u64> {
    project
        .results
        .get(&kind)
        .map(|record| record.version)
        .filter(|&version| version > 0)
}

/// Returns the versions of a record: its own and, for cameras, those of all models.
fn versions_of(record: &ResultRecord) -> BTreeSet<u64> {
    let models = record.models.iter().map(|model| model.version);
    models
        .chain([record.version])
        .filter(|&version| version > 0)
        .collect()
}

/// Returns the versions that the project or its history refers to, each with its run.
///
/// The models of one reconstruction are one run, whose number is the highest of their versions.
fn referred(project: &Project, history: &History, kind: ResultKind) -> BTreeMap<u64, u64> {
    let of_depth = |depth: &Option<DepthSource>| match depth {
        Some(DepthSource::Estimated { made, .. }) if kind == ResultKind::Depths => made
            .iter()
            .nth(1)?
            .to_str()?
            .strip_prefix(DEPTHS)?
            .parse::<u64>()
            .ok(),
        _ => None,
    };
    let of_edit = |edit: &Edit| match edit {
        Edit::SetResult {
            kind: of,
            record: Some(record),
        } if *of == kind => versions_of(record),
        Edit::SetDepth { depth, .. } => of_depth(depth).into_iter().collect(),
        Edit::SetFrame { value, .. } => of_depth(&value.depth).into_iter().collect(),
        _ => BTreeSet::new(),
    };
    let (steps, _) = history.steps();
    let changes = steps
        .flat_map(|step| &step.changes)
        .flat_map(|change| [&change.edit, &change.inverse]);
    let frames = project.frames.iter();
    let now = frames.filter_map(|frame| of_depth(&frame.depth).map(|version| [version].into()));
    let named = changes
        .map(of_edit)
        .chain(project.results.get(&kind).map(versions_of))
        .chain(now);
    let mut runs: BTreeMap<u64, u64> = BTreeMap::new();
    for versions in named {
        let run = versions.last().copied().unwrap_or(0);
        for version in versions.into_iter().filter(|&version| version > 0) {
            let known = runs.entry(version).or_insert(run);
            *known = run.max(*known);
        }
    }
    runs
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::testing::record;
    use crate::{Change, Coordinates, SparseModelRecord, Step};

    /// Returns the record of cameras with models of these versions, of which the first is used.
    fn cameras(versions: &[u64]) -> ResultRecord {
        let model = |&version: &u64| SparseModelRecord {
            version,
            frames: 3,
            points: 60,
            settings: String::new(),
            coordinates: Coordinates::chosen_with(version, false),
            scaled: None,
        };
        ResultRecord {
            version: versions[0],
            models: versions.iter().map(model).collect(),
            ..record("sfm")
        }
    }

    #[test]
    fn all_models_of_the_latest_runs_are_kept() {
        let root = tempfile::tempdir().unwrap();
        for version in 1..=30 {
            fs::create_dir_all(sparse_path(root.path(), version)).unwrap();
        }
        // Eight runs of three models, and versions that nothing refers to.
        let runs: Vec<[u64; 3]> = (0..8).map(|run| [1, 2, 3].map(|k| 3 * run + k)).collect();
        let edit = |versions: &[u64; 3]| Edit::SetResult {
            kind: ResultKind::Cameras,
            record: Some(cameras(versions)),
        };
        let mut history = History::default();
        for run in &runs {
            let (edit, inverse) = (edit(run), edit(run));
            history.push(Step {
                title: "Reconstruct".into(),
                changes: vec![Change { edit, inverse }],
            });
        }
        let kept = |project: &Project, history: &History| {
            collect(root.path(), project, history);
            numbers(root.path(), ResultKind::Cameras)
                .into_iter()
                .collect::<Vec<u64>>()
        };
        let mut project = Project {
            frames: Arc::default(),
            ..Project::default()
        };
        project
            .results
            .insert(ResultKind::Cameras, cameras(&runs[1]));
        // In force: 4 to 6. The latest five runs: 10 to 24. Later ones may be in progress.
        let expected: Vec<u64> = (4..=6).chain(10..=30).collect();
        assert_eq!(kept(&project, &history), expected);
        // Another model of a run is used, without a history of the others.
        let used = cameras(&runs[5]);
        let used = used.with_model(&used.models[1]);
        project.results.insert(ResultKind::Cameras, used);
        let expected: Vec<u64> = (16..=18).chain(19..=30).collect();
        assert_eq!(kept(&project, &History::default()), expected);
    }
}
