use super::FeatureError;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;

/// What ends structure from motion without a result.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// Features or matches could not be made.
    #[error(transparent)]
    Feature(#[from] FeatureError),
    /// A frame could not be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// No two pictures to start from; what was found, and what to do.
    #[error("{0}")]
    NoStart(String),
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
