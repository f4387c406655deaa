use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::natural::natural_order;
use crate::frames::FrameError;

/// The endings of picture files, in lower case.
pub(super) const PICTURE_ENDINGS: [&str; 6] = ["jpg", "jpeg", "png", "tif", "tiff", "webp"];

/// A file below a folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Listed {
    /// Its path below the folder, with `/`.
    pub name: String,
    /// Its whole path.
    pub path: PathBuf,
}

/// The pictures in a folder and its subfolders in natural order; hidden files and folders are skipped.
pub(super) fn list_pictures(folder: &Path) -> Result<Vec<Listed>, FrameError> {
    let mut walk = Walk { pictures: Vec::new(), entered: BTreeSet::new() };
    walk.enter(folder, "")?;
    walk.pictures.sort_by(|a, b| natural_order(&a.name, &b.name));
    Ok(walk.pictures)
}

/// Whether a file name ends as pictures do.
pub(super) fn has_picture_ending(path: &Path) -> bool {
    let ending = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    ending.is_some_and(|ending| PICTURE_ENDINGS.contains(&ending.as_str()))
}

/// The path as text, since projects are text files.
pub(super) fn text_of(path: &Path) -> Result<&str, FrameError> {
    path.to_str().ok_or_else(|| FrameError::Invalid {
        path: path.into(),
        what: "the name has characters that are not valid UTF-8; rename it".into(),
    })
}

struct Walk {
    pictures: Vec<Listed>,
    entered: BTreeSet<PathBuf>,
}

impl Walk {
    fn enter(&mut self, folder: &Path, name: &str) -> Result<(), FrameError> {
        let io = |source| FrameError::io(folder, source);
        if !self.entered.insert(folder.canonicalize().map_err(io)?) {
            return Ok(()); // a link back to a folder that was read
        }
        for entry in std::fs::read_dir(folder).map_err(io)? {
            self.take(&entry.map_err(io)?, name)?;
        }
        Ok(())
    }

    fn take(&mut self, entry: &std::fs::DirEntry, folder_name: &str) -> Result<(), FrameError> {
        let (path, own_name) = (entry.path(), entry.file_name());
        if own_name.to_string_lossy().starts_with('.') {
            return Ok(());
        }
        let kind = entry.file_type().map_err(|source| FrameError::io(&path, source))?;
        let is_folder = kind.is_dir() || (kind.is_symlink() && path.is_dir());
        let is_picture = (kind.is_file() || kind.is_symlink()) && has_picture_ending(&path);
        if !is_folder && !is_picture {
            return Ok(());
        }
        text_of(&path)?;
        let own_name = own_name.to_string_lossy();
        let name = if folder_name.is_empty() { own_name.into_owned() } else { format!("{folder_name}/{own_name}") };
        if is_folder {
            return self.enter(&path, &name);
        }
        self.pictures.push(Listed { name, path });
        Ok(())
    }
}
