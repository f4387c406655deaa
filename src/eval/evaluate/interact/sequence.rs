use std::collections::{BTreeMap, BTreeSet};
use std::iter::Sum;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use serde::Serialize;

use crate::evaluate::frames::{PIXEL_BYTES, read_frames, readable_frames};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelTree, MaskFormat, MaskFrame, RunMask};
use ostra_project::Project;

/// Frames with ground truth masks.
pub struct Sequence {
    /// All frames in order.
    pub frames: Arc<Vec<Frame>>,
    /// Cache of their images and depths.
    pub store: Arc<FrameStore>,
    /// Labels of the ground truth.
    pub labels: LabelTree,
    /// Ground truth masks by frame number, in the size of the frame.
    ///
    /// A frame without a mask is tracked but not scored.
    pub truth: BTreeMap<usize, RunMask>,
}

impl Sequence {
    /// Opens frames and the folder of their ground truth masks; also returns warnings.
    ///
    /// Frames are a folder, a video, or a project, whose frames have depth and cameras. Masks are
    /// matched by name as in [`MaskFormat::import_masks`]. Frames whose image or depth cannot be
    /// read are left out.
    ///
    /// # Errors
    /// Returns an error if no frame or no mask can be read, or if no mask belongs to a frame.
    pub fn open(frames: &Path, truth: &Path, progress: &Progress) -> Result<(Self, Vec<String>)> {
        // Depth maps of a reconstruction are in the project folder.
        let store = FrameStore::at_home(PIXEL_BYTES, frames.to_owned());
        let (frames, mut warnings) = read_frames(frames, progress)?;
        let read = |frame: &Frame| {
            store
                .image(frame)
                .and_then(|_| store.depth(frame))
                .map(drop)
        };
        let (frames, unreadable) = readable_frames(frames, read, progress)?;
        warnings.extend(unreadable);
        let sized: Vec<MaskFrame<'_>> = frames.iter().map(MaskFrame::from).collect();
        let imported =
            MaskFormat::Davis.import_masks(truth, &sized, &LabelTree::default(), progress)?;
        warnings.extend(imported.warnings);
        let labels = LabelTree::try_from(imported.new_labels)?;
        let (frames, store) = (Arc::new(frames), Arc::new(store));
        Ok((
            Self {
                frames,
                store,
                labels,
                truth: imported.masks,
            },
            warnings,
        ))
    }

    /// Returns the labels in the ground truth of any frame.
    #[must_use]
    pub fn shown(&self) -> BTreeSet<LabelId> {
        self.truth
            .keys()
            .flat_map(|&frame| self.shown_on(frame))
            .collect()
    }

    /// Returns the labels in the ground truth of a frame.
    #[must_use]
    pub fn shown_on(&self, frame: usize) -> Vec<LabelId> {
        self.truth
            .get(&frame)
            .map(|mask| mask.extents().into_keys().collect())
            .unwrap_or_default()
    }

    /// Returns the ground truth mask of a frame.
    ///
    /// # Errors
    /// Returns an error if there is none.
    pub fn truth_of(&self, frame: usize) -> Result<&RunMask> {
        self.truth
            .get(&frame)
            .with_context(|| format!("frame {frame} has no true mask"))
    }

    /// Returns an in-memory project with the frames and labels only.
    #[must_use]
    pub fn project(&self) -> Project {
        Project {
            frames: Arc::clone(&self.frames),
            labels: self.labels.clone(),
            ..Project::default()
        }
    }
}

/// Effort of a simulated user for a sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InteractReport {
    /// Segmenter that answered the clicks.
    pub segmenter: String,
    /// Tracker that propagated the masks.
    pub tracker: String,
    /// Number of frames with ground truth.
    pub frames: usize,
    /// Number of labels in the ground truth.
    pub labels: usize,
    /// Clicks up to each mean IoU, the lowest one first.
    pub reached: Vec<Goal>,
    /// Mean IoU at the end.
    pub mean_iou: f64,
    /// Total number of clicks, including corners of outlines and border drags.
    pub clicks: usize,
    /// Number of corners of outlines and border drags.
    pub corners: usize,
    /// Number of corrected frames after the first one.
    pub corrected: usize,
    /// Duration of clicking and tracking, in seconds.
    pub seconds: f64,
    /// Effort of labelling every frame without a tracker.
    pub frame_by_frame: FrameByFrame,
    /// The part of it for frames with a poor label after the first tracking from one frame.
    ///
    /// This is the cost of clicking those frames again.
    pub failed_by_frame: FrameByFrame,
}

/// A mean IoU over the sequence, and the clicks to reach it.
///
/// The mean is over the frames where a label is in the ground truth or the result, then over
/// labels.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Goal {
    /// The mean IoU.
    pub mean_iou: f64,
    /// Number of clicks after which it was first reached; `None` if it was not.
    pub clicks: Option<usize>,
}

/// Effort of labelling frames from scratch without a tracker, up to a mean IoU of 0.90.
///
/// Frames are clicked first and then drawn by hand.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameByFrame {
    /// Number of frames.
    pub frames: usize,
    /// Total number of clicks.
    pub clicks: usize,
    /// Number of frames with a label that did not become good.
    pub failed: usize,
}

impl Sum for FrameByFrame {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |a, b| Self {
            frames: a.frames + b.frames,
            clicks: a.clicks + b.clicks,
            failed: a.failed + b.failed,
        })
    }
}

impl InteractReport {
    /// The mean IoUs up to which clicks are counted.
    pub(super) const GOALS: [f64; 3] = [0.85, 0.90, 0.95];

    /// Returns the share of the frame-by-frame clicks that tracking saves up to a mean IoU of 0.90.
    ///
    /// Returns `None` if that mean was not reached.
    #[must_use]
    pub fn saved(&self) -> Option<f64> {
        Some(1.0 - self.clicks_to_goal()? / self.frame_by_frame.clicks.max(1) as f64)
    }

    /// Returns the clicks up to a mean IoU of 0.90 as a share of re-clicking the failed frames.
    ///
    /// Returns `None` if either is unknown.
    #[must_use]
    pub fn share_of_reclicking(&self) -> Option<f64> {
        let clicks = self.failed_by_frame.clicks;
        (clicks > 0)
            .then(|| self.clicks_to_goal())
            .flatten()
            .map(|goal| goal / clicks as f64)
    }

    fn clicks_to_goal(&self) -> Option<f64> {
        let goal = self
            .reached
            .iter()
            .find(|goal| goal.mean_iou == Self::GOALS[1])?;
        goal.clicks.map(|clicks| clicks as f64)
    }
}
