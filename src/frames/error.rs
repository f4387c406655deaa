use std::path::PathBuf;

use crate::engine::job::Stopped;
use crate::geometry::GeometryError;

/// What can go wrong while frames are opened or read; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A file or folder cannot be read.
    #[error("{}: cannot be read ({source}); check that it exists and may be read", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file's content is damaged or not what its place demands.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A path where no frames were found, or a request that no frame fits.
    #[error("{0}")]
    NotFound(String),
    /// A pose or camera that cannot be.
    #[error("{}: {source}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: GeometryError,
    },
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
