use std::f64::consts::TAU;

use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::simulated_click::LabelClick;
use ostra_masks::{Click, LabelMask};

/// Options of the simulated user.
///
/// The two prices follow from counts on DAVIS (`ostra eval interact`). A mean over frames costs
/// least if each corner gains the same everywhere. Drawing every visited frame to 0.90 at any cost
/// needed 7,333 clicks on `bmx-trees` for a mean of 0.90. A single price of 0.0008 needed 6,329
/// there, but 490 on `libby`, where one keyframe serves many frames and a price of 0.004 needs 306.
/// One price up to [`Self::good_iou`] and a higher one beyond take 6,502 and 301.
///
/// Drawing all frames coarsely first and finer in later rounds costs more (7,870 on `bmx-trees`),
/// because coarse polygons are drawn over. Only outlines that are good already are therefore
/// refined in rounds. The frame-by-frame baseline uses the same prices and the same mean, so that
/// the effect of the prices is not attributed to the tracker. A border drag counts as one click,
/// like a moved corner in Polygon-RNN (Castrejón et al., CVPR 2017).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InteractOptions {
    /// IoU from which a label on a frame is good, 0–1.
    ///
    /// A good label is not clicked on while others are worse.
    pub good_iou: f64,
    /// Maximum number of clicks for a label in one visit of a frame; ≥ 1.
    pub visit_clicks: usize,
    /// Number of consecutive clicks with an IoU gain below 0.01 after which a label is left; ≥ 1.
    pub patience: usize,
    /// Mean IoU over the sequence at which the work is done, 0–1.
    pub enough_iou: f64,
    /// Standard deviation of click positions along each axis, in pixels; ≥ 0.
    pub jitter_px: f64,
    /// Seed of the click positions.
    pub seed: u64,
    /// Finest drawing precision, in pixels; above 0.
    ///
    /// It is the deviation of a border between two corners, and the shortest border drag.
    pub outline_px: f64,
    /// Minimum IoU gain per corner or border drag until a label is good; above 0.
    pub price: f64,
    /// Minimum IoU gain per corner or border drag of a good label; at least [`Self::price`].
    ///
    /// What is drawn is also tracked, so a better outline has some value. When no correction pays
    /// any more but the goal is not reached, the price is halved repeatedly, down to
    /// [`Self::least_price`].
    pub price_beyond: f64,
    /// Lower limit of the price; above 0.
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

/// Deviations of a drawn border between two corners that are tried, in pixels.
///
/// A user draws no finer than necessary.
const OFF_PX: [f64; 4] = [8.0, 5.0, 3.0, 2.0];

/// Prices and precision that decide what is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aim {
    /// IoU from which a label is good, 0–1.
    pub good_iou: f64,
    /// Minimum IoU gain per corner or border drag until a label is good; above 0.
    pub price: f64,
    /// Minimum IoU gain per corner or border drag of a good label; at least [`Self::price`].
    pub price_beyond: f64,
    /// Finest deviation of a border between two corners, and shortest border drag, in pixels.
    ///
    /// Above 0.
    pub finest_px: f64,
}

impl Aim {
    /// Returns the initial prices of the options.
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

    /// Halves the price of good labels, or returns `None` if that is below `least_price`.
    ///
    /// The price of other labels is lowered if it would be higher than that.
    #[must_use]
    pub fn lowered(self, least_price: f64) -> Option<Self> {
        let half = self.price_beyond / 2.0;
        (half >= least_price).then(|| Self {
            price: self.price.min(half),
            price_beyond: half,
            ..self
        })
    }

    /// Returns the value of an IoU in clicks, minus the clicks spent.
    pub(super) fn value(&self, iou: f64, corners: usize) -> f64 {
        let beyond = (iou - self.good_iou).max(0.0);
        (iou - beyond) / self.price + beyond / self.price_beyond - corners as f64
    }

    /// Returns the deviations of a drawn border that are tried, in pixels, from coarse to fine.
    pub(super) fn off_px(&self) -> impl Iterator<Item = f64> + use<> {
        let finest_px = self.finest_px;
        OFF_PX
            .into_iter()
            .filter(move |&off_px| off_px > finest_px)
            .chain([finest_px])
    }
}

/// Maximum number of draws for a displaced click that must be inside the error.
const DRAWS: usize = 16;

