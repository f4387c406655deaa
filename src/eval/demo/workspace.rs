//! The output folder of the demo; a demo replaces only what a demo made.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use serde::{Deserialize, Serialize};

use ostra_core::disk;
use ostra_project::export_record::{ExportClaim, is_being_written, lock_folder};
use ostra_project::export_record::{ExportFileState, ExportRecord, files_below};
use ostra_project::store::Lock;

/// File that marks a folder made by a demo.
const MARKER: &str = ".ostra-demo.json";

/// Names of everything that a demo makes in its folder.
const MADE: [&str; 8] = [
    "recording",
    "project",
    "truth",
    "cloud.ply",
    "cloud.classes.json",
    "mesh.ply",
    "shot.png",
    "report.json",
];

/// Content of [`MARKER`].
#[derive(Debug, Default, Serialize, Deserialize)]
struct Marker {
    /// State of the files at the end of the demo; absent while it runs.
    made: Option<ExportRecord>,
}

impl Marker {
    fn write(&self, out: &Path) -> Result<()> {
        let path = out.join(MARKER);
        disk::write(&path, &serde_json::to_vec_pretty(self)?).with_context(|| {
            format!(
                "{}: cannot be written; choose another folder for the demo",
                path.display()
            )
        })
    }
}

/// Prepares the folder for a demo and claims it.
///
/// Unchanged results of an earlier demo are removed. The results of an interrupted demo are moved
/// to `interrupted-N`. No other demo can use the folder until the claim is dropped.
///
/// # Errors
/// Returns an error if the folder holds files that no demo made, if files of an earlier demo have
/// changed, or if another demo uses the folder.
pub fn prepare(out: &Path) -> Result<ExportClaim> {
    let is_empty = fs::read_dir(out).map_or(true, |mut entries| entries.next().is_none());
    if is_empty {
        fs::create_dir_all(out).with_context(|| {
            format!(
                "{}: cannot be made; choose another folder for the demo",
                out.display()
            )
        })?;
        let claim = claim(out)?;
        Marker::default().write(out)?;
        return Ok(claim);
    }
    let Ok(bytes) = disk::read_regular(&out.join(MARKER)) else {
        bail!(
            "{}: is not empty and was not made by a demo; choose a new or empty folder",
            out.display()
        );
    };
    let claim = claim(out)?;
    let project = out.join("project");
    // Held while the files are removed, so that no other process has the project open.
    let lock = project
        .join("project.toml")
        .is_file()
        .then(|| Lock::take(&project))
        .transpose()?;
    match serde_json::from_slice::<Marker>(&bytes)
        .unwrap_or_default()
        .made
    {
        Some(record) => remove_unchanged(out, &record)?,
        None => set_aside(out)?,
    }
    drop(lock);
    Marker::default().write(out)?;
    Ok(claim)
}

/// Claims the folder against other demos; the demo itself exports into it.
fn claim(out: &Path) -> Result<ExportClaim> {
    let _locked = lock_folder(out)?;
    ensure!(
        !is_being_written(out, MADE[0]),
        "{}: another demo runs there; choose another folder",
        out.display()
    );
    ExportClaim::take(out, &[MADE[0].to_owned()])
}

/// Records what the demo made; call it when everything is written and the project is closed.
///
/// # Errors
/// Returns an error if the folder cannot be read or written.
pub fn finish(out: &Path) -> Result<()> {
    let mut record = ExportRecord::default();
    made_files(out)?
        .iter()
        .for_each(|file| record.add(out, file));
    Marker { made: Some(record) }.write(out)
}

/// Returns all files of a demo except the project lock, which changes when the project is opened.
fn made_files(out: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for place in MADE.map(|name| out.join(name)) {
        let Ok(found) = fs::symlink_metadata(&place) else {
            continue;
        };
        if found.is_dir() {
            files.extend(
                files_below(&place)?
                    .into_iter()
                    .filter(|file| !file.ends_with("project/.lock")),
            );
        } else {
            files.push(place);
        }
    }
    Ok(files)
}

