use crate::sfm::{FeatureError, SfmError};
use ostra_cloud::SceneError;
use ostra_compute::gpu::GpuError;
use ostra_core::job::Stopped;

/// What ends stereo as a whole; what concerns one view is its [`super::ViewOutcome`].
#[derive(Debug, thiserror::Error)]
pub enum StereoError {
    /// Features or matches for the sparse points could not be made.
    #[error(transparent)]
    Sfm(#[from] SfmError),
    /// Something is asked for that the input cannot give, or a result could not be kept.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The graphics card that it was to run on failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The user stopped it.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}

impl From<FeatureError> for StereoError {
    fn from(error: FeatureError) -> Self {
        Self::Sfm(SfmError::Feature(error))
    }
}
