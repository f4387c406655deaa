use super::Sequence;

/// How the robot user works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractOptions {
    /// IoU of a label on a frame at which it is left as it is; 0–1.
    pub good_iou: f64,
    /// Most clicks for a label in one visit of a frame; ≥ 1.
    pub visit_clicks: usize,
    /// Clicks in a row that hardly better a label (its IoU by less than 0.01) after which it is let be; ≥ 1.
    pub patience: usize,
    /// Mean IoU over the sequence at which the work is done; 0–1.
    pub enough_iou: f64,
    /// How far clicks fall from where they are meant, in pixels: standard deviation along each axis; ≥ 0.
    pub jitter_px: f64,
    /// Another seed makes clicks fall elsewhere.
    pub seed: u64,
    /// The finest that a hand draws: how far a border lies off between two corners, in pixels; above 0.
    pub outline_px: f64,
    /// IoU of a label up to which it is drawn by hand where clicks do not make it good: what is drawn is carried on, which costs
    /// some; 0–1.
    pub outline_iou: f64,
    /// Bounds of the clicks over the whole sequence, which are forty for each frame and label of the truth.
    pub clicks: (usize, usize),
}

impl Default for InteractOptions {
    fn default() -> Self {
        Self {
            good_iou: 0.9,
            visit_clicks: 20,
            patience: 3,
            enough_iou: 0.95,
            jitter_px: 0.0,
            seed: 1,
            outline_px: 2.0,
            outline_iou: 0.95,
            clicks: (20, 4000),
        }
    }
}

impl InteractOptions {
    /// Most clicks over a sequence.
    #[must_use]
    pub fn most_clicks(&self, sequence: &Sequence) -> usize {
        (40 * sequence.truth.len() * sequence.shown().len()).clamp(self.clicks.0, self.clicks.1)
    }
}
