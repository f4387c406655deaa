use std::collections::BTreeSet;

use pulp::Arch;
use rayon::prelude::*;

use crate::sfm::matching::Value;

/// Pairs (first < second, ascending) of each picture with the `k` others whose vectors (of length 1) have the largest
/// cosine with its own, besides pairs already `known`; the lower index first where two are equally alike. Vectors of
/// length 0 are like no other.
#[must_use]
pub fn most_alike(
    pooled: &[Vec<f32>],
    k: usize,
    known: &BTreeSet<(usize, usize)>,
) -> Vec<(usize, usize)> {
    let of_one = |one: usize| {
        let mut others: Vec<(f32, usize)> = (0..pooled.len())
            .filter(|&other| other != one && !known.contains(&(one.min(other), one.max(other))))
            .map(|other| (cosine(&pooled[one], &pooled[other]), other))
            .filter(|&(cosine, _)| cosine != 0.0)
            .collect();
        others.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        others
            .into_iter()
            .take(k)
            .map(|(_, other)| (one.min(other), one.max(other)))
            .collect::<Vec<_>>()
    };
    let pairs: BTreeSet<(usize, usize)> = (0..pooled.len())
        .into_par_iter()
        .flat_map_iter(of_one)
        .collect();
    pairs.into_iter().collect()
}

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    Arch::new().dispatch(|| f32::dot(a, b))
}
