//! Matching of image pairs, and geometric verification of their matches.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec2;
use rayon::prelude::*;

use super::cache::verified_matches;
use super::{
    FeatureCache, FeatureMatcher, Features, IntrinsicsPrior, MapCamera, PairMatches, SfmError,
    VerifiedPair,
};
use ostra_core::job::{Progress, Stopped};
use ostra_geometry::TwoViewOptions;

/// A pair of images that was matched.
#[derive(Debug, Clone, PartialEq)]
pub struct TriedPair {
    /// The two images, the lower number first.
    pub images: [u32; 2],
    /// Number of matches before geometric verification.
    pub matches: usize,
    /// The verified pair, if enough matches agree.
    pub verified: Option<VerifiedPair>,
}

/// Images that are matched with each other.
#[derive(Debug, Clone, Copy)]
pub struct MatchedImages<'a> {
    /// Features of each image.
    pub features: &'a [&'a Features],
    /// Camera of each image.
    pub cameras: &'a [MapCamera],
    /// Keeps verified pairs.
    pub cache: Option<&'a FeatureCache>,
}

impl<'a> MatchedImages<'a> {
    fn get(self, image: usize) -> MatchedImage<'a> {
        MatchedImage {
            image,
            features: self.features[image],
            camera: self.cameras[image],
            cache: self.cache,
        }
    }
}

/// One of the images that are matched with each other.
#[derive(Clone, Copy)]
pub(super) struct MatchedImage<'a> {
    /// Its number.
    pub image: usize,
    /// Its features.
    pub features: &'a Features,
    /// Its camera.
    pub camera: MapCamera,
    /// Keeps verified pairs.
    pub cache: Option<&'a FeatureCache>,
}

/// Matches pairs of images and keeps the matches that agree with a two-view geometry.
///
/// The result is in the order of the pairs.
///
/// # Errors
/// [`SfmError`] if the matcher fails or the run is stopped.
pub fn match_pairs(
    images: MatchedImages<'_>,
    pairs: &[(usize, usize)],
    matcher: &dyn FeatureMatcher,
    seed: u64,
    progress: &Progress,
) -> Result<Vec<TriedPair>, SfmError> {
    let matcher = matcher.of_set(images.features)?;
    let step = |done: usize| progress.step(done, pairs.len());
    match_each(images, pairs, &matcher, seed, &step)
}

/// Matches pairs as [`match_pairs`]; `step` is given how many are done.
pub(super) fn match_each(
    images: MatchedImages<'_>,
    pairs: &[(usize, usize)],
    matcher: &PairMatches<'_>,
    seed: u64,
    step: &(dyn Fn(usize) -> Result<(), Stopped> + Sync),
) -> Result<Vec<TriedPair>, SfmError> {
    let done = AtomicUsize::new(0);
    let tried = pairs.par_iter().map(|&(first, second)| {
        let matches = matcher(first, second)?;
        let both = [first, second].map(|image| images.get(image));
        let tried = verify(both, &matches, seed);
        step(done.fetch_add(1, Ordering::Relaxed) + 1)?;
        Ok(tried)
    });
    tried.collect()
}

/// Verifies the matches of two images; the lower number comes first.
pub(super) fn verify(both: [MatchedImage<'_>; 2], matches: &[(u32, u32)], seed: u64) -> TriedPair {
    let images = both.map(|matched| matched.image as u32);
    TriedPair {
        images,
        matches: matches.len(),
        verified: agreeing(both, matches, seed),
    }
}

fn agreeing(
    both: [MatchedImage<'_>; 2],
    matches: &[(u32, u32)],
    seed: u64,
) -> Option<VerifiedPair> {
    let [a, b] = both;
    let at_px: Vec<[DVec2; 2]> = matches
        .iter()
        .map(|&(i, j)| {
            [
                a.features.keypoints[i as usize],
                b.features.keypoints[j as usize],
            ]
        })
        .collect();
    let options = TwoViewOptions {
        seed: seed ^ ((a.image as u64) << 32 | b.image as u64),
        ..TwoViewOptions::default()
    };
    let calibrated = both
        .iter()
        .all(|matched| matched.camera.source == IntrinsicsPrior::Given);
    let found = verified_matches(
        a.cache,
        [&a.camera.intrinsics, &b.camera.intrinsics],
        calibrated,
        &at_px,
        &options,
    )?;
    let chosen = |&i: &u32| matches[i as usize];
    Some(VerifiedPair {
        images: [a.image as u32, b.image as u32],
        matches: found
            .inliers
            .iter()
            .map(chosen)
            .map(|(i, j)| [i, j])
            .collect(),
        kind: found.kind,
        second_from_first: found.second_from_first,
        parallax: found.parallax,
    })
}
