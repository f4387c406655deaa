//! The view graph: which images agree with which, and what the tracks of their matches say about
//! pairs that were not matched yet.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

use super::Features;
use super::pairs::TriedPair;
use ostra_core::union_find::DisjointSets;

/// Longer tracks are thinned to this many images, because every two of them are counted.
const COUNTED_IMAGES: usize = 48;

/// Two images, the lower number first.
pub(super) type ImagePair = (usize, usize);

/// Images with the pairs that were matched, and the tracks of the matches that agree.
pub(super) struct ViewGraph {
    /// Number of the first keypoint of each image, counted over all images; one more at the end.
    first_keypoint: Vec<u32>,
    /// Keypoints that matches lead to from each other.
    tracks: DisjointSets,
    /// Whether a keypoint has a match that agrees.
    is_matched: Vec<bool>,
    /// Number of matches that agree, by pair.
    agreeing: BTreeMap<ImagePair, usize>,
}

impl ViewGraph {
    /// Creates the graph of images of which no pair was matched.
    pub fn new(features: &[&Features]) -> Self {
        let mut first_keypoint = vec![0];
        for image in features {
            let end = first_keypoint[first_keypoint.len() - 1] + image.keypoints.len() as u32;
            first_keypoint.push(end);
        }
        let count = first_keypoint[first_keypoint.len() - 1] as usize;
        Self {
            first_keypoint,
            tracks: DisjointSets::new(count),
            is_matched: vec![false; count],
            agreeing: BTreeMap::new(),
        }
    }

    /// Adds a pair that was matched.
    pub fn add(&mut self, pair: &TriedPair) {
        let [a, b] = pair.images.map(|image| image as usize);
        let matches = pair.verified.as_ref().map(|verified| &verified.matches[..]);
        let matches = matches.unwrap_or_default();
        self.agreeing.insert((a, b), matches.len());
        for &[i, j] in matches {
            let (first, second) = (self.first_keypoint[a] + i, self.first_keypoint[b] + j);
            self.tracks.unite(first, second);
            self.is_matched[first as usize] = true;
            self.is_matched[second as usize] = true;
        }
    }

    /// Returns whether a pair was matched.
    pub fn is_tried(&self, a: usize, b: usize) -> bool {
        self.agreeing.contains_key(&(a.min(b), a.max(b)))
    }

    /// Returns the number of images.
    pub fn images(&self) -> usize {
        self.first_keypoint.len() - 1
    }

    /// Returns for each image how the others support it with which at least `enough` matches agree.
    pub fn support(&self, enough: usize) -> Vec<ImageSupport> {
        let mut most = vec![0; self.images()];
        let linked = || self.agreeing.iter().filter(|&(_, &count)| count >= enough);
        for (&(a, b), &count) in linked() {
            most[a] = count.max(most[a]);
            most[b] = count.max(most[b]);
        }
        let mut support = vec![ImageSupport::default(); self.images()];
        for (&(a, b), &count) in linked() {
            for image in [a, b] {
                support[image].partners += 1;
                support[image].wide += usize::from(2 * count <= most[image]);
            }
        }
        support
    }

    /// Returns the component of each image: the lowest image that links of at least `enough`
    /// matches lead to.
    pub fn components(&self, enough: usize) -> Vec<usize> {
        let mut sets = DisjointSets::new(self.images());
        let linked = self.agreeing.iter().filter(|&(_, &count)| count >= enough);
        for (&(a, b), _) in linked {
            sets.unite(a as u32, b as u32);
        }
        let roots = sets.into_roots().into_iter();
        roots.map(|root| root as usize).collect()
    }

    /// Returns for each image the others that share at least `enough` tracks with it and were not
    /// matched with it, those that share most first.
    ///
    /// The number of tracks is about the least number of matches that would agree.
    pub fn unmatched_by_tracks(&mut self, enough: usize) -> Vec<Vec<SharedTracks>> {
        let mut shared: FxHashMap<ImagePair, usize> = FxHashMap::default();
        for images in self.images_of_tracks() {
            for (at, &a) in images.iter().enumerate() {
                for &b in &images[at + 1..] {
                    *shared.entry((a, b)).or_default() += 1;
                }
            }
        }
        let mut by_image: Vec<Vec<SharedTracks>> = vec![Vec::new(); self.images()];
        for ((a, b), tracks) in shared {
            if tracks >= enough && !self.is_tried(a, b) {
                by_image[a].push(SharedTracks { tracks, other: b });
                by_image[b].push(SharedTracks { tracks, other: a });
            }
        }
        for others in &mut by_image {
            others.sort_unstable_by_key(|one| (std::cmp::Reverse(one.tracks), one.other));
        }
        by_image
    }

    /// Returns the images of each track, ascending.
    fn images_of_tracks(&mut self) -> Vec<Vec<usize>> {
        let mut by_track: FxHashMap<u32, Vec<usize>> = FxHashMap::default();
        for image in 0..self.images() {
            let keypoints = self.first_keypoint[image]..self.first_keypoint[image + 1];
            for keypoint in keypoints.filter(|&keypoint| self.is_matched[keypoint as usize]) {
                let root = self.tracks.root(keypoint);
                let images = by_track.entry(root).or_default();
                if images.last() != Some(&image) {
                    images.push(image);
                }
            }
        }
        let long = by_track.into_values().filter(|images| images.len() > 2);
        long.map(|images| thinned(&images)).collect()
    }
}

/// Returns at most [`COUNTED_IMAGES`] of the images, evenly spread.
fn thinned(images: &[usize]) -> Vec<usize> {
    let step = images.len().div_ceil(COUNTED_IMAGES);
    images.iter().copied().step_by(step.max(1)).collect()
}

/// How other images support one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct ImageSupport {
    /// Number of images that agree with it.
    pub partners: usize,
    /// Number of these that share at most half as much with it as the one that shares most: they
    /// see the scene from elsewhere.
    pub wide: usize,
}

/// An image that shares tracks with another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SharedTracks {
    /// Number of the tracks.
    pub tracks: usize,
    /// The image.
    pub other: usize,
}
