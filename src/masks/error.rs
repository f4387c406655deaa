use std::path::PathBuf;

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;

/// What can go wrong with labels and masks; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    /// A file or folder cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said. Part of the message, so it is not this error's source: it would be printed twice.
        reason: std::io::Error,
    },
    /// A mask file's content is damaged or does not fit its frame.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A label that is not there, twice there, or a parent that would make a circle.
    #[error("{0}")]
    Label(String),
    /// A prompt or request that cannot be answered.
    #[error("{0}")]
    Request(String),
    /// A network or what runs it is missing, or failed.
    #[error("{0}")]
    Network(String),
    /// A frame could not be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