fn remove_unchanged(out: &Path, record: &ExportRecord) -> Result<()> {
    let kept = made_files(out)?
        .into_iter()
        .find(|file| record.state_of(out, file) != Some(ExportFileState::Unchanged));
    if let Some(file) = kept {
        bail!(
            "{}: was changed or added after the demo that made {}; choose another folder, or remove this one first",
            file.display(),
            out.display()
        );
    }
    for place in MADE.map(|name| out.join(name)) {
        let removed = match fs::symlink_metadata(&place) {
            Ok(found) if found.is_dir() => fs::remove_dir_all(&place),
            Ok(_) => fs::remove_file(&place),
            Err(_) => Ok(()),
        };
        removed.with_context(|| {
            format!("{}: cannot be removed; check permissions", place.display())
        })?;
    }
    Ok(())
}

fn set_aside(out: &Path) -> Result<()> {
    let found: Vec<&str> = MADE
        .into_iter()
        .filter(|name| fs::symlink_metadata(out.join(name)).is_ok())
        .collect();
    if found.is_empty() {
        return Ok(());
    }
    let Some(aside) = (1..)
        .map(|number| out.join(format!("interrupted-{number}")))
        .find(|place| !place.exists())
    else {
        return Ok(());
    };
    let cannot = || {
        format!(
            "{}: cannot be made; choose another folder for the demo",
            aside.display()
        )
    };
    fs::create_dir(&aside).with_context(cannot)?;
    found
        .into_iter()
        .try_for_each(|name| fs::rename(out.join(name), aside.join(name)))
        .with_context(cannot)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(out: &Path, name: &str) {
        fs::create_dir_all(out.join(name).parent().unwrap()).unwrap();
        fs::write(out.join(name), name).unwrap();
    }

    #[test]
    fn demo_replaces_only_its_own_unchanged_files() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("OUT");
        prepare(&out).unwrap();
        put(&out, "project/project.toml");
        put(&out, "recording/color/0.png");
        finish(&out).unwrap();
        put(&out, "notes.txt");
        put(&out, "project/.lock");
        prepare(&out).unwrap();
        assert!(out.join("notes.txt").exists() && !out.join("project").exists());
        put(&out, "project/project.toml");
        finish(&out).unwrap();
        put(&out, "project/thesis.tex");
        assert!(
            prepare(&out)
                .unwrap_err()
                .to_string()
                .contains("thesis.tex")
        );
        fs::remove_file(out.join("project/thesis.tex")).unwrap();
        fs::write(out.join("project/project.toml"), "edited").unwrap();
        assert!(prepare(&out).is_err());
    }

    #[test]
    fn demo_with_an_open_project_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        prepare(dir.path()).unwrap();
        put(dir.path(), "project/project.toml");
        finish(dir.path()).unwrap();
        let lock = Lock::take(&dir.path().join("project")).unwrap();
        assert!(
            prepare(dir.path())
                .unwrap_err()
                .to_string()
                .contains("is open in another window")
        );
        assert!(dir.path().join("project/project.toml").is_file());
        drop(lock);
        prepare(dir.path()).unwrap();
        assert!(!dir.path().join("project").exists());
    }

    #[test]
    fn two_demos_do_not_share_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        let running = prepare(dir.path()).unwrap();
        put(dir.path(), "recording/color/0.png");
        assert!(
            prepare(dir.path())
                .unwrap_err()
                .to_string()
                .contains("another demo runs there")
        );
        assert!(dir.path().join("recording/color/0.png").is_file());
        drop(running);
        prepare(dir.path()).unwrap();
    }

    #[test]
    fn results_of_an_interrupted_demo_are_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        prepare(dir.path()).unwrap();
        put(dir.path(), "project/project.toml");
        prepare(dir.path()).unwrap();
        assert!(
            dir.path()
                .join("interrupted-1/project/project.toml")
                .is_file()
        );
    }

    #[test]
    fn folders_not_made_by_a_demo_are_rejected() {
        let dir = tempfile::tempdir().unwrap();
        put(dir.path(), "recording/day1.bag");
        put(dir.path(), "report.json");
        assert!(
            prepare(dir.path())
                .unwrap_err()
                .to_string()
                .contains("not made by a demo")
        );
        assert!(dir.path().join("recording/day1.bag").exists());
    }
}
