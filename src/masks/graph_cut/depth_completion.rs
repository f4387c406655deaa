//! Depth maps corrected by the image: holes filled, borders moved.

use rayon::prelude::*;

use super::depth_surfaces::known;
use crate::lab::{lab_of, squared_difference};
use ostra_frames::{DepthMap, Image};

/// Pixels to each side that are asked.
const REACH: usize = 8;
/// Standard deviation of what their distance counts, pixels.
const SPREAD_PX: f32 = 3.0;
/// Standard deviation of what their colour counts, ΔE.
const SPREAD_DELTA_E: f32 = 5.0;
/// Votes of less than e to minus this are none.
const LEAST: f32 = 12.0;
/// Depths this near to each other are one surface, ln depth.
const SAME: f32 = 0.03;
/// Surfaces distinguished around a pixel.
const SURFACES: usize = 6;

/// What a pixel's own depth counts where borders are settled; a neighbour of the same colour counts up to 1.
const OWN: f32 = 5.0;
/// Pixels to each side of a jump that are settled.
const BESIDE: usize = 3;
/// A difference of depth that is a jump, as a share.
const JUMP: f32 = 0.04;
/// How often borders are settled.
const SETTLING: usize = 2;

/// Depths around one pixel by surface: sums of weights and of weighted ln depths.
#[derive(Default)]
struct Ballot {
    sums: [(f32, f32); SURFACES],
    count: usize,
}

impl Ballot {
    fn add(&mut self, ln_depth: f32, weight: f32) {
        let near = |&(weights, depths): &(f32, f32)| (depths / weights - ln_depth).abs();
        let held = &mut self.sums[..self.count];
        match held.iter_mut().min_by(|a, b| near(a).total_cmp(&near(b))) {
            Some(sum) if near(sum) < SAME => *sum = (sum.0 + weight, sum.1 + weight * ln_depth),
            _ if self.count < SURFACES => {
                self.sums[self.count] = (weight, weight * ln_depth);
                self.count += 1;
            }
            _ => {}
        }
    }

    /// The depth of the surface with most votes; 0 without any.
    fn winner(&self) -> f32 {
        let best = self.sums[..self.count]
            .iter()
            .max_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(0.0, |(weights, depths)| (depths / weights).exp())
    }
}

/// The depth map with each unknown depth taken from the surface that most of the like-coloured pixels around it lie on (after
/// J. Kopf et al., *Joint Bilateral Upsampling*, SIGGRAPH 2007, with a vote for the mean: no depth between two surfaces comes
/// up). Depths farther than [`REACH`] from any known one stay unknown.
pub(super) fn completed(depth: &DepthMap, lab: &[[f32; 3]]) -> DepthMap {
    let vote = |at: usize| {
        let own = depth.depths[at];
        if known(own) {
            own
        } else {
            with_neighbours(Ballot::default(), depth, lab, at).winner()
        }
    };
    DepthMap {
        depths: (0..depth.depths.len()).into_par_iter().map(vote).collect(),
        ..*depth
    }
}

/// The depth map with its borders moved to where colours change: near a jump each pixel takes the surface of the
/// like-coloured pixels around it, unless its own depth outweighs them. For depths that stereo made, whose borders lie a few
/// pixels off; a sensor's are better left as they are. `image` has the map's size.
#[must_use]
pub fn settled(depth: &DepthMap, image: &Image) -> DepthMap {
    let lab = lab_of(image);
    let mut settled = depth.clone();
    for _ in 0..SETTLING {
        let before = settled;
        let vote = |at: usize| {
            let own = before.depths[at];
            if !known(own) || !is_beside_jump(&before, at) {
                return own;
            }
            let mut ballot = Ballot::default();
            ballot.add(own.ln(), OWN);
            with_neighbours(ballot, &before, &lab, at).winner()
        };
        settled = DepthMap {
            depths: (0..before.depths.len()).into_par_iter().map(vote).collect(),
            ..before
        };
    }
    settled
}

/// Whether another surface begins within a few pixels.
fn is_beside_jump(depth: &DepthMap, at: usize) -> bool {
    let own = depth.depths[at];
    around(depth, at, BESIDE)
        .any(|from| known(depth.depths[from]) && (depth.depths[from] / own - 1.0).abs() > JUMP)
}

