use rayon::prelude::*;

use super::consistency::Neighbour;
use super::gaps::fill_gaps;
use super::options::FilterOptions;
use super::speckles::remove_speckles;
use crate::stereo::DepthEstimate;

/// Keeps the depths that enough neighbours agree with; takes speckles out and fills small gaps.
#[must_use]
pub fn filter(
    own: &DepthEstimate,
    neighbours: &[Neighbour],
    options: &FilterOptions,
) -> DepthEstimate {
    let width = own.width().max(1);
    let needed = options.min_agreeing.clamp(1, neighbours.len().max(1));
    let least = (255.0 * options.min_confidence) as u8;
    let agreeing = |at: usize| {
        let depth = own.depths[at];
        if depth <= 0.0 || own.confidence[at] < least {
            return 0;
        }
        let (place, normal) = (((at % width) as f32, (at / width) as f32), own.normal(at));
        let agrees = |neighbour: &&Neighbour| {
            neighbour
                .matched(place, 1.0 / depth, normal, &options.agreement)
                .is_some()
        };
        neighbours.iter().filter(agrees).count() as u8
    };
    let support: Vec<u8> = (0..own.depths.len())
        .into_par_iter()
        .map(agreeing)
        .collect();
    let mut kept = own.clone();
    (0..support.len())
        .filter(|&at| usize::from(support[at]) < needed)
        .for_each(|at| kept.clear(at));
    remove_speckles(
        &mut kept,
        &support,
        options.min_support,
        options.surface_tolerance,
    );
    fill_gaps(&mut kept, own, options);
    kept
}
