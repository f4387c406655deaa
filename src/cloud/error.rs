use std::path::PathBuf;

use ostra_core::disk;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;
use ostra_geometry::GeometryError;
use ostra_masks::MaskError;

/// Errors of fusion, surfaces, measurement, selection and file formats.
///
/// Each message says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A file cannot be read or written.
    #[error("{}: {}", path.display(), disk::fault(reason))]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        ///
        /// It is part of the message. If it were the source of this error, it would be printed
        /// twice.
        reason: std::io::Error,
    },
    /// The content of a file is damaged or of another kind.
    #[error("{}: {what}", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// What is wrong and what to do.
        what: String,
    },
    /// A request that the input cannot satisfy.
    #[error("{0}")]
    Request(String),
    /// A result would exceed its memory limit.
    #[error(
        "with voxels of {voxel} the surface takes more than {mebibytes} MiB; give a larger voxel size"
    )]
    TooLarge {
        /// Voxel edge length, in world units.
        voxel: f64,
        /// Memory limit in MiB.
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
    /// The job was stopped by the user.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
