use crate::sfm::FeatureError;
use ostra_cloud::SceneError;
use ostra_core::job::Stopped;

/// Reasons why registration of an RGB-D recording ends without a result.
#[derive(Debug, thiserror::Error)]
pub enum RgbdError {
    /// Features or matches could not be computed.
    #[error(transparent)]
    Feature(#[from] FeatureError),
    /// A cloud could not be compared.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// No two frames agree; the message says what was found and what to do.
    #[error("{0}")]
    NoStart(String),
    /// The user stopped the run.
    #[error(transparent)]
    Stopped(#[from] Stopped),
}
