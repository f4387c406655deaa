use std::path::{Path, PathBuf};

use super::error::NnError;

/// Where networks and ONNX Runtime are kept: `ostra/models` in the system's data folder (`XDG_DATA_HOME` is honoured).
///
/// # Errors
/// When the system tells no data folder.
pub fn models_folder() -> Result<PathBuf, NnError> {
    let no_folder =
        || NnError::Request("this system tells no data folder; set XDG_DATA_HOME".to_owned());
    dirs::data_dir()
        .map(|dir| dir.join("ostra").join("models"))
        .ok_or_else(no_folder)
}

/// How the library of ONNX Runtime is called on this system.
#[must_use]
pub fn library_name() -> String {
    format!(
        "{}onnxruntime{}",
        std::env::consts::DLL_PREFIX,
        std::env::consts::DLL_SUFFIX
    )
}

/// One place where ONNX Runtime may be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// The file that the user named: nothing else will do.
    Named(PathBuf),
    /// A file that is there.
    File(PathBuf),
    /// A name that the system's loader may know.
    System(PathBuf),
}

impl Place {
    /// The path to load.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Named(path) | Self::File(path) | Self::System(path) => path,
        }
    }
}

/// Where to look, best first: the file that `ORT_DYLIB_PATH` names, our own folder, the system's loader paths.
#[must_use]
pub fn places(named: Option<PathBuf>, folder: Option<&Path>) -> Vec<Place> {
    if let Some(path) = named.filter(|path| !path.as_os_str().is_empty()) {
        return vec![Place::Named(path)];
    }
    let name = library_name();
    let own = folder
        .map(|folder| folder.join(&name))
        .filter(|path| path.is_file())
        .map(Place::File);
    // Linux distributions ship the first name only with the headers.
    let versioned = cfg!(target_os = "linux").then(|| format!("{name}.1"));
    let system = std::iter::once(name)
        .chain(versioned)
        .map(|name| Place::System(PathBuf::from(name)));
    own.into_iter().chain(system).collect()
}
