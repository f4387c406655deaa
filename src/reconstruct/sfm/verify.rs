use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec2;
use rayon::prelude::*;

use super::{FeatureMatcher, Features, IntrinsicsSource, MapCamera, SfmError, VerifiedPair};
use ostra_core::job::Progress;
use ostra_geometry::{TwoViewOptions, estimate_two_view};

/// A pair of images that was matched.
#[derive(Debug, Clone, PartialEq)]
pub struct TriedPair {
    /// The two images, the lower number first.
    pub images: [u32; 2],
    /// Matches before they had to agree with a geometry.
    pub matches: usize,
    /// What agreed, where enough did.
    pub verified: Option<VerifiedPair>,
}

/// Matches pairs of images and keeps the matches that agree with a geometry of the two views; in the order of the pairs.
///
/// # Errors
/// [`SfmError`] where the matcher fails, and when stopped.
pub fn match_pairs(
    features: &[&Features],
    cameras: &[MapCamera],
    pairs: &[(usize, usize)],
    matcher: &dyn FeatureMatcher,
    seed: u64,
    progress: &Progress,
) -> Result<Vec<TriedPair>, SfmError> {
    let done = AtomicUsize::new(0);
    let matcher = matcher.of_pairs(features, pairs)?;
    let tried = pairs.par_iter().map(|&(first, second)| {
        let matches = matcher(first, second)?;
        let both = [
            (first, features[first], cameras[first]),
            (second, features[second], cameras[second]),
        ];
        let tried = verify(both, &matches, seed);
        progress.step(done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len())?;
        Ok(tried)
    });
    tried.collect()
}

/// The matches of two images, given by number, that agree with a geometry; the image with the lower number first.
pub(super) fn verify(
    both: [(usize, &Features, MapCamera); 2],
    matches: &[(u32, u32)],
    seed: u64,
) -> TriedPair {
    let images = both.map(|(image, _, _)| image as u32);
    TriedPair {
        images,
        matches: matches.len(),
        verified: agreeing(both, matches, seed),
    }
}

fn agreeing(
    both: [(usize, &Features, MapCamera); 2],
    matches: &[(u32, u32)],
    seed: u64,
) -> Option<VerifiedPair> {
    let [(first, a, camera_a), (second, b, camera_b)] = both;
    let at_px: Vec<[DVec2; 2]> = matches
        .iter()
        .map(|&(i, j)| [a.keypoints[i as usize], b.keypoints[j as usize]])
        .collect();
    let options = TwoViewOptions {
        seed: seed ^ ((first as u64) << 32 | second as u64),
        ..TwoViewOptions::default()
    };
    let calibrated = [camera_a, camera_b]
        .iter()
        .all(|camera| camera.source == IntrinsicsSource::Given);
    let found = estimate_two_view(
        [&camera_a.intrinsics, &camera_b.intrinsics],
        calibrated,
        &at_px,
        &options,
    )?;
    let chosen = |&i: &u32| matches[i as usize];
    Some(VerifiedPair {
        images: [first as u32, second as u32],
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
