//! The file manager of the system.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use ostra_core::programs::{ChildProcess, command};

/// Program that opens a folder in the file manager.
const PROGRAM: &str = if cfg!(windows) {
    "explorer"
} else if cfg!(target_os = "macos") {
    "open"
} else {
    "xdg-open"
};

/// Opens a folder in the file manager, without waiting for it.
///
/// # Errors
///
/// Returns an error if there is no such folder or no program to open it.
pub(super) fn open_folder(folder: &Path) -> Result<()> {
    ensure!(
        folder.is_dir(),
        "{}: the folder is gone; export again",
        folder.display()
    );
    // An absolute path never begins with a dash, which a program would read as an option.
    let path = std::path::absolute(folder)?;
    let start = || ChildProcess::spawn(command(PROGRAM)?.arg(&path));
    let child = start().with_context(|| {
        format!(
            "{}: '{PROGRAM}' cannot be started; open the folder yourself",
            folder.display()
        )
    })?;
    // Some systems start the file manager as a child that lives as long as its window.
    std::thread::spawn(move || child.wait());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_folder_is_named() {
        let error = open_folder(Path::new("/nowhere/rice-export")).unwrap_err();
        assert!(
            error.to_string().contains("/nowhere/rice-export"),
            "{error}"
        );
    }
}