/// Adds the votes of the other pixels around one, the nearer and the more alike the more.
fn with_neighbours(mut ballot: Ballot, depth: &DepthMap, lab: &[[f32; 3]], at: usize) -> Ballot {
    let width = depth.width as usize;
    for from in around(depth, at, REACH).filter(|&from| from != at && known(depth.depths[from])) {
        let apart = ((from / width).abs_diff(at / width).pow(2)
            + (from % width).abs_diff(at % width).pow(2)) as f32;
        let color = squared_difference(lab[at], lab[from]);
        let unlike =
            apart / (2.0 * SPREAD_PX * SPREAD_PX) + color / (2.0 * SPREAD_DELTA_E * SPREAD_DELTA_E);
        if unlike < LEAST {
            ballot.add(depth.depths[from].ln(), (-unlike).exp());
        }
    }
    ballot
}

/// The pixels of the square around one, row by row.
fn around(depth: &DepthMap, at: usize, reach: usize) -> impl Iterator<Item = usize> + use<> {
    let (width, height) = (depth.width as usize, depth.height as usize);
    let (x, y) = (at % width, at / width);
    let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
    (y.saturating_sub(reach)..(y + reach + 1).min(height))
        .flat_map(move |row| columns.clone().map(move |column| row * width + column))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GREEN: [f32; 3] = [60.0, -40.0, 40.0];
    const GREY: [f32; 3] = [60.0, 0.0, 0.0];

    /// A green stripe three pixels wide at depth 1 before a grey wall at 2.
    fn stripe() -> (Vec<[f32; 3]>, DepthMap) {
        let is_stripe = |at: usize| (20..23).contains(&(at % 40));
        let lab = (0..40 * 30)
            .map(|at| if is_stripe(at) { GREEN } else { GREY })
            .collect();
        let depths = (0..40 * 30)
            .map(|at| if is_stripe(at) { 1.0 } else { 2.0 })
            .collect();
        (
            lab,
            DepthMap {
                width: 40,
                height: 30,
                depths,
            },
        )
    }

    #[test]
    fn holes_follow_the_colours() {
        let (lab, truth) = stripe();
        let mut damaged = truth.clone();
        for y in 0..30 {
            if y % 10 < 4 {
                damaged.depths[y * 40 + 18..y * 40 + 26].fill(0.0);
            }
        }
        let mended = completed(&damaged, &lab);
        let wrong = mended
            .depths
            .iter()
            .zip(&truth.depths)
            .filter(|(a, b)| (*a - *b).abs() > 0.02)
            .count();
        assert_eq!(wrong, 0);
    }

    #[test]
    fn what_is_sound_stays_to_the_bit_and_what_is_far_from_all_stays_unknown() {
        let (lab, mut depth) = stripe();
        assert!(completed(&depth, &lab) == depth);
        depth.depths.fill(0.0);
        depth.depths[0] = 1.5;
        let completed = completed(&depth, &lab);
        assert_eq!(completed.depths[15 * 40 + 30], 0.0);
        assert!((completed.depths[3 * 40 + 3] - 1.5).abs() < 1e-5);
    }

    #[test]
    fn borders_move_to_where_colours_change() {
        let (lab, truth) = stripe();
        let image = Image {
            width: 40,
            height: 30,
            pixels: lab
                .iter()
                .map(|lab| {
                    if *lab == GREEN {
                        [20, 160, 40]
                    } else {
                        [145, 145, 145]
                    }
                })
                .collect(),
        };
        // The stripe's depth lies a pixel to the right of it.
        let mut shifted = truth.clone();
        for row in shifted.depths.chunks_mut(40) {
            row.rotate_right(1);
        }
        let wrong = |depth: &DepthMap| {
            depth
                .depths
                .iter()
                .zip(&truth.depths)
                .filter(|(a, b)| (*a - *b).abs() > 0.02)
                .count()
        };
        assert_eq!(wrong(&shifted), 60);
        assert!(
            wrong(&settled(&shifted, &image)) < 6,
            "{}",
            wrong(&settled(&shifted, &image))
        );
        assert!(
            settled(&truth, &image)
                .depths
                .iter()
                .zip(&truth.depths)
                .all(|(a, b)| (a - b).abs() < 0.02)
        );
    }
}
