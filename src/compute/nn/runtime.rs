use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use ort::LoadDynamicError;
use ort::environment::Environment;
use ort::ep::{CUDA, CoreML, DirectML, ExecutionProviderDispatch, TensorRT};
use ort::logging::LogLevel;
use serde::{Deserialize, Serialize};

use super::error::NnError;

/// A loaded ONNX Runtime library; a process loads it once and shares it.
#[derive(Debug, Clone)]
pub struct Runtime {
    environment: Environment,
    path: PathBuf,
}

/// Kept until the process ends, because the library cannot be loaded a second time.
static LOADED: Mutex<Option<Runtime>> = Mutex::new(None);

impl Runtime {
    /// Finds and loads ONNX Runtime.
    ///
    /// The search order is: the path in `ORT_DYLIB_PATH`, the data folder of OSTRA, the system.
    ///
    /// # Errors
    /// [`NnError::RuntimeMissing`], or [`NnError::RuntimeUnusable`] for a library that exists.
    pub fn find() -> Result<Self, NnError> {
        let named = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
        Self::first_of(&places(named, models_folder().ok().as_deref()))
    }

    /// Loads the library at `path`.
    ///
    /// # Errors
    /// [`NnError::RuntimeUnusable`], also if another library is already loaded.
    pub fn open(path: &Path) -> Result<Self, NnError> {
        let runtime = Self::first_of(&[RuntimeLocation::Named(path.to_owned())])?;
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

    /// Returns the loaded library, if any.
    #[must_use]
    pub fn loaded() -> Option<Self> {
        LOADED
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Returns the library's path, or its name if the system's loader found it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn environment(&self) -> &Environment {
        &self.environment
    }

    fn first_of(places: &[RuntimeLocation]) -> Result<Self, NnError> {
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

/// Loads the library; `None` if the system's loader does not find it.
fn load(place: &RuntimeLocation) -> Result<Option<Runtime>, NnError> {
    let path = match place {
        RuntimeLocation::System(path) => path.clone(),
        RuntimeLocation::Named(path) | RuntimeLocation::File(path) => whole(path),
    };
    let unusable = |what: String| NnError::RuntimeUnusable {
        path: path.clone(),
        what,
    };
    // For a relative path, `ort` asks for the executable's folder and panics if there is none.
    if path.is_relative() && std::env::current_exe().is_err() {
        return Ok(None);
    }
    let builder = match (ort::init_from(&path), place) {
        (Ok(builder), _) => builder,
        (Err(LoadDynamicError::Dlopen { .. }), RuntimeLocation::System(_)) => return Ok(None),
        (Err(error), _) => return Err(unusable(what_is_wrong(&error))),
    };
    let environment = builder
        .with_telemetry(false)
        .build()
        .map_err(|error| unusable(error.to_string()))?;
    // Errors are returned as values; by default ONNX Runtime also writes them to the terminal.
    environment.set_log_level(LogLevel::Fatal);
    Ok(Some(Runtime { environment, path }))
}

/// Makes a path absolute, if the system can.
pub(super) fn whole(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

fn what_is_wrong(error: &LoadDynamicError) -> String {
    match error {
        LoadDynamicError::Dlopen { error, .. } => error.to_string(),
        LoadDynamicError::MissingApi { .. } => "it is another library".to_owned(),
        LoadDynamicError::InvalidVersionString => "it does not report its version".to_owned(),
        LoadDynamicError::BadVersion { version_str, .. } => {
            format!("it is of version {version_str}")
        }
    }
}

/// Returns the folder of networks and ONNX Runtime.
///
/// This is `ostra/models` in the system's data folder (`XDG_DATA_HOME` is respected).
///
/// # Errors
/// Fails if the system has no data folder.
pub fn models_folder() -> Result<PathBuf, NnError> {
    let no_folder =
        || NnError::Request("this system has no data folder; set XDG_DATA_HOME".to_owned());
    dirs::data_dir()
        .map(|dir| dir.join("ostra").join("models"))
        .ok_or_else(no_folder)
}

/// Returns the file name of the ONNX Runtime library on this system.
#[must_use]
pub fn library_name() -> String {
    format!(
        "{}onnxruntime{}",
        std::env::consts::DLL_PREFIX,
        std::env::consts::DLL_SUFFIX
    )
}

/// A place where ONNX Runtime may be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RuntimeLocation {
    /// The file that the user named; no other is tried.
    Named(PathBuf),
    /// An existing file.
    File(PathBuf),
    /// A name for the system's loader.
    System(PathBuf),
}

impl RuntimeLocation {
    /// Returns the path to load.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Named(path) | Self::File(path) | Self::System(path) => path,
        }
    }
}

/// Returns the places to search, best first.
///
/// These are the file in `ORT_DYLIB_PATH` alone, or else the file in `folder` and the names for the
/// system's loader.
#[must_use]
pub fn places(named: Option<PathBuf>, folder: Option<&Path>) -> Vec<RuntimeLocation> {
    if let Some(path) = named.filter(|path| !path.as_os_str().is_empty()) {
        return vec![RuntimeLocation::Named(path)];
    }
    let name = library_name();
    let own = folder
        .map(|folder| folder.join(&name))
        .filter(|path| path.is_file())
        .map(RuntimeLocation::File);
    // Linux distributions ship the unversioned name only in the package with the headers.
    let versioned = cfg!(target_os = "linux").then(|| format!("{name}.1"));
    let system = std::iter::once(name)
        .chain(versioned)
        .map(|name| RuntimeLocation::System(PathBuf::from(name)));
    own.into_iter().chain(system).collect()
}

/// The device that networks run on: an execution provider of ONNX Runtime.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// The processor.
    #[default]
    Cpu,
    /// NVIDIA graphics cards, by CUDA.
    Cuda,
    /// NVIDIA graphics cards, by TensorRT, and by CUDA what TensorRT cannot run.
    TensorRt,
    /// Apple's processors.
    CoreMl,
    /// Any graphics card under Windows.
    DirectMl,
}

/// Index in [`Provider::ALL`] of the provider for networks loaded from now on.
static CHOSEN: AtomicUsize = AtomicUsize::new(0);
/// Messages about providers that did not start, until they are taken.
static FALLEN_BACK: Mutex<Vec<String>> = Mutex::new(Vec::new());

impl Provider {
    /// All providers, the processor first.
    pub const ALL: [Self; 5] = [
        Self::Cpu,
        Self::Cuda,
        Self::TensorRt,
        Self::CoreMl,
        Self::DirectMl,
    ];

    /// Returns the name on the command line.
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

    /// Returns the provider for networks that are loaded from now on.
    #[must_use]
    pub fn chosen() -> Self {
        Self::ALL[CHOSEN.load(Ordering::Relaxed)]
    }

    /// Chooses the provider for networks loaded from now on; loaded ones are not affected.
    pub fn choose(self) {
        let place = Self::ALL
            .iter()
            .position(|&one| one == self)
            .unwrap_or_default();
        CHOSEN.store(place, Ordering::Relaxed);
    }

    /// Returns the providers to register, in order of preference.
    ///
    /// The list is empty for the processor, which is always available.
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

/// Records that a network runs on the processor although another provider was chosen.
pub(super) fn note_fall_back(what: String) {
    FALLEN_BACK
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .push(what);
}

/// Returns and clears the recorded fallbacks to the processor, one line each.
#[must_use]
pub fn take_fall_backs() -> Vec<String> {
    std::mem::take(&mut *FALLEN_BACK.lock().unwrap_or_else(PoisonError::into_inner))
}
