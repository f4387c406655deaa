use std::f64::consts::TAU;

use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::InteractOptions;
use ostra_masks::{Click, LabelClick, LabelMask};

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
