use std::path::PathBuf;

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;
use ostra_geometry::GeometryError;
use ostra_masks::MaskError;

/// What can go wrong between frames and the labelled scene; each says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said. Part of the message, so it is not this error's source: it would be printed twice.
        reason: std::io::Error,
    },
    /// A file's content is damaged or of another kind.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// Something is asked for that the input cannot give.
    #[error("{0}")]
    Request(String),
    /// A result would take more memory than it may.
    #[error(
        "with voxels of {voxel} the surface takes more than {mebibytes} MiB; give a larger voxel size"
    )]
    TooLarge {
        /// Edge of the voxels, world units.
        voxel: f64,
        /// What it may take.
        mebibytes: usize,
    },
    /// A frame could not be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A mask could not be read.
    #[error(transparent)]
    Mask(#[from] MaskError),
    /// Degenerate geometry.
    #[error(transparent)]
    Geometry(#[from] GeometryError),
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
