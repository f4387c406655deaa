use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use ort::LoadDynamicError;
use ort::environment::Environment;
use ort::logging::LogLevel;

use super::error::NnError;
use super::search::{Place, models_folder, places};

/// ONNX Runtime, found and loaded. A process loads it once; later ones share it.
#[derive(Debug, Clone)]
pub struct Runtime {
    environment: Environment,
    path: PathBuf,
}

/// Kept until the process ends: the library cannot be loaded a second time.
static LOADED: Mutex<Option<Runtime>> = Mutex::new(None);

impl Runtime {
    /// The library that `ORT_DYLIB_PATH` names, else that in our data folder, else that of the system.
    ///
    /// # Errors
    /// [`NnError::RuntimeMissing`] or, for one that is there, [`NnError::RuntimeUnusable`].
    pub fn find() -> Result<Self, NnError> {
        let named = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
        Self::first_of(&places(named, models_folder().ok().as_deref()))
    }

    /// Loads the library at `path`.
    ///
    /// # Errors
    /// [`NnError::RuntimeUnusable`], also where another library is loaded already.
    pub fn open(path: &Path) -> Result<Self, NnError> {
        let runtime = Self::first_of(&[Place::Named(path.to_owned())])?;
        if runtime.path == whole(path) {
            return Ok(runtime);
        }
        let what = format!(
            "{} is in use until the program is started again",
            runtime.path.display()
        );
        Err(NnError::RuntimeUnusable {
            path: path.to_owned(),
            what,
        })
    }

    /// The library in use, where one is loaded.
    #[must_use]
    pub fn loaded() -> Option<Self> {
        LOADED
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// The library's file, or its name where the system's loader found it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn environment(&self) -> &Environment {
        &self.environment
    }

    fn first_of(places: &[Place]) -> Result<Self, NnError> {
        let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(runtime) = &*loaded {
            return Ok(runtime.clone());
        }
        for place in places {
            if let Some(runtime) = load(place)? {
                *loaded = Some(runtime.clone());
                return Ok(runtime);
            }
        }
        Err(NnError::RuntimeMissing {
            looked: places.iter().map(|place| place.path().to_owned()).collect(),
        })
    }
}

/// `None` where the system's loader has no such library.
fn load(place: &Place) -> Result<Option<Runtime>, NnError> {
    let path = match place {
        Place::System(path) => path.clone(),
        Place::Named(path) | Place::File(path) => whole(path),
    };
    let unusable = |what: String| NnError::RuntimeUnusable {
        path: path.clone(),
        what,
    };
    // `ort` asks for the executable's folder where a path is relative, and panics where there is none.
    if path.is_relative() && std::env::current_exe().is_err() {
        return Ok(None);
    }
    let builder = match (ort::init_from(&path), place) {
        (Ok(builder), _) => builder,
        (Err(LoadDynamicError::Dlopen { .. }), Place::System(_)) => return Ok(None),
        (Err(error), _) => return Err(unusable(what_is_wrong(&error))),
    };
    let environment = builder
        .with_telemetry(false)
        .build()
        .map_err(|error| unusable(error.to_string()))?;
    // Errors come back as values; by itself it writes them to the terminal too.
    environment.set_log_level(LogLevel::Fatal);
    Ok(Some(Runtime { environment, path }))
}

/// With the folders above it, as far as the system tells them.
pub(super) fn whole(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn what_is_wrong(error: &LoadDynamicError) -> String {
    match error {
        LoadDynamicError::Dlopen { error, .. } => error.to_string(),
        LoadDynamicError::MissingApi { .. } => "it is another library".to_owned(),
        LoadDynamicError::InvalidVersionString => "it does not tell its version".to_owned(),
        LoadDynamicError::BadVersion { version_str, .. } => {
            format!("it is of version {version_str}")
        }
    }
}
