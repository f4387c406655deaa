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
    /// The finest that a hand does, in pixels: how far a border lies off between two corners, and the shortest pull; above 0.
    pub outline_px: f64,
    /// What corners and pulls beyond [`Self::good_iou`] must add to the IoU of their label on their frame, for each of them: what
    /// is drawn is carried on, so that a better outline is worth some; above 0.
    pub corner_gain: f64,
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
            outline_px: 1.0,
            corner_gain: 0.004,
        }
    }
}
