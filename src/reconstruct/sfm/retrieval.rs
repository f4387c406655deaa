//! Image similarity, measured by pooled descriptors.

use std::collections::BTreeSet;

use pulp::Arch;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

use super::matching::{Value, k_means, nearest_centres};
use super::{Descriptors, Features};

/// Number of centres that descriptors are assigned to.
const CENTRES: usize = 64;
/// Number of descriptors from which the centres are found.
const SAMPLE: usize = 8192;
/// Rounds of k-means; later ones hardly move the centres.
const ROUNDS: usize = 8;

/// Typical descriptors of a set of images, used to summarise each image in one vector.
#[derive(Debug, Clone, PartialEq)]
pub struct Vocabulary {
    kind: DescriptorKind,
    /// At most [`CENTRES`] rows.
    centres: Vec<f32>,
}

/// Properties that descriptors must share to be compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct DescriptorKind {
    dim: usize,
    bytes: bool,
}

impl DescriptorKind {
    fn of(descriptors: &Descriptors) -> Self {
        Self {
            dim: descriptors.dim().max(1),
            bytes: matches!(descriptors, Descriptors::Bytes { .. }),
        }
    }
}

impl Vocabulary {
    /// Learns a vocabulary by k-means over a seeded sample of the images' own descriptors.
    ///
    /// The kind of descriptor is that of the first image that has any.
    #[must_use]
    pub fn learn(features: &[&Features], seed: u64) -> Self {
        let all: Vec<&Descriptors> = features.iter().map(|one| &one.descriptors).collect();
        let first = all.iter().find(|one| !one.is_empty());
        let kind = first.map_or(
            DescriptorKind {
                dim: 1,
                bytes: false,
            },
            |first| DescriptorKind::of(first),
        );
        let fitting: Vec<&Descriptors> = all
            .into_iter()
            .filter(|one| DescriptorKind::of(one) == kind)
            .collect();
        Self {
            kind,
            centres: k_means(&sample(&fitting, kind.dim, seed), kind.dim, CENTRES, ROUNDS),
        }
    }

    /// Returns one vector of length 1 per image; the cosine of two measures how similar the images are.
    ///
    /// The vector is 0 for an image without descriptors, or with another kind than the
    /// vocabulary's.
    ///
    /// VLAD: H. Jégou et al., "Aggregating local descriptors into a compact image representation",
    /// CVPR 2010, with each centre's share scaled to length 1 as in R. Arandjelović and A.
    /// Zisserman, "All about VLAD", CVPR 2013.
    #[must_use]
    pub fn pooled(&self, features: &Features) -> Vec<f32> {
        if DescriptorKind::of(&features.descriptors) != self.kind {
            return vec![0.0; self.centres.len()];
        }
        match &features.descriptors {
            Descriptors::Bytes { values, .. } => self.pool(values),
            Descriptors::Floats { values, .. } => self.pool(values),
        }
    }

    /// Returns [`Self::pooled`] of each image.
    #[must_use]
    pub fn pool_all(&self, features: &[&Features]) -> Vec<Vec<f32>> {
        features.par_iter().map(|one| self.pooled(one)).collect()
    }

    fn pool<T: Value>(&self, values: &[T]) -> Vec<f32> {
        let mut sums = vec![0.0; self.centres.len()];
        let nearest = nearest_centres::<T, 1>(values, &self.centres, self.kind.dim);
        for (row, [centre]) in values.chunks_exact(self.kind.dim).zip(nearest) {
            let centre = centre as usize;
            let at = centre * self.kind.dim..(centre + 1) * self.kind.dim;
            let with_centre = sums[at.clone()].iter_mut().zip(&self.centres[at]);
            with_centre
                .zip(row)
                .for_each(|((sum, centre), value)| *sum += value.unit() - centre);
        }
        sums.chunks_exact_mut(self.kind.dim).for_each(normalise);
        normalise(&mut sums);
        sums
    }
}

fn normalise(values: &mut [f32]) {
    let length = f32::dot(values, values).sqrt();
    if length > 1e-9 {
        values.iter_mut().for_each(|value| *value /= length);
    }
}

/// Samples about [`SAMPLE`] descriptors, every one of the set equally likely.
fn sample(all: &[&Descriptors], dim: usize, seed: u64) -> Vec<f32> {
    let ends: Vec<usize> = all
        .iter()
        .scan(0, |end, one| {
            *end += one.len();
            Some(*end)
        })
        .collect();
    let count = ends.last().copied().unwrap_or(0);
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut rows = Vec::with_capacity(SAMPLE.min(count) * dim);
    for _ in 0..SAMPLE.min(count) {
        let at = random.random_range(0..count);
        let one = ends.partition_point(|&end| end <= at);
        let first = (at + all[one].len() - ends[one]) * dim;
        match all[one] {
            Descriptors::Bytes { values, .. } => {
                rows.extend(values[first..first + dim].iter().map(|value| value.unit()));
            }
            Descriptors::Floats { values, .. } => {
                rows.extend_from_slice(&values[first..first + dim]);
            }
        }
    }
    rows
}

/// Returns pairs of each image with the `k` others of largest cosine, besides pairs already `known`.
///
/// Pairs are ascending, first < second. The vectors have length 1. The lower index comes first if
/// two are equally similar. Vectors of length 0 are similar to no other.
#[must_use]
pub fn most_alike(
    pooled: &[Vec<f32>],
    k: usize,
    known: &BTreeSet<(usize, usize)>,
) -> Vec<(usize, usize)> {
    let of_one = |one: usize| {
        let others: Vec<usize> = (0..pooled.len())
            .filter(|&other| other != one && !known.contains(&(one.min(other), one.max(other))))
            .collect();
        most_alike_of(pooled, one, &others, k)
            .into_iter()
            .map(|other| (one.min(other), one.max(other)))
            .collect::<Vec<_>>()
    };
    let pairs: BTreeSet<(usize, usize)> = (0..pooled.len())
        .into_par_iter()
        .flat_map_iter(of_one)
        .collect();
    pairs.into_iter().collect()
}

/// Returns the `k` of some other images with the largest cosine, the largest first, as [`most_alike`].
#[must_use]
pub fn most_alike_of(pooled: &[Vec<f32>], one: usize, others: &[usize], k: usize) -> Vec<usize> {
    let mut ranked: Vec<(f32, usize)> = others
        .iter()
        .map(|&other| (cosine(&pooled[one], &pooled[other]), other))
        .filter(|&(cosine, _)| cosine != 0.0)
        .collect();
    ranked.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    ranked.into_iter().take(k).map(|(_, other)| other).collect()
}

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    Arch::new().dispatch(|| f32::dot(a, b))
}

#[cfg(test)]
mod tests;
