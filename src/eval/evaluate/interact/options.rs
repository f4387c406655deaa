/// How the robot user works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractOptions {
    /// IoU of a label on a frame at which it is good: it is clicked on no longer as long as others are worse; 0–1.
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
    /// What corners and pulls must add to the IoU of their label on their frame until it is good, for each of them; above 0.
    pub price: f64,
    /// What they must add beyond: what is drawn is carried on, so that a better outline is worth some; no less than [`Self::price`].
    /// Where all that pays is done and more is asked, half of it is enough, and half of that, as long as that is no less than
    /// [`Self::least_price`].
    pub price_beyond: f64,
    /// Above 0.
    pub least_price: f64,
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
            price: 0.0008,
            price_beyond: 0.004,
            least_price: 0.0005,
        }
    }
}
