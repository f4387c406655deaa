use super::options::CarryOptions;
use super::pixel_box::PixelBox;
use super::smooth::{Passing, first_round_share, smooth};
use super::tolerance::Tolerance;
use super::viewpoint::Viewpoint;
use crate::frames::Image;

/// For each pixel of a box how far it belongs to a label, −1 to 1, from the balance and weight of its votes and of those
/// that reach it over even surfaces; −1 where none do.
pub fn belonging(votes: &[[f32; 2]], passing: Passing, options: &CarryOptions) -> Vec<f32> {
    let mut spread = votes.to_vec();
    smooth(&mut spread, passing);
    let decide = |(own, spread): (&[f32; 2], &[f32; 2])| {
        let balance = options.own_weight * own[0] + spread[0];
        let weight = options.own_weight * own[1] + spread[1];
        if weight > options.least_weight { balance / weight } else { -1.0 }
    };
    votes.iter().zip(&spread).map(decide).collect()
}

/// How votes pass between the pixels of a box: less over edges of colour and jumps of depth.
pub fn passing(
    image: &Image,
    target: &Viewpoint,
    within: PixelBox,
    tolerance: &Tolerance,
    options: &CarryOptions,
) -> Passing {
    let (width, full) = (within.width(), target.width());
    let rate = -(2f32.sqrt()) / (options.reach_px * first_round_share());
    let depths = &target.depth.depths;
    let share = |a: usize, b: usize| {
        let difference: u32 = image.pixels[a].iter().zip(image.pixels[b]).map(|(&p, q)| u32::from(p.abs_diff(q))).sum();
        let (near, far) = (depths[a].min(depths[b]), depths[a].max(depths[b]));
        let jump = near > 0.0 && far - near > tolerance.at(near);
        let edge = options.color_edge_px * difference as f32 / 255.0 + if jump { options.depth_edge_px } else { 0.0 };
        (rate * (1.0 + edge)).exp()
    };
    let mut across = vec![0.0; width * within.height()];
    let mut down = across.clone();
    for (i, (across, down)) in across.iter_mut().zip(&mut down).enumerate() {
        let (x, y) = (within.left + i % width, within.top + i / width);
        let at = y * full + x;
        if x > within.left {
            *across = share(at - 1, at);
        }
        if y > within.top {
            *down = share(at - full, at);
        }
    }
    Passing { width, across, down }
}
