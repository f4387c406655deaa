//! Selection of the image pairs to match, and geometric verification of their matches.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec2;
use rayon::prelude::*;

use super::cache::verified_matches;
use super::retrieval::{Vocabulary, most_alike};
use super::{
    FeatureCache, FeatureMatcher, Features, IntrinsicsPrior, MapCamera, SfmError, VerifiedPair,
};
use ostra_core::job::Progress;
use ostra_geometry::TwoViewOptions;

/// Options of pair selection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PairOptions {
    /// In sets of up to this many images, every image is compared with every other.
    pub exhaustive_up_to: usize,
    /// In larger sets: number of following images of the same sequence that an image is compared
    /// with. Those 2, 4, 8, … further on are added.
    pub window: usize,
    /// In larger sets: number of further images that each is compared with because their appearance is most similar.
    pub alike: usize,
    /// In larger sets: additional pairs (indices, in either order).
    pub given: Vec<(usize, usize)>,
    /// Seed for the sample of descriptors by which similarity is judged.
    pub seed: u64,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            exhaustive_up_to: 60,
            window: 10,
            alike: 10,
            given: Vec::new(),
            seed: 0,
        }
    }
}

/// Returns every pair (first < second) of `n` images.
#[must_use]
fn exhaustive_pairs(n: usize) -> BTreeSet<(usize, usize)> {
    (0..n)
        .flat_map(|first| (first + 1..n).map(move |second| (first, second)))
        .collect()
}

/// Pairs every image of a sequence of `n` with the next `window` ones and with those 2, 4, 8, … further on.
#[must_use]
fn sequence_pairs(n: usize, window: usize) -> BTreeSet<(usize, usize)> {
    let doubling = (0..usize::BITS - 1)
        .map(|k| 1 << k)
        .take_while(|&step| window > 0 && step < n);
    let steps: BTreeSet<usize> = (1..=window).chain(doubling).collect();
    (0..n)
        .flat_map(|first| steps.iter().map(move |step| (first, first + step)))
        .filter(|&(_, second)| second < n)
        .collect()
}

/// Returns the pairs of images to compare: ascending, first < second.
///
/// `sequence` holds for each image the sequence (folder, video) that it belongs to. Images of one
/// sequence follow each other in the order given. Windows do not cross sequences; pairs by
/// similarity do.
#[must_use]
pub fn choose_pairs(
    features: &[&Features],
    sequence: &[usize],
    options: &PairOptions,
) -> Vec<(usize, usize)> {
    let n = features.len();
    if n <= options.exhaustive_up_to {
        return exhaustive_pairs(n).into_iter().collect();
    }
    let mut pairs = windows(sequence, options.window);
    let ordered = options.given.iter().map(|&(a, b)| (a.min(b), a.max(b)));
    pairs.extend(ordered.filter(|&(first, second)| first < second && second < n));
    if options.alike > 0 {
        let pooled = Vocabulary::learn(features, options.seed).pool_all(features);
        pairs.extend(most_alike(&pooled, options.alike, &pairs));
    }
    pairs.into_iter().collect()
}

/// Returns [`sequence_pairs`] within each sequence.
fn windows(sequence: &[usize], window: usize) -> BTreeSet<(usize, usize)> {
    let ids: BTreeSet<usize> = sequence.iter().copied().collect();
    let mut pairs = BTreeSet::new();
    for id in ids {
        let members: Vec<usize> = (0..sequence.len())
            .filter(|&at| sequence[at] == id)
            .collect();
        pairs.extend(
            sequence_pairs(members.len(), window)
                .into_iter()
                .map(|(a, b)| (members[a], members[b])),
        );
    }
    pairs
}

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
    let done = AtomicUsize::new(0);
    let matcher = matcher.of_set(images.features)?;
    let tried = pairs.par_iter().map(|&(first, second)| {
        let matches = matcher(first, second)?;
        let tried = verify(
            [first, second].map(|image| images.get(image)),
            &matches,
            seed,
        );
        progress.step(done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len())?;
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

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::sfm::Descriptors;

    /// Returns features of an image of one of several places, each with its own descriptors.
    fn image(place: u64) -> Features {
        let mut random = Pcg64Mcg::seed_from_u64(place);
        Features {
            width: 10,
            height: 10,
            keypoints: vec![DVec2::ZERO; 100],
            scales_px: Vec::new(),
            scores: Vec::new(),
            descriptors: Descriptors::Bytes {
                dim: 8,
                values: (0..800).map(|_| random.random()).collect(),
            },
        }
    }

    #[test]
    fn sequences_pair_neighbours_and_doubling_steps() {
        let pairs = sequence_pairs(20, 3);
        let of_first: Vec<usize> = pairs
            .iter()
            .filter(|pair| pair.0 == 0)
            .map(|pair| pair.1)
            .collect();
        assert_eq!(of_first, [1, 2, 3, 4, 8, 16]);
        assert!(pairs.iter().all(|&(a, b)| a < b && b < 20));
        assert!(sequence_pairs(1, 3).is_empty() && sequence_pairs(9, 0).is_empty());
    }

    #[test]
    fn small_sets_are_compared_in_full() {
        let set: Vec<Features> = (0..4).map(image).collect();
        let pairs = choose_pairs(
            &set.iter().collect::<Vec<_>>(),
            &[0, 1, 2, 3],
            &PairOptions::default(),
        );
        assert_eq!(pairs, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]);
    }

    #[test]
    fn windows_stay_in_their_sequence_but_similarity_pairs_cross() {
        // Two folders, with images taken in turn; only images 0 and 7 show the same place.
        let set = [0, 1, 1, 2, 2, 3, 3, 0].map(image);
        let set: Vec<&Features> = set.iter().collect();
        let options = PairOptions {
            exhaustive_up_to: 0,
            window: 1,
            alike: 0,
            ..PairOptions::default()
        };
        let sequence = [0, 1, 0, 1, 0, 1, 0, 1];
        let near = choose_pairs(&set, &sequence, &options);
        assert_eq!(
            near,
            [
                (0, 2),
                (0, 4),
                (1, 3),
                (1, 5),
                (2, 4),
                (2, 6),
                (3, 5),
                (3, 7),
                (4, 6),
                (5, 7)
            ]
        );
        let alike = choose_pairs(
            &set,
            &sequence,
            &PairOptions {
                alike: 1,
                ..options
            },
        );
        assert!(
            near.iter()
                .chain(&[(0, 7)])
                .all(|pair| alike.contains(pair)),
            "{alike:?}"
        );
    }

    #[test]
    fn given_pairs_are_added_to_the_chosen_ones() {
        let set: Vec<Features> = (0..4).map(image).collect();
        let given = vec![(3, 0), (0, 3), (1, 1), (1, 7)];
        let options = PairOptions {
            exhaustive_up_to: 0,
            window: 1,
            alike: 0,
            given,
            ..PairOptions::default()
        };
        let pairs = choose_pairs(&set.iter().collect::<Vec<_>>(), &[0; 4], &options);
        assert_eq!(pairs, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]);
    }
}
