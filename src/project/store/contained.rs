//! Protection against links that lead out of a project's folder.
//!
//! A project from elsewhere may contain links. None of its files is read or written through a link
//! that leaves the folder.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::durable::{OWN_FILES, OWN_FOLDERS};

/// Checks that the project's own files and folders do not lead out of its folder.
///
/// Links that lead out of the folder or nowhere are rejected, as are pipes and devices, because
/// reading from these would block. Other files in the folder do not belong to the project.
///
/// # Errors
///
/// Returns an error if a file or folder is rejected. The message names it and says what to do.
pub fn check(root: &Path) -> Result<()> {
    if !root.exists() {
        return Ok(());
    }
    let home = root
        .canonicalize()
        .with_context(|| format!("{}: cannot be read", root.display()))?;
    let mut walk = FolderWalk {
        home: &home,
        root,
        seen: BTreeSet::new(),
    };
    OWN_FILES
        .iter()
        .chain(&OWN_FOLDERS)
        .try_for_each(|name| walk.check(&home.join(name)))
}

struct FolderWalk<'a> {
    /// The folder, without links in its path.
    home: &'a Path,
    /// The folder as the user named it.
    root: &'a Path,
    /// Folders already visited, because links inside the project may form cycles.
    seen: BTreeSet<PathBuf>,
}

impl FolderWalk<'_> {
    /// Checks a file or folder whose parent path has no links.
    fn check(&mut self, path: &Path) -> Result<()> {
        let Ok(found) = fs::symlink_metadata(path) else {
            return Ok(());
        };
        let shown = || {
            self.root
                .join(path.strip_prefix(self.home).unwrap_or(path))
                .display()
                .to_string()
        };
        if found.is_symlink() {
            let named = fs::read_link(path).unwrap_or_default();
            let Ok(target) = path.canonicalize() else {
                bail!(
                    "{}: is a link to {}, which cannot be followed; remove the link",
                    shown(),
                    named.display()
                );
            };
            ensure!(
                target.starts_with(self.home),
                "{}: is a link that leads out of the project's folder, to {}; replace it by a copy of what it leads to, \
                 or remove it",
                shown(),
                target.display()
            );
            return self.check(&target);
        }
        if found.is_dir() {
            if self.seen.insert(path.to_owned()) {
                let entries =
                    fs::read_dir(path).with_context(|| format!("{}: cannot be read", shown()))?;
                entries
                    .flatten()
                    .try_for_each(|entry| self.check(&entry.path()))?;
            }
            return Ok(());
        }
        ensure!(
            found.is_file(),
            "{}: is neither a file nor a folder (a pipe, socket or device); remove it",
            shown()
        );
        Ok(())
    }
}
