//! Depth maps corrected by the image: holes are filled and borders moved.

use rayon::prelude::*;

use super::depth_surfaces::known;
use crate::lab::{lab_of, squared_difference};
use ostra_frames::{DepthMap, Image};

/// Reach of the neighbourhood to each side, pixels.
const REACH: usize = 8;
/// Standard deviation of the distance weight, pixels.
const SPREAD_PX: f32 = 3.0;
/// Standard deviation of the colour weight, ΔE.
const SPREAD_DELTA_E: f32 = 5.0;
/// Votes with a weight below exp(−12) are ignored.
const LEAST: f32 = 12.0;
/// Maximum difference of ln depth within one surface.
const SAME: f32 = 0.03;
/// Maximum number of surfaces distinguished around a pixel.
const SURFACES: usize = 6;

/// Weight of a pixel's own depth when borders are moved.
///
/// A neighbour of the same colour has a weight of up to 1.
const OWN: f32 = 5.0;
/// Pixels to each side of a jump that are updated.
const BESIDE: usize = 3;
/// Minimum relative difference of depth that is a jump.
const JUMP: f32 = 0.04;
/// Number of iterations that move borders.
const SETTLING: usize = 2;

/// Votes of depths around a pixel by surface: sums of weights and of weighted ln depths.
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

    /// Returns the depth of the surface with the most votes; 0 without votes.
    fn winner(&self) -> f32 {
        let best = self.sums[..self.count]
            .iter()
            .max_by(|a, b| a.0.total_cmp(&b.0));
        best.map_or(0.0, |(weights, depths)| (depths / weights).exp())
    }
}

/// Returns the depth map with unknown depths filled in.
///
/// Each unknown depth is taken from the surface that most similarly coloured pixels around it lie
/// on. The method follows J. Kopf et al., *Joint Bilateral Upsampling*, SIGGRAPH 2007, with a vote
/// instead of the mean. A vote yields no depth between two surfaces. Depths farther than [`REACH`]
/// from any known one stay unknown.
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

/// Returns the depth map with its borders moved to where colours change.
///
/// Near a jump, each pixel takes the surface of similarly coloured pixels around it, unless its own
/// depth outweighs them. This suits depths from stereo, whose borders are a few pixels off. Depths
/// of a sensor are better left unchanged. `image` has the size of the map.
#[must_use]
pub fn settled(depth: &DepthMap, image: &Image) -> DepthMap {
    let lab = lab_of(image);
    let mut settled = depth.clone();
    for _ in 0..SETTLING {
        let before = settled;
        let vote = |at: usize| {
            let own = before.depths[at];
            if !known(own) || !is_adjacent_to_jump(&before, at) {
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

/// Returns whether another surface begins within a few pixels.
fn is_adjacent_to_jump(depth: &DepthMap, at: usize) -> bool {
    let own = depth.depths[at];
    around(depth, at, BESIDE)
        .any(|from| known(depth.depths[from]) && (depth.depths[from] / own - 1.0).abs() > JUMP)
}

/// Adds the votes of the pixels around one, weighted by distance and colour similarity.
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

/// Returns the pixels of the square around one, row by row.
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

    /// Returns a green stripe three pixels wide at depth 1 in front of a grey wall at depth 2.
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
    fn holes_are_filled_along_color_borders() {
        let (lab, truth) = stripe();
        let mut damaged = truth.clone();
        for y in 0..30 {
            if y % 10 < 4 {
                damaged.depths[y * 40 + 18..y * 40 + 26].fill(0.0);
            }
        }
        let repaired = completed(&damaged, &lab);
        let wrong = repaired
            .depths
            .iter()
            .zip(&truth.depths)
            .filter(|(a, b)| (*a - *b).abs() > 0.02)
            .count();
        assert_eq!(wrong, 0);
    }

    #[test]
    fn known_depths_stay_bit_exact_and_distant_holes_stay_unknown() {
        let (lab, mut depth) = stripe();
        assert!(completed(&depth, &lab) == depth);
        depth.depths.fill(0.0);
        depth.depths[0] = 1.5;
        let completed = completed(&depth, &lab);
        assert_eq!(completed.depths[15 * 40 + 30], 0.0);
        assert!((completed.depths[3 * 40 + 3] - 1.5).abs() < 1e-5);
    }

    #[test]
    fn borders_move_to_color_changes() {
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
        // The stripe's depth is shifted one pixel to the right.
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
