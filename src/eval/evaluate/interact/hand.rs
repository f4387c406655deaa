use std::f64::consts::TAU;

use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::simulated_click::LabelClick;
use ostra_masks::{Click, LabelMask};

/// How the robot user works.
///
/// The two prices follow from counts on DAVIS (`ostra eval interact`). A mean over frames costs least where
/// each corner adds as much everywhere. Drawing every visited frame to 0.90 whatever it took needed 7,333
/// clicks on `bmx-trees` for a mean of 0.90. One price of 0.0008 needed 6,329, but 490 on `libby`, where
/// keyframes carry far and a price of 0.004 needs 306. With one price up to [`Self::good_iou`] and a higher one beyond, it
/// takes 6,502 and 301. Drawing all frames coarsely first and finer in later rounds costs more (7,870 on
/// `bmx-trees`), because coarse polygons are drawn over; so only outlines that are good already are refined in
/// rounds. Frames from nothing are drawn by the same prices to the same mean, so that the price does not pass
/// for the tracker's merit. A border that is pulled counts as one click, as a moved corner does in Polygon-RNN
/// (Castrejón et al., CVPR 2017).
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

/// How often a displaced click that fell outside the error is drawn anew.
const DRAWS: usize = 16;

/// Puts clicks beside where they were meant, as a hand does.
pub struct Hand {
    jitter_px: f64,
    random: Pcg64Mcg,
}

impl Hand {
    /// A hand as the options say; hands of different `turn` draw differently.
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

    /// The click as it is given: displaced by the jitter, inside what is wrong of the label; as it was meant where a few
    /// draws find no such place.
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

    /// Normally distributed along both axes (G. E. P. Box, M. E. Muller, "A note on the generation of random normal
    /// deviates", The Annals of Mathematical Statistics, 1958).
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
        let mut hand = Hand::new(
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
        (0..200).map(|_| hand.place(&meant, truth, seen)).collect()
    }

    #[test]
    fn clicks_scatter_inside_the_error_and_the_seed_says_how() {
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
    fn without_room_or_jitter_a_click_stays() {
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
