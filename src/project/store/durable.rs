use std::fs::{self, File};
use std::path::Path;

use anyhow::{Context, Result};

use ostra_core::disk;

/// Replaces the file's content by `bytes`, and creates its folder if it is missing.
///
/// See [`disk::write`].
///
/// # Errors
///
/// Returns an error if the file cannot be written. It then keeps its old content.
pub fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
        .unwrap_or(Path::new("."));
    make_folder(folder)?;
    disk::write(path, bytes).with_context(|| cannot_write(path))
}

/// Creates a folder and its parents.
///
/// # Errors
///
/// Returns an error if it cannot be created.
pub fn make_folder(folder: &Path) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| cannot_write(folder))
}

/// Makes renames and removals in a folder durable, on systems that support it.
///
/// # Errors
///
/// Returns an error if the system call fails.
pub fn sync_folder(folder: &Path) -> Result<()> {
    #[cfg(unix)]
    File::open(folder)
        .and_then(|folder| folder.sync_all())
        .with_context(|| cannot_write(folder))?;
    #[cfg(not(unix))]
    let _ = folder;
    Ok(())
}

/// Returns the one-line message for a file that cannot be written.
pub fn cannot_write(path: &Path) -> String {
    format!(
        "{}: cannot be written; check permissions and free space",
        path.display()
    )
}

/// Folders of a project that hold only its own files.
pub const OWN_FOLDERS: [&str; 5] = ["masks", "depths", "sparse", "versions", "cache"];

/// Files of a project directly in its folder.
pub const OWN_FILES: [&str; 8] = [
    "project.toml",
    "journal.jsonl",
    "history.jsonl",
    "recipe.jsonl",
    ".lock",
    "cloud.ply",
    "votes.bin",
    "mesh.ply",
];

/// Removes the temporary files that killed runs left in a project's folder.
///
/// The project's lock must be held, so that no other process is writing there.
pub fn remove_leftovers(root: &Path) {
    disk::remove_leftovers(root, false);
    for name in OWN_FILES {
        // Earlier versions of the program wrote under this name.
        remove_file_or_link(&root.join(format!("{name}.tmp")));
    }
    for name in OWN_FOLDERS {
        let folder = root.join(name);
        disk::remove_leftovers(&folder, true);
        remove_former_leftovers(&folder);
    }
}

/// Removes the temporary files that earlier versions of the program left.
///
/// These are `NAME.PID.tmp`, `NAME.tmp` and `.NAME.part`, in folders that hold no other files with
/// such names.
fn remove_former_leftovers(folder: &Path) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        let path = entry.path();
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            remove_former_leftovers(&path);
        } else if path
            .extension()
            .is_some_and(|ending| ending == "tmp" || ending == "part")
            && !disk::is_temporary(&entry.file_name())
        {
            remove_file_or_link(&path);
        }
    }
}

fn remove_file_or_link(path: &Path) {
    let is_ours = |found: &fs::Metadata| found.is_file() || found.is_symlink();
    if fs::symlink_metadata(path).is_ok_and(|found| is_ours(&found)) {
        // A leftover that cannot be removed does no harm.
        let _ = fs::remove_file(path);
    }
}
