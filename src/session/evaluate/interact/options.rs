use super::Sequence;

/// How the robot user works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractOptions {
    /// IoU of a label on a frame at which it is left as it is; 0–1.
    pub good_iou: f64,
    /// Clicks for a label in one visit of a frame; ≥ 1.
    pub visit_clicks: usize,
    /// Mean IoU over the sequence at which the work is done; 0–1.
    pub enough_iou: f64,
    /// Most clicks for a label on a frame that is segmented from nothing, without tracking; ≥ 1.
    pub lone_clicks: usize,
    /// Bounds of the clicks over the whole sequence, which are two for each frame and label of the truth.
    pub clicks: (usize, usize),
}

impl Default for InteractOptions {
    fn default() -> Self {
        Self { good_iou: 0.9, visit_clicks: 5, enough_iou: 0.95, lone_clicks: 20, clicks: (20, 200) }
    }
}

impl InteractOptions {
    /// Most clicks over a sequence.
    #[must_use]
    pub fn most_clicks(&self, sequence: &Sequence) -> usize {
        (2 * sequence.truth.len() * sequence.shown().len()).clamp(self.clicks.0, self.clicks.1)
    }
}
