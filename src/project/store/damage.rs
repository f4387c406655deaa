use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::durable;

/// A project file that cannot be used as it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Path of the file.
    pub path: PathBuf,
    /// Description of the damage and of what is lost; one line without the path.
    pub what: String,
    /// Whether the intact part stays in use, so that a copy is set aside instead of the file.
    pub is_in_use: bool,
}

impl Damage {
    /// Moves or copies the file to the first free of `NAME.damaged`, `NAME.damaged-2`, …
    ///
    /// Returns the warning for the user.
    ///
    /// # Errors
    ///
    /// Returns an error if the file cannot be moved or copied. It is then unchanged.
    pub fn set_aside(&self) -> Result<String> {
        let aside = free_name(&self.path);
        let put = if self.is_in_use {
            let bytes = fs::read(&self.path)
                .with_context(|| format!("{}: cannot be read", self.path.display()))?;
            durable::replace(&aside, &bytes)
        } else {
            fs::rename(&self.path, &aside).with_context(|| durable::cannot_write(&aside))
        };
        put?;
        let name = aside.file_name().unwrap_or_default().to_string_lossy();
        let kept = if self.is_in_use {
            "the whole file is kept as"
        } else {
            "the file is kept as"
        };
        Ok(format!(
            "{}: {}; {kept} {name}",
            self.path.display(),
            self.what
        ))
    }

    /// Returns the warning for a project that is open for viewing, where the file is left alone.
    pub fn warning(&self) -> String {
        format!(
            "{}: {}; nothing was changed",
            self.path.display(),
            self.what
        )
    }
}

/// Returns the first of `NAME.damaged`, `NAME.damaged-2`, … that does not exist.
fn free_name(path: &Path) -> PathBuf {
    let named = |ending: String| {
        let mut name = path.as_os_str().to_owned();
        name.push(ending);
        PathBuf::from(name)
    };
    let mut names = std::iter::once(".damaged".to_owned())
        .chain((2u64..).map(|n| format!(".damaged-{n}")))
        .map(named);
    names
        .find(|name| fs::symlink_metadata(name).is_err())
        .unwrap_or_else(|| named(".damaged".to_owned()))
}
