use std::sync::Arc;

use crate::SceneError;
use ostra_frames::{DepthMap, Frame, FrameError, FrameStore, Image};
use ostra_masks::LabelMask;

/// Where fusion takes its frames from: a project's ([`ProjectViews`]), or depths that a reconstruction holds in memory.
pub trait Views: Sync {
    /// All frames, by number: name, size, camera. Their depth sources are not looked at.
    fn frames(&self) -> &[Frame];

    /// Whether frame `index` has depth.
    fn has_depth(&self, index: usize) -> bool;

    /// The picture of frame `index`.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be read.
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError>;

    /// The depth of frame `index`, pixel for pixel with its picture; `None` when it has none.
    ///
    /// # Errors
    /// [`SceneError`] when it cannot be read.
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError>;

    /// The mask of frame `index`, pixel for pixel with its picture; `None` when it has none.
    fn mask(&self, index: usize) -> Option<Arc<LabelMask>>;

    /// Why frame `index` cannot be read, if it cannot: the error of a job that could read no frame at all.
    fn fault(&self, index: usize) -> Option<SceneError> {
        self.image(index).err().or_else(|| self.depth(index).err())
    }
}

/// The frames, pictures, depths and masks of a project.
#[derive(Clone, Copy)]
pub struct ProjectViews<'a> {
    /// All frames, by number.
    pub frames: &'a [Frame],
    /// Where pictures and depths are loaded.
    pub store: &'a FrameStore,
    /// The mask of a frame, where it has one.
    pub masks: &'a (dyn Fn(usize) -> Option<Arc<LabelMask>> + Sync),
}

impl Views for ProjectViews<'_> {
    fn frames(&self) -> &[Frame] {
        self.frames
    }

    fn has_depth(&self, index: usize) -> bool {
        self.frames[index].depth.is_some()
    }

    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(self.store.image(&self.frames[index])?)
    }

    /// A depth that cannot be read is as good as none; fusion names its frame.
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(readable(
            self.store
                .depth(&self.frames[index])
                .map_err(SceneError::from),
        )?
        .flatten())
    }

    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        (self.masks)(index)
    }

    fn fault(&self, index: usize) -> Option<SceneError> {
        let frame = &self.frames[index];
        Some(
            self.store
                .image(frame)
                .err()
                .or_else(|| self.store.depth(frame).err())?
                .into(),
        )
    }
}

/// An image or a depth, or nothing where its file cannot be read: one damaged file among many does not end a job. The job
/// names it.
///
/// # Errors
/// Every other error, [`SceneError::Stopped`] too.
pub fn readable<T>(read: Result<T, SceneError>) -> Result<Option<T>, SceneError> {
    match read {
        Err(SceneError::Frame(FrameError::Stopped(stopped))) => Err(stopped.into()),
        Err(SceneError::Frame(_)) => Ok(None),
        read => read.map(Some),
    }
}

/// Refuses pixels of another size than their frame: they would vote for the wrong points.
pub(super) fn check_size(
    frame: &Frame,
    what: &str,
    width: u32,
    height: u32,
) -> Result<(), SceneError> {
    if (width, height) == (frame.width, frame.height) {
        return Ok(());
    }
    Err(SceneError::Request(format!(
        "frame '{}': its {what} is {width}x{height} but its picture is {}x{}; give a {what} of the picture's size",
        frame.name, frame.width, frame.height
    )))
}
