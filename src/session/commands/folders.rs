use std::path::Path;

use anyhow::{Context, Result};

/// Makes the folder that a file shall be written into.
pub fn make_folder_of(file: &Path) -> Result<()> {
    let Some(folder) = file
        .parent()
        .filter(|folder| !folder.as_os_str().is_empty())
    else {
        return Ok(());
    };
    std::fs::create_dir_all(folder)
        .with_context(|| format!("{}: cannot be made; check permissions", folder.display()))
}
