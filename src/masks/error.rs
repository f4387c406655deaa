use std::path::PathBuf;

use ostra_compute::nn::NnError;
use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;

/// Errors about labels and masks, with messages that say what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// A file or folder cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// Path of the file or folder.
        path: PathBuf,
        /// Error of the operating system.
        ///
        /// The message contains it, so it is not the error's source; otherwise it would be printed
        /// twice.
        reason: std::io::Error,
    },
    /// The content of a mask file is damaged or does not fit its frame.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// Path of the file or folder.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A label is missing or a duplicate, or its parent would form a cycle.
    #[error("{0}")]
    Label(String),
    /// A prompt or request cannot be answered.
    #[error("{0}")]
    Request(String),
    /// A network or its runtime is missing or failed.
    #[error("{0}")]
    Network(String),
    /// A frame could not be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The user stopped the operation.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl From<NnError> for MaskError {
    fn from(error: NnError) -> Self {
        Self::Network(error.to_string())
    }
}
