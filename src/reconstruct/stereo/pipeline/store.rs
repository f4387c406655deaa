use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};

use crate::stereo::DepthEstimate;
use ostra_cloud::SceneError;

/// How far a view's depth is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// After so many rounds with geometric consistency; 0 = by the pictures alone.
    Round(u32),
    /// What of the last round other views agree with.
    Filtered,
    /// With what others see: ready to be looked at and fused.
    Complete,
}

/// Where depths are kept while others are made, and afterwards: what is there when a run starts is not made again.
pub trait DepthStore: Sync {
    /// The depth of a frame at a stage; `None` when it is not there.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be read; [`ostra_frames::FrameError::Invalid`] within it when it is damaged, for which
    /// it is made again.
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError>;

    /// Keeps the depth of a frame at a stage.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be written.
    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError>;

    /// Called when no more of a stage is needed by any view.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be removed.
    fn forget(&self, stage: Stage) -> Result<(), SceneError>;
}

/// Keeps depths in memory: 8 bytes a pixel and stage.
#[derive(Debug, Default)]
pub struct MemoryDepths {
    estimates: Mutex<BTreeMap<(Stage, usize), Arc<DepthEstimate>>>,
}

impl DepthStore for MemoryDepths {
    fn load(&self, frame: usize, stage: Stage) -> Result<Option<Arc<DepthEstimate>>, SceneError> {
        let estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        Ok(estimates.get(&(stage, frame)).map(Arc::clone))
    }

    fn save(&self, frame: usize, stage: Stage, estimate: DepthEstimate) -> Result<(), SceneError> {
        let mut estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        estimates.insert((stage, frame), Arc::new(estimate));
        Ok(())
    }

    fn forget(&self, stage: Stage) -> Result<(), SceneError> {
        let mut estimates = self
            .estimates
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        estimates.retain(|&(kept, _), _| kept != stage);
        Ok(())
    }
}
