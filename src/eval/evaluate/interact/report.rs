use std::iter::Sum;

use serde::Serialize;

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
