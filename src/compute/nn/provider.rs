use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use ort::ep::{CUDA, CoreML, DirectML, ExecutionProviderDispatch, TensorRT};
use serde::{Deserialize, Serialize};

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
/// What was told of providers that did not start and is not yet taken.
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
