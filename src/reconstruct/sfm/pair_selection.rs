//! Selection of the image pairs to match, in rounds: each follows from the view graph so far.
//!
//! First come neighbours in sequences and images of similar appearance. The tracks of their matches
//! then show which other images see the same points. Pairs are added where an image has few
//! partners, and pairs that the tracks explain are left out. Images that nothing links well are
//! compared with more others.

use std::collections::BTreeSet;

use super::pairs::{MatchedImages, TriedPair, match_each};
use super::retrieval::{Vocabulary, most_alike, most_alike_of};
use super::sequences::Sequence;
use super::view_graph::{ImagePair, ImageSupport, SharedTracks, ViewGraph};
use super::{FeatureMatcher, Features, SfmError};
use ostra_core::job::Progress;

/// Selects pairs of images and matches them; the result is ascending.
///
/// # Errors
/// [`SfmError`] if the matcher fails or the run is stopped.
pub(super) fn match_images(
    images: MatchedImages<'_>,
    sequences: &[Sequence],
    options: &PairOptions,
    matcher: &dyn FeatureMatcher,
    seed: u64,
    progress: &Progress,
) -> Result<Vec<TriedPair>, SfmError> {
    let matcher = matcher.of_set(images.features)?;
    let expected = options.expected_pairs(images.features.len());
    let mut selection = PairSelection::new(images.features, sequences, options);
    let mut graph = ViewGraph::new(images.features);
    let mut tried: Vec<TriedPair> = Vec::new();
    loop {
        progress.check()?;
        let pairs = selection.next_round(&mut graph);
        if pairs.is_empty() {
            break;
        }
        let (before, total) = (tried.len(), expected.max(tried.len() + pairs.len()));
        let step = |done: usize| progress.step(before + done, total);
        let matched = match_each(images, &pairs, &matcher, seed, &step)?;
        matched.iter().for_each(|pair| graph.add(pair));
        selection.note(&matched);
        tried.extend(matched);
    }
    tried.sort_unstable_by_key(|pair| pair.images);
    Ok(tried)
}

/// Options of pair selection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PairOptions {
    /// In sets of up to this many images, every image is compared with every other.
    pub exhaustive_up_to: usize,
    /// Number of following images of its sequence that an image is compared with at first. Those
    /// farther on follow as far as the tracks of matches lead.
    pub window: usize,
    /// Number of images that each is compared with at first because their appearance is most similar.
    pub alike: usize,
    /// Number of other images that should agree with each.
    pub partners: usize,
    /// Number of these that should share at most half as much with it as the one that shares most,
    /// and so see the scene from elsewhere.
    pub wide_partners: usize,
    /// Additional pairs (indices, in either order).
    pub given: Vec<(usize, usize)>,
    /// Seed for the sample of descriptors by which similarity is judged.
    pub seed: u64,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            exhaustive_up_to: 20,
            window: 2,
            alike: 5,
            partners: 10,
            wide_partners: 4,
            given: Vec::new(),
            seed: 0,
        }
    }
}

impl PairOptions {
    /// Returns about how many pairs of `images` are matched.
    #[must_use]
    pub fn expected_pairs(&self, images: usize) -> usize {
        let all = images * images.saturating_sub(1) / 2;
        if images <= self.exhaustive_up_to {
            return all;
        }
        all.min(images * (self.window + self.alike))
    }
}

/// Number of agreeing matches that link two images well.
const ENOUGH_MATCHES: usize = 30;
/// Number of shared tracks from which two images are expected to agree.
const ENOUGH_TRACKS: usize = 40;
/// Number of pairs that an image gets in a round.
const PER_ROUND: usize = 4;
/// Number of pairs without enough matches, after which tracks are not followed from an image.
const MOST_FAILURES: usize = 3;
/// Largest number of rounds that follow tracks. A round doubles how far a sequence is matched.
const TRACK_ROUNDS: usize = 10;
/// An image with fewer partners is weak.
const FEW_PARTNERS: usize = 3;
/// Largest number of rounds for weak images.
const WEAK_ROUNDS: usize = 3;
/// In sets of up to this many images, weak ones are compared with all others.
const EXHAUSTIVE_IF_WEAK: usize = 60;
/// In larger sets: images of similar appearance that a weak image is compared with in a round.
const ALIKE_IF_WEAK: usize = 8;
/// In larger sets: images before and after it in its sequence that a weak image is compared with.
const WINDOW_IF_WEAK: usize = 10;

