use std::collections::{BTreeMap, BTreeSet};
use std::iter::Sum;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use serde::Serialize;

use crate::evaluate::frames::{PIXEL_BYTES, read_frames, readable_frames};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelTree, MaskFormat, MaskFrame, RunMask, import_masks};
use ostra_project::Project;

/// Frames with true masks.
pub struct Sequence {
    /// All frames in order.
    pub frames: Arc<Vec<Frame>>,
    /// Where their pictures are loaded.
    pub store: Arc<FrameStore>,
    /// The labels of the truth.
    pub labels: LabelTree,
    /// True masks by frame number, each of its frame's size; a frame without one is tracked but not judged.
    pub truth: BTreeMap<usize, RunMask>,
}

impl Sequence {
    /// Opens frames (a folder, a film, or a project, whose frames have depth and cameras) and the folder of their true
    /// masks, matched by name as by [`import_masks`]. Frames whose image or depth cannot be read are left out. Gives with it
    /// what the user should know.
    ///
    /// # Errors
    /// When no frame or no mask can be read, or no mask belongs to a frame.
    pub fn open(frames: &Path, truth: &Path, progress: &Progress) -> Result<(Self, Vec<String>)> {
        // Depths that a reconstruction made lie in the project's folder.
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
        let imported = import_masks(
            truth,
            MaskFormat::Davis,
            &sized,
            &LabelTree::default(),
            progress,
        )?;
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

    /// The labels that the truth shows anywhere.
    #[must_use]
    pub fn shown(&self) -> BTreeSet<LabelId> {
        self.truth
            .keys()
            .flat_map(|&frame| self.shown_on(frame))
            .collect()
    }

    /// The labels that the truth shows on a frame.
    #[must_use]
    pub fn shown_on(&self, frame: usize) -> Vec<LabelId> {
        self.truth
            .get(&frame)
            .map(|mask| mask.extents().into_keys().collect())
            .unwrap_or_default()
    }

    /// The true mask of a frame.
    ///
    /// # Errors
    /// When there is none.
    pub fn truth_of(&self, frame: usize) -> Result<&RunMask> {
        self.truth
            .get(&frame)
            .with_context(|| format!("frame {frame} has no true mask"))
    }

    /// A project in memory with the frames and labels, and nothing else.
    #[must_use]
    pub fn project(&self) -> Project {
        Project {
            frames: Arc::clone(&self.frames),
            labels: self.labels.clone(),
            ..Project::default()
        }
    }
}

/// What a robot user needed for a sequence.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct InteractReport {
    /// The segmenter that answered the clicks.
    pub segmenter: String,
    /// The tracker that carried the masks.
    pub tracker: String,
    /// Frames with truth.
    pub frames: usize,
    /// Labels that the truth shows.
    pub labels: usize,
    /// Clicks to each mean IoU, the lowest first.
    pub reached: Vec<Goal>,
    /// Mean IoU at the end.
    pub mean_iou: f64,
    /// Clicks given in all, with the corners of outlines and the borders pulled.
    pub clicks: usize,
    /// The corners of outlines and the borders pulled among them.
    pub corners: usize,
    /// Frames that were corrected after the first.
    pub corrected: usize,
    /// Time of clicking and tracking.
    pub seconds: f64,
    /// The same work without a tracker.
    pub frame_by_frame: FrameByFrame,
    /// The part of it on the frames on which the first tracking, from one frame, left a label below the IoU at which it
    /// is good: what re-clicking them costs.
    pub failed_by_frame: FrameByFrame,
}

/// A mean IoU over the sequence (over the frames on which a label is in truth or result, then over labels), and what
/// it took.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Goal {
    /// The mean IoU.
    pub mean_iou: f64,
    /// Clicks after which it was first reached; `None` = it was not.
    pub clicks: Option<usize>,
}

/// Frames labelled from nothing without a tracker, by clicks and what is drawn by hand after them, to a mean IoU of 0.90.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameByFrame {
    /// Number of frames.
    pub frames: usize,
    /// Clicks on all of them.
    pub clicks: usize,
    /// Frames on which a label did not become good.
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
    /// The mean IoUs to which clicks are counted.
    pub(super) const GOALS: [f64; 3] = [0.85, 0.90, 0.95];

    /// Share of the clicks frame by frame that tracking saves on the way to a mean IoU of 0.90, where that was reached.
    #[must_use]
    pub fn saved(&self) -> Option<f64> {
        Some(1.0 - self.clicks_to_goal()? / self.frame_by_frame.clicks.max(1) as f64)
    }

    /// Clicks to a mean IoU of 0.90 as a share of what re-clicking the failed frames costs, where both are known.
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
