//! Pairs of images that were left out with images of a model that see the same place.

use std::collections::{BTreeMap, BTreeSet};

use super::retrieval::{Vocabulary, most_alike_of};
use super::{Features, KeypointId, SparseModel, TriedPair};

/// Number of images that an image has most matches with, from which the map leads to others.
const SEEDS: usize = 4;
/// Number of images that see most of the same points as these.
const BY_MAP: usize = 12;
/// Number of images whose appearance is most similar.
const BY_APPEARANCE: usize = 12;

/// Returns pairs (first < second, ascending) of left-out images with images of the model.
///
/// An image probably sees what the images see that share points with its best matches, or that look
/// like it. Pairs that were tried are left out.
pub(super) fn nearby_pairs(
    left_out: &[usize],
    features: &[&Features],
    model: &SparseModel,
    tried: &[TriedPair],
    seed: u64,
) -> Vec<(usize, usize)> {
    let placed: Vec<usize> = model.placed().map(|image| image as usize).collect();
    let pairs = tried
        .iter()
        .map(|pair| pair.images.map(|image| image as usize));
    let known: BTreeSet<(usize, usize)> = pairs.map(|[a, b]| (a, b)).collect();
    let is_new = |a: usize, b: usize| !known.contains(&(a.min(b), a.max(b)));
    let open: Vec<usize> = left_out
        .iter()
        .copied()
        .filter(|&image| placed.iter().any(|&other| is_new(image, other)))
        .collect();
    if open.is_empty() {
        return Vec::new();
    }
    let pooled = Vocabulary::learn(features, seed).pool_all(features);
    let mut pairs = BTreeSet::new();
    for image in open {
        let new = |other: &usize| is_new(image, *other);
        let by_map = seen_with(&best_matches(image, model, tried), model);
        let by_map = by_map.into_iter().filter(new).take(BY_MAP);
        let others: Vec<usize> = placed.iter().copied().filter(new).collect();
        let alike = most_alike_of(&pooled, image, &others, BY_APPEARANCE);
        pairs.extend(
            by_map
                .chain(alike)
                .map(|other| (image.min(other), image.max(other))),
        );
    }
    pairs.into_iter().collect()
}

/// Returns the placed images that an image has most matches with; those that agree count most.
fn best_matches(image: usize, model: &SparseModel, tried: &[TriedPair]) -> Vec<u32> {
    let other = |pair: &TriedPair| match pair.images {
        [a, b] if a as usize == image => Some(b),
        [a, b] if b as usize == image => Some(a),
        _ => None,
    };
    let mut ranked: Vec<(usize, usize, u32)> = tried
        .iter()
        .filter_map(|pair| {
            let other = other(pair).filter(|&other| model.is_placed(other))?;
            let agreeing = pair
                .verified
                .as_ref()
                .map_or(0, |found| found.matches.len());
            Some((agreeing, pair.matches, other))
        })
        .collect();
    ranked.sort_unstable_by_key(|&(agreeing, matches, other)| {
        (std::cmp::Reverse((agreeing, matches)), other)
    });
    ranked
        .into_iter()
        .take(SEEDS)
        .map(|(.., other)| other)
        .collect()
}

/// Returns the placed images that see points of some others, those that see most first.
fn seen_with(seeds: &[u32], model: &SparseModel) -> Vec<usize> {
    let mut shared: BTreeMap<u32, usize> = BTreeMap::new();
    for (_, point) in model.points() {
        let sees = |image: u32| {
            point
                .track
                .iter()
                .any(|&KeypointId { image: of, .. }| of == image)
        };
        let weight = seeds.iter().filter(|&&seed| sees(seed)).count();
        if weight > 0 {
            for keypoint in &point.track {
                *shared.entry(keypoint.image).or_default() += weight;
            }
        }
    }
    let mut ranked: Vec<(usize, u32)> = shared.into_iter().map(|(image, n)| (n, image)).collect();
    ranked.sort_unstable_by_key(|&(count, image)| (std::cmp::Reverse(count), image));
    ranked
        .into_iter()
        .map(|(_, image)| image as usize)
        .collect()
}
