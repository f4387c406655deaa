use std::sync::Arc;

use super::{DepthMap, Frame, FrameError, Image};

/// Loads pictures and depths on demand and keeps the latest in a cache bounded in bytes. Shared by all threads.
#[derive(Debug)]
pub struct FrameStore {
    budget_bytes: usize,
}

impl FrameStore {
    /// A store that keeps at most `budget_bytes` of decoded pixels.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        Self { budget_bytes }
    }

    /// The frame's picture, turned upright.
    ///
    /// # Errors
    /// [`FrameError`] when the source is missing, damaged or of another size than when it was opened.
    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let _ = (frame, self.budget_bytes);
        Err(FrameError::NotFound("not built yet".into()))
    }

    /// The frame's depth in world units, turned upright; `None` when it has none.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        let _ = frame;
        Ok(None)
    }
}
