use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use ort::LoadDynamicError;
use ort::environment::Environment;
use ort::ep::{CUDA, CoreML, DirectML, ExecutionProviderDispatch, TensorRT};
use ort::logging::LogLevel;
use serde::{Deserialize, Serialize};

use super::error::NnError;

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

/// With the folders above it, as far as the system reports them.
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

/// Where networks and ONNX Runtime are kept: `ostra/models` in the system's data folder (`XDG_DATA_HOME` is honoured).
///
/// # Errors
/// When the system has no data folder.
pub fn models_folder() -> Result<PathBuf, NnError> {
    let no_folder =
        || NnError::Request("this system has no data folder; set XDG_DATA_HOME".to_owned());
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

/// What networks run on: the parts of ONNX Runtime that its documentation calls execution providers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// The processor.
    #[default]
    Cpu,
    /// A card of NVIDIA, by CUDA.
    Cuda,
    /// A card of NVIDIA, by TensorRT; CUDA does what TensorRT cannot.
    TensorRt,
    /// Apple's processors.
    CoreMl,
    /// Any card under Windows.
    DirectMl,
}

/// Place in [`Provider::ALL`] of what networks loaded from now on run on.
static CHOSEN: AtomicUsize = AtomicUsize::new(0);
/// Reports of providers that did not start, until they are taken.
static FALLEN_BACK: Mutex<Vec<String>> = Mutex::new(Vec::new());

impl Provider {
    /// All of them, the processor first.
    pub const ALL: [Self; 5] = [
        Self::Cpu,
        Self::Cuda,
        Self::TensorRt,
        Self::CoreMl,
        Self::DirectMl,
    ];

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::CoreMl => "coreml",
            Self::DirectMl => "directml",
        }
    }

    /// What networks that are loaded from now on run on.
    #[must_use]
    pub fn chosen() -> Self {
        Self::ALL[CHOSEN.load(Ordering::Relaxed)]
    }

    /// Networks that are loaded from now on run on this; those that are loaded stay where they are.
    pub fn choose(self) {
        let place = Self::ALL
            .iter()
            .position(|&one| one == self)
            .unwrap_or_default();
        CHOSEN.store(place, Ordering::Relaxed);
    }

    /// What ONNX Runtime is asked to register, the first first; nothing for the processor, which is always there.
    pub(super) fn registered(self) -> Vec<ExecutionProviderDispatch> {
        let all = match self {
            Self::Cpu => vec![],
            Self::Cuda => vec![CUDA::default().build()],
            Self::TensorRt => vec![TensorRT::default().build(), CUDA::default().build()],
            Self::CoreMl => vec![CoreML::default().build()],
            Self::DirectMl => vec![DirectML::default().build()],
        };
        all.into_iter()
            .map(ExecutionProviderDispatch::error_on_failure)
            .collect()
    }
}

/// Notes that a network runs on the processor though something else was chosen.
pub(super) fn note_fall_back(what: String) {
    FALLEN_BACK
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(what);
}

/// What was noted since the last call of networks that run on the processor though something else was chosen, a line each.
#[must_use]
pub fn take_fall_backs() -> Vec<String> {
    std::mem::take(&mut *FALLEN_BACK.lock().unwrap_or_else(PoisonError::into_inner))
}