/// Displaces clicks at random, like a human hand.
pub struct Hand {
    jitter_px: f64,
    random: Pcg64Mcg,
}

impl Hand {
    /// Creates a hand; the displacements depend on the seed of the options and on `turn`.
    pub fn new(options: &InteractOptions, turn: u64) -> Self {
        let seed = options
            .seed
            .wrapping_mul(0x9E37_79B9_7F4A_7C15)
            .wrapping_add(turn);
        Self {
            jitter_px: options.jitter_px,
            random: Pcg64Mcg::seed_from_u64(seed),
        }
    }

    /// Returns a click displaced by the jitter, inside the error of the label.
    ///
    /// If a few draws find no such position, the click is not displaced.
    pub fn place(&mut self, meant: &LabelClick, truth: &LabelMask, seen: &LabelMask) -> Click {
        let LabelClick { label, click, .. } = *meant;
        if self.jitter_px == 0.0 {
            return click;
        }
        let is_wrong = |at: usize| {
            (truth.ids[at] == label) == click.include && (seen.ids[at] == label) != click.include
        };
        let mut draws = (0..DRAWS).map(|_| Click {
            at_px: click.at_px + self.displacement(),
            ..click
        });
        draws
            .find(|click| {
                click
                    .pixel_in(truth.width, truth.height)
                    .is_some_and(is_wrong)
            })
            .unwrap_or(click)
    }

    /// Draws a displacement that is normally distributed along both axes.
    ///
    /// Source: G. E. P. Box, M. E. Muller, "A note on the generation of random normal deviates",
    /// The Annals of Mathematical Statistics, 1958.
    fn displacement(&mut self) -> DVec2 {
        let (near, angle) = (
            self.random.random_range(f64::EPSILON..1.0),
            self.random.random_range(0.0..TAU),
        );
        DVec2::from_angle(angle) * self.jitter_px * (-2.0 * f64::ln(near)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::LabelId;

    const SIZE: u32 = 64;
    const LABEL: LabelId = LabelId(1);

    fn square(from: u32, to: u32) -> LabelMask {
        let inside =
            |at: u32| (from..to).contains(&(at % SIZE)) && (from..to).contains(&(at / SIZE));
        let ids = (0..SIZE * SIZE)
            .map(|at| if inside(at) { LABEL } else { LabelId::NONE })
            .collect();
        LabelMask {
            width: SIZE,
            height: SIZE,
            ids,
        }
    }

    fn given(jitter_px: f64, seed: u64, truth: &LabelMask, include: bool) -> Vec<Click> {
        let mut annotator = Hand::new(
            &InteractOptions {
                jitter_px,
                seed,
                ..InteractOptions::default()
            },
            0,
        );
        let meant = LabelClick {
            label: LABEL,
            click: Click {
                at_px: DVec2::splat(32.0),
                include,
            },
            wrong_px: 1,
        };
        let empty = LabelMask::empty(SIZE, SIZE);
        let (truth, seen) = if include {
            (truth, &empty)
        } else {
            (&empty, truth)
        };
        (0..200)
            .map(|_| annotator.place(&meant, truth, seen))
            .collect()
    }

    #[test]
    fn clicks_scatter_inside_the_error_depending_on_the_seed() {
        for include in [true, false] {
            let truth = square(22, 42);
            let clicks = given(4.0, 7, &truth, include);
            assert_eq!(clicks, given(4.0, 7, &truth, include));
            assert_ne!(clicks, given(4.0, 8, &truth, include));
            let away: Vec<DVec2> = clicks
                .iter()
                .map(|click| click.at_px - DVec2::splat(32.0))
                .collect();
            assert!(
                away.iter().all(|away| away.abs().max_element() <= 10.0),
                "all are inside"
            );
            let spread =
                (away.iter().map(|away| away.length_squared()).sum::<f64>() / 400.0).sqrt();
            assert!((3.2..4.2).contains(&spread), "{spread} px along an axis");
        }
    }

    #[test]
    fn click_is_not_displaced_without_room_or_jitter() {
        let click = Click {
            at_px: DVec2::splat(32.0),
            include: true,
        };
        assert_eq!(given(0.0, 7, &square(10, 50), true), vec![click; 200]);
        assert_eq!(
            given(9.0, 7, &LabelMask::empty(SIZE, SIZE), true),
            vec![click; 200]
        );
    }
}
