//! Files of results, kept under a number for as long as the project or its history refers to them, so that undo
//! brings an earlier result back. The one in force also stands under its plain name.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::durable;
use crate::session::{Edit, History, Project, ResultKind};

/// Results that have files of their own.
const KINDS: [ResultKind; 2] = [ResultKind::Cloud, ResultKind::Cameras];

/// Plain name, and what stands before and after the number under `versions/`.
const FILES: [(&str, &str, &str); 2] = [("cloud.ply", "cloud-", ".ply"), ("votes.bin", "votes-", ".bin")];

/// What stands before the number of a sparse model's folder.
const SPARSE: &str = "sparse-";

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

/// Where a version of the sparse model lies: a folder with a COLMAP text model.
pub fn sparse_path(root: &Path, version: u64) -> PathBuf {
    root.join(format!("versions/{SPARSE}{version}"))
}

/// A number that neither a file nor the project nor its history has; makes the folder.
///
/// # Errors
/// When the folder cannot be made or read.
pub fn next(root: &Path, project: &Project, history: &History) -> Result<u64> {
    durable::make_folder(&root.join("versions"))?;
    let on_disk = KINDS.iter().flat_map(|&kind| numbers(root, kind)).max();
    let named = KINDS.iter().flat_map(|&kind| referred(project, history, kind)).max();
    Ok(on_disk.max(named).unwrap_or(0) + 1)
}

/// Puts the files of the version in force (`None` = there is no result) under their plain names.
///
/// # Errors
/// When a file cannot be put in place.
pub fn publish(root: &Path, version: Option<u64>) -> Result<()> {
    let mut changed = false;
    for (plain, before, after) in FILES {
        let place = root.join(plain);
        let source = version.map(|version| root.join(format!("versions/{before}{version}{after}")));
        let put = match source.filter(|source| source.exists()) {
            Some(source) if is_same(&source, &place) => continue,
            Some(source) => link(&source, &place),
            None if place.exists() => fs::remove_file(&place),
            None => continue,
        };
        put.with_context(|| durable::cannot_write(&place))?;
        changed = true;
    }
    if changed { durable::sync_folder(root) } else { Ok(()) }
}

fn is_same(a: &Path, b: &Path) -> bool {
    let stamp = |path: &Path| fs::metadata(path).ok().map(|meta| (meta.len(), meta.modified().ok()));
    stamp(a).is_some_and(|a| Some(a) == stamp(b))
}

/// A second name for the file; where the disk knows none, a copy with the same time.
fn link(source: &Path, place: &Path) -> std::io::Result<()> {
    let temporary = durable::temporary(place);
    let _ = fs::remove_file(&temporary);
    if fs::hard_link(source, &temporary).is_err() {
        fs::copy(source, &temporary)?;
        let copy = fs::OpenOptions::new().write(true).open(&temporary)?;
        copy.set_modified(fs::metadata(source)?.modified()?)?;
        copy.sync_all()?;
    }
    fs::rename(&temporary, place)
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
    let Some(&newest) = referred.last() else { return };
    let in_force = version_in_force(project, kind);
    let too_old = referred.iter().rev().skip(KEPT + 1).copied().collect::<BTreeSet<_>>();
    for version in numbers(root, kind).into_iter().filter(|&version| version < newest && Some(version) != in_force) {
        if !referred.contains(&version) || too_old.contains(&version) {
            remove(root, version, kind);
        }
    }
}

fn remove(root: &Path, version: u64, kind: ResultKind) {
    if kind == ResultKind::Cameras {
        let _ = fs::remove_dir_all(sparse_path(root, version));
    } else {
        let _ = fs::remove_file(cloud_path(root, version));
        let _ = fs::remove_file(votes_path(root, version));
    }
}

/// The version of a result's files that the project has now.
pub fn version_in_force(project: &Project, kind: ResultKind) -> Option<u64> {
    project.results.get(&kind).map(|record| record.version).filter(|&version| version > 0)
}

fn referred(project: &Project, history: &History, kind: ResultKind) -> BTreeSet<u64> {
    let of_edit = |edit: &Edit| match edit {
        Edit::SetResult { kind: of, record: Some(record) } if *of == kind => Some(record.version),
        _ => None,
    };
    let (steps, _) = history.steps();
    let changes = steps.flat_map(|step| &step.changes).flat_map(|change| [&change.edit, &change.inverse]);
    let named = changes.filter_map(of_edit).chain(version_in_force(project, kind));
    named.filter(|&version| version > 0).collect()
}

fn numbers(root: &Path, kind: ResultKind) -> BTreeSet<u64> {
    let Ok(entries) = fs::read_dir(root.join("versions")) else { return BTreeSet::new() };
    let number = |name: &str| match kind {
        ResultKind::Cameras => name.strip_prefix(SPARSE)?.parse().ok(),
        _ => FILES.iter().find_map(|(_, before, after)| name.strip_prefix(before)?.strip_suffix(after)?.parse().ok()),
    };
    entries.flatten().filter_map(|entry| number(entry.file_name().to_str()?)).collect()
}
