use crate::sfm::{FeatureError, SfmError};
use ostra_cloud::SceneError;
use ostra_compute::gpu::GpuError;
use ostra_core::job::Stopped;

/// Reasons why stereo ends as a whole; problems of single views are in [`super::ViewOutcome`].
#[derive(Debug, thiserror::Error)]
pub enum StereoError {
    /// Features or matches for the sparse points could not be computed.
    #[error(transparent)]
    Sfm(#[from] SfmError),
    /// The input does not allow what was requested, or a result could not be stored.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The graphics card failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The user stopped the run.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl From<FeatureError> for StereoError {
    fn from(error: FeatureError) -> Self {
        Self::Sfm(SfmError::Feature(error))
    }
}