/// The state of the selection.
pub(super) struct PairSelection<'a> {
    features: &'a [&'a Features],
    sequences: &'a [Sequence],
    options: &'a PairOptions,
    /// One vector per image; empty until it is needed.
    pooled: Vec<Vec<f32>>,
    /// Rounds that followed tracks; `None` before the first round.
    track_rounds: Option<usize>,
    weak_rounds: usize,
    /// By image, pairs that tracks led to and that do not agree.
    failures: Vec<usize>,
    /// Whether the pairs of the last round came from tracks.
    followed_tracks: bool,
}

impl<'a> PairSelection<'a> {
    /// Begins the selection of pairs of images, some of which follow each other in sequences.
    pub fn new(
        features: &'a [&'a Features],
        sequences: &'a [Sequence],
        options: &'a PairOptions,
    ) -> Self {
        Self {
            features,
            sequences,
            options,
            pooled: Vec::new(),
            track_rounds: None,
            weak_rounds: 0,
            failures: vec![0; features.len()],
            followed_tracks: false,
        }
    }

    /// Returns the pairs of the next round, ascending, none of them tried before; none at the end.
    pub fn next_round(&mut self, graph: &mut ViewGraph) -> Vec<ImagePair> {
        let is_small = self.features.len() <= self.options.exhaustive_up_to;
        let pairs = match self.track_rounds {
            None if is_small => all_pairs(self.features.len()),
            None => self.first_round(),
            Some(_) if is_small => BTreeSet::new(),
            Some(_) => self.later_round(graph),
        };
        self.track_rounds.get_or_insert(0);
        pairs.into_iter().collect()
    }

    /// Takes note of the pairs that were matched in the last round.
    pub fn note(&mut self, matched: &[TriedPair]) {
        if !self.followed_tracks {
            return;
        }
        for pair in matched {
            let matches = pair
                .verified
                .as_ref()
                .map_or(0, |found| found.matches.len());
            if matches < ENOUGH_MATCHES {
                for image in pair.images {
                    self.failures[image as usize] += 1;
                }
            }
        }
    }

    fn first_round(&mut self) -> BTreeSet<ImagePair> {
        let count = self.features.len();
        let given = self.options.given.iter().map(|&(a, b)| ordered(a, b));
        let mut pairs: BTreeSet<ImagePair> = given.filter(|&(a, b)| a < b && b < count).collect();
        pairs.extend(neighbours(self.sequences, self.options.window));
        let alike = self.options.alike;
        pairs.extend(most_alike(self.pooled(), alike, &pairs));
        pairs
    }

    fn later_round(&mut self, graph: &mut ViewGraph) -> BTreeSet<ImagePair> {
        let mut pairs = BTreeSet::new();
        let rounds = self.track_rounds.unwrap_or(0);
        self.followed_tracks = rounds < TRACK_ROUNDS;
        if self.followed_tracks {
            self.track_rounds = Some(rounds + 1);
            pairs = self.pairs_by_tracks(graph);
        }
        if pairs.is_empty() && self.weak_rounds < WEAK_ROUNDS {
            self.followed_tracks = false;
            self.weak_rounds += 1;
            pairs = self.pairs_of_weak_images(graph);
        }
        pairs
    }

    /// Returns pairs that share tracks, of images that have too few partners so far.
    fn pairs_by_tracks(&self, graph: &mut ViewGraph) -> BTreeSet<ImagePair> {
        let support = graph.support(ENOUGH_MATCHES);
        let mut pairs = BTreeSet::new();
        for (image, others) in graph
            .unmatched_by_tracks(ENOUGH_TRACKS)
            .into_iter()
            .enumerate()
        {
            let ImageSupport { partners, wide } = support[image];
            if self.failures[image] >= MOST_FAILURES {
                continue;
            }
            if partners < self.options.partners {
                let missing = self.options.partners - partners;
                let chosen = spread(&others, missing.min(PER_ROUND));
                pairs.extend(chosen.map(|one| ordered(image, one.other)));
            } else if wide < self.options.wide_partners {
                let farthest = others.last();
                pairs.extend(farthest.map(|one| ordered(image, one.other)));
            }
        }
        pairs
    }

    /// Returns pairs of images with few partners, and of images that nothing links with most others.
    fn pairs_of_weak_images(&mut self, graph: &ViewGraph) -> BTreeSet<ImagePair> {
        let count = self.features.len();
        let support = graph.support(ENOUGH_MATCHES);
        let component = graph.components(ENOUGH_MATCHES);
        let size = |of: usize| component.iter().filter(|&&other| other == of).count();
        let largest = component
            .iter()
            .copied()
            .max_by_key(|&of| (size(of), std::cmp::Reverse(of)));
        let mut pairs = BTreeSet::new();
        for image in 0..count {
            let is_weak = support[image].partners < FEW_PARTNERS;
            if !is_weak && Some(component[image]) == largest {
                continue;
            }
            let is_wanted = |&other: &usize| {
                other != image
                    && !graph.is_tried(image, other)
                    && (is_weak || component[other] != component[image])
            };
            let others: Vec<usize> = (0..count).filter(is_wanted).collect();
            if count <= EXHAUSTIVE_IF_WEAK {
                pairs.extend(others.iter().map(|&other| ordered(image, other)));
                continue;
            }
            let alike = most_alike_of(self.pooled(), image, &others, ALIKE_IF_WEAK);
            let near = self.near(image, WINDOW_IF_WEAK).into_iter();
            let chosen = alike.into_iter().chain(near.filter(is_wanted));
            pairs.extend(chosen.map(|other| ordered(image, other)));
        }
        pairs
    }

    /// Returns the images at most `window` before or after an image in its sequence.
    fn near(&self, image: usize, window: usize) -> Vec<usize> {
        let place = self.sequences.iter().find_map(|sequence| {
            let at = sequence.images.iter().position(|&one| one == image)?;
            Some((sequence, at))
        });
        place.map_or(Vec::new(), |(sequence, at)| {
            let end = (at + window + 1).min(sequence.images.len());
            sequence.images[at.saturating_sub(window)..end].to_vec()
        })
    }

    fn pooled(&mut self) -> &[Vec<f32>] {
        if self.pooled.is_empty() {
            let vocabulary = Vocabulary::learn(self.features, self.options.seed);
            self.pooled = vocabulary.pool_all(self.features);
        }
        &self.pooled
    }
}

