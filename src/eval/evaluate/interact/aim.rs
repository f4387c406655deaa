use super::InteractOptions;

/// How far the border of what is drawn may lie off between two corners, in pixels: a hand is no finer than it must be.
const OFF_PX: [f64; 4] = [8.0, 5.0, 3.0, 2.0];

/// What a user draws for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// IoU at which a label is good; 0–1.
    pub good_iou: f64,
    /// What corners and pulls must add to the IoU of a label until it is good, for each of them; above 0.
    pub price: f64,
    /// What they must add to that of a label that is good; no less than [`Self::price`].
    pub price_beyond: f64,
    /// How far a border lies off between two corners where a hand draws as finely as it can, and its shortest pull, in pixels;
    /// above 0.
    pub finest_px: f64,
}

impl Aim {
    /// What pays at first.
    #[must_use]
    pub fn of(options: &InteractOptions) -> Self {
        let InteractOptions {
            good_iou,
            price,
            price_beyond,
            outline_px: finest_px,
            ..
        } = *options;
        Self {
            good_iou,
            price,
            price_beyond,
            finest_px,
        }
    }

    /// What pays where all that paid so far is done and more is asked: half is enough beyond what is good, and no more is asked
    /// before. `None` where that is less than `least_price`.
    #[must_use]
    pub fn lowered(self, least_price: f64) -> Option<Self> {
        let half = self.price_beyond / 2.0;
        (half >= least_price).then(|| Self {
            price: self.price.min(half),
            price_beyond: half,
            ..self
        })
    }

    /// How many clicks an IoU is worth, less those that it took.
    pub(super) fn value(&self, iou: f64, corners: usize) -> f64 {
        let beyond = (iou - self.good_iou).max(0.0);
        (iou - beyond) / self.price + beyond / self.price_beyond - corners as f64
    }

    /// How far the border of what is drawn lies off between two corners, in pixels, the coarsest first.
    pub(super) fn off_px(&self) -> impl Iterator<Item = f64> + use<> {
        let finest_px = self.finest_px;
        OFF_PX
            .into_iter()
            .filter(move |&off_px| off_px > finest_px)
            .chain([finest_px])
    }
}
