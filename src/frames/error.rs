use std::path::{Path, PathBuf};

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_geometry::GeometryError;

/// What can go wrong while frames are opened or read; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A file or folder cannot be read, or a file of cameras written.
    #[error("{}: {}", path.display(), disk::read_fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said. Part of the message, so it is not this error's source: it would be printed twice.
        reason: std::io::Error,
    },
    /// A source file or folder is gone.
    #[error("{}: is not there; if it was moved, run 'ostra relocate PROJECT OLD NEW' or choose File › Frames were moved", path.display())]
    Missing {
        /// The file or folder.
        path: PathBuf,
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
    #[error("{}: {reason}", path.display())]
    Geometry {
        /// The file.
        path: PathBuf,
        /// What is wrong; see `Io` for its name.
        reason: GeometryError,
    },
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl FrameError {
    /// Tells a path that is gone from one that cannot be read.
    pub(super) fn io(path: &Path, reason: std::io::Error) -> Self {
        if reason.kind() == std::io::ErrorKind::NotFound {
            return Self::Missing { path: path.into() };
        }
        Self::Io {
            path: path.into(),
            reason,
        }
    }
}
