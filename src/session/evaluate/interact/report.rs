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
    /// Clicks given in all.
    pub clicks: usize,
    /// Frames that were corrected after the first.
    pub corrected: usize,
    /// Time of clicking and tracking.
    pub seconds: f64,
    /// The same work without a tracker.
    pub frame_by_frame: FrameByFrame,
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

/// Every frame clicked from nothing by the segmenter alone, until all its labels are good or the clicks are used up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct FrameByFrame {
    /// Clicks on all frames.
    pub clicks: usize,
    /// Frames on which a label did not become good.
    pub failed: usize,
}

impl InteractReport {
    /// The mean IoUs to which clicks are counted.
    pub(super) const GOALS: [f64; 3] = [0.85, 0.90, 0.95];

    /// Share of the clicks frame by frame that tracking saves on the way to a mean IoU of 0.90, where that was reached.
    #[must_use]
    pub fn saved(&self) -> Option<f64> {
        let goal = self.reached.iter().find(|goal| goal.mean_iou == Self::GOALS[1])?;
        Some(1.0 - goal.clicks? as f64 / self.frame_by_frame.clicks.max(1) as f64)
    }
}