/// Returns every pair of so many images.
fn all_pairs(count: usize) -> BTreeSet<ImagePair> {
    (0..count)
        .flat_map(|first| (first + 1..count).map(move |second| (first, second)))
        .collect()
}

fn ordered(a: usize, b: usize) -> ImagePair {
    (a.min(b), a.max(b))
}

/// Returns neighbours in sequences and between them.
///
/// Every image is paired with the next `window` ones of its sequence, and the last with the first,
/// because a turntable ends where it began. A sequence that comes right after another may continue
/// it, or show the same from elsewhere with the same numbers, as two cameras of a turntable do.
fn neighbours(sequences: &[Sequence], window: usize) -> BTreeSet<ImagePair> {
    let mut pairs = BTreeSet::new();
    for Sequence { images, .. } in sequences {
        for (at, &image) in images.iter().enumerate() {
            let next = images[at + 1..].iter().take(window);
            pairs.extend(next.map(|&next| ordered(image, next)));
        }
        pairs.extend(
            images
                .first()
                .zip(images.last())
                .map(|(&a, &b)| ordered(a, b)),
        );
    }
    for (one, next) in sequences.iter().zip(sequences.iter().skip(1)) {
        let joint = one.images.last().zip(next.images.first());
        pairs.extend(joint.map(|(&a, &b)| ordered(a, b)));
        for (counter, &image) in one.counters.iter().zip(&one.images) {
            if let Ok(at) = next.counters.binary_search(counter) {
                pairs.insert(ordered(image, next.images[at]));
            }
        }
    }
    pairs.retain(|&(first, second)| first < second);
    pairs
}

/// Returns so many of the others: those that share most and least, and some evenly between.
fn spread(others: &[SharedTracks], count: usize) -> impl Iterator<Item = &SharedTracks> {
    let count = count.min(others.len());
    let last = others.len().saturating_sub(1);
    (0..count).map(move |k| &others[k * last / (count - 1).max(1)])
}

#[cfg(test)]
mod tests;
