use super::options::CarryOptions;
use super::pixel_box::PixelBox;
use super::smooth::{Passing, first_round_share, smooth};
use super::tolerance::Tolerance;
use ostra_frames::Image;

/// For each pixel of a box how far it belongs to a label, −1 to 1, from the balance and weight of its votes and of those
/// that reach it over even surfaces; −1 where none do.
pub fn belonging(votes: &[[f32; 2]], passing: Passing, options: &CarryOptions) -> Vec<f32> {
    let mut spread = votes.to_vec();
    smooth(&mut spread, passing);
    let decide = |(own, spread): (&[f32; 2], &[f32; 2])| {
        let balance = options.own_weight * own[0] + spread[0];
        let weight = options.own_weight * own[1] + spread[1];
        if weight > options.least_weight {
            balance / weight
        } else {
            -1.0
        }
    };
    votes.iter().zip(&spread).map(decide).collect()
}

/// Largest difference of two colours: the sum over channels.
const COLORS: usize = 3 * 255 + 1;

/// How votes pass between the pixels of a box: less over edges of colour and jumps of depth.
pub fn passing(
    image: &Image,
    depths: &[f32],
    within: PixelBox,
    tolerance: &Tolerance,
    options: &CarryOptions,
) -> Passing {
    let even = shares(0.0, options);
    let jump = shares(options.depth_edge_px, options);
    let depths = bridged(depths, image.width as usize);
    let share = |a: usize, b: usize| {
        let (p, q) = (image.pixels[a], image.pixels[b]);
        let difference: u16 = (0..3).map(|c| u16::from(p[c].abs_diff(q[c]))).sum();
        let (near, far) = (depths[a].min(depths[b]), depths[a].max(depths[b]));
        let jumps = near > 0.0 && far - near > tolerance.at(near);
        if jumps {
            jump[usize::from(difference)]
        } else {
            even[usize::from(difference)]
        }
    };
    let (width, full) = (within.width(), image.width as usize);
    let mut across = vec![0.0; width * within.height()];
    let mut down = across.clone();
    for (y, (across, down)) in (within.top..).zip(
        across
            .chunks_exact_mut(width)
            .zip(down.chunks_exact_mut(width)),
    ) {
        let first = y * full + within.left;
        for (x, across) in across.iter_mut().enumerate().skip(1) {
            *across = share(first + x - 1, first + x);
        }
        if y > within.top {
            for (x, down) in down.iter_mut().enumerate() {
                *down = share(first + x - full, first + x);
            }
        }
    }
    Passing {
        width,
        across,
        down,
    }
}

/// Depths with those of the nearest pixel that has one in every hole, so that a hole between two surfaces is no way from
/// one to the other.
fn bridged(depths: &[f32], width: usize) -> Vec<f32> {
    let mut bridged = depths.to_vec();
    let mut steps: Vec<u32> = depths
        .iter()
        .map(|&depth| if depth > 0.0 { 0 } else { u32::MAX / 2 })
        .collect();
    let mut take = |at: usize, from: Option<usize>| {
        if let Some(from) = from.filter(|&from| steps[from] + 1 < steps[at]) {
            (steps[at], bridged[at]) = (steps[from] + 1, bridged[from]);
        }
    };
    for at in 0..depths.len() {
        take(at, at.checked_sub(1).filter(|_| at % width > 0));
        take(at, at.checked_sub(width));
    }
    for at in (0..depths.len()).rev() {
        take(
            at,
            Some(at + 1).filter(|next| next % width > 0 && *next < depths.len()),
        );
        take(at, Some(at + width).filter(|&next| next < depths.len()));
    }
    bridged
}

/// By difference of colour how much passes over a step that is `extra_px` longer.
fn shares(extra_px: f32, options: &CarryOptions) -> [f32; COLORS] {
    let rate = -(2f32.sqrt()) / (options.reach_px * first_round_share());
    std::array::from_fn(|difference| {
        let color = options.color_edge_px * difference as f32 / 255.0;
        (rate * (1.0 + color + extra_px)).exp()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hole_takes_the_depth_of_the_nearer_side() {
        let depths = [1.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(
            bridged(&depths, 6),
            [1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0]
        );
        assert_eq!(bridged(&[0.0; 4], 2), [0.0; 4]);
    }
}
