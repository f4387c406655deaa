//! What the integration tests share.

use std::path::{Path, PathBuf};

pub mod film;
pub mod recording;

/// The folder of real data sets (`OSTRA_DATA`, by default `../shared/data`); `None`, after a printed line, where it is
/// missing, which is a failure when `CI` is set.
pub fn data_dir() -> Option<PathBuf> {
    shared_dir("OSTRA_DATA", "../shared/data")
}

/// The folder of networks' weights (`OSTRA_MODELS`, by default `../shared/models`); as [`data_dir`].
pub fn models_dir() -> Option<PathBuf> {
    shared_dir("OSTRA_MODELS", "../shared/models")
}

fn shared_dir(variable: &str, default: &str) -> Option<PathBuf> {
    let given = std::env::var_os(variable).map(PathBuf::from);
    let dir = given.unwrap_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join(default));
    if dir.is_dir() {
        return Some(dir);
    }
    let what = format!("skipped: {} is missing (set {variable})", dir.display());
    assert!(std::env::var_os("CI").is_none(), "{what}");
    eprintln!("{what}");
    None
}
