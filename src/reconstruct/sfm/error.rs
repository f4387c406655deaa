use super::FeatureError;
use ostra_core::job::Stopped;
use ostra_frames::FrameError;

/// Reasons why structure from motion ends without a result.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// Features or matches could not be computed.
    #[error(transparent)]
    Feature(#[from] FeatureError),
    /// A frame could not be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// There is no image pair to start from; the message says what was found and what to do.
    #[error("{0}")]
    NoStart(String),
    /// The user stopped the run.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
