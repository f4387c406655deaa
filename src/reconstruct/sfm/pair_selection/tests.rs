use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::sfm::{Descriptors, VerifiedPair};
use ostra_geometry::TwoViewKind;

/// Number of keypoints of an image.
const KEYPOINTS: usize = 100;

/// Returns features of an image of one of several places, each with its own descriptors.
fn image(place: u64) -> Features {
    let mut random = Pcg64Mcg::seed_from_u64(place);
    Features {
        width: 10,
        height: 10,
        keypoints: vec![DVec2::ZERO; KEYPOINTS],
        scales_px: Vec::new(),
        orientations: Vec::new(),
        scores: Vec::new(),
        descriptors: Descriptors::Bytes {
            dim: 8,
            values: (0..8 * KEYPOINTS).map(|_| random.random()).collect(),
        },
    }
}

/// A strip of points, of which every image sees [`KEYPOINTS`] in a row.
struct Strip {
    /// The first point that each image sees.
    first_point: Vec<usize>,
    sequences: Vec<Sequence>,
    options: PairOptions,
}

impl Strip {
    /// Creates one sequence of images; nothing is known of their appearance.
    fn new(first_point: Vec<usize>) -> Self {
        let images = (0..first_point.len()).collect();
        Self {
            sequences: vec![sequence(images)],
            first_point,
            options: PairOptions {
                alike: 0,
                ..PairOptions::default()
            },
        }
    }

    fn matched(&self, (a, b): ImagePair) -> TriedPair {
        let [first, second] = [a, b].map(|image| self.first_point[image]);
        let common = first.max(second)..first.min(second) + KEYPOINTS;
        let matches: Vec<[u32; 2]> = common
            .map(|point| [(point - first) as u32, (point - second) as u32])
            .collect();
        let images = [a as u32, b as u32];
        TriedPair {
            images,
            matches: matches.len(),
            verified: (matches.len() >= 15).then(|| VerifiedPair {
                images,
                matches: matches.into(),
                kind: TwoViewKind::Uncalibrated,
                second_from_first: None,
                parallax: 0.1,
            }),
        }
    }

    /// Returns the pairs of each round.
    fn rounds(&self) -> Vec<Vec<ImagePair>> {
        // Images of one place look alike.
        let set: Vec<Features> = self
            .first_point
            .iter()
            .map(|&point| image(point as u64 / 1000))
            .collect();
        let set: Vec<&Features> = set.iter().collect();
        let mut selection = PairSelection::new(&set, &self.sequences, &self.options);
        let mut graph = ViewGraph::new(&set);
        let mut rounds: Vec<Vec<ImagePair>> = Vec::new();
        loop {
            let pairs = selection.next_round(&mut graph);
            if pairs.is_empty() {
                return rounds;
            }
            let matched: Vec<TriedPair> = pairs.iter().map(|&pair| self.matched(pair)).collect();
            for pair in &pairs {
                assert!(!rounds.concat().contains(pair), "{pair:?} again");
            }
            matched.iter().for_each(|pair| graph.add(pair));
            selection.note(&matched);
            rounds.push(pairs);
        }
    }
}

/// Returns a sequence of images that are numbered from 0.
fn sequence(images: Vec<usize>) -> Sequence {
    Sequence {
        counters: (0..images.len() as u64).collect(),
        images,
    }
}

/// Returns the farthest distance of two images of a sequence that are compared.
fn reach(pairs: &[ImagePair]) -> usize {
    // The last image is compared with the first, because a sequence may be closed.
    let steps = pairs.iter().map(|&(a, b)| b - a);
    steps.filter(|&step| step < 39).max().unwrap()
}

#[test]
fn small_sets_are_compared_in_full() {
    let strip = Strip::new((0..4).map(|image| 1000 * image).collect());
    let all = vec![(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    assert_eq!(strip.rounds(), [all]);
}

#[test]
fn window_of_a_sequence_follows_the_overlap() {
    let strip = |step: usize| Strip::new((0..40).map(|image| step * image).collect());
    let [near, far] = [2, 12].map(|step| strip(step).rounds().concat());
    // 40 tracks are shared by images that are 30 or 5 apart.
    assert!((20..=30).contains(&reach(&near)), "{near:?}");
    assert!(reach(&far) == 5, "{far:?}");
    for pairs in [near, far] {
        assert!(pairs.len() < 40 * 11, "{} of 780 pairs", pairs.len());
    }
}

#[test]
fn pairs_that_tracks_explain_are_left_out() {
    let mut strip = Strip::new((0..40).map(|image| 3 * image).collect());
    let many = strip.rounds().concat().len();
    strip.options.partners = 5;
    let few = strip.rounds().concat().len();
    assert!(few < many && many < 40 * 12, "{few} {many}");
}

#[test]
fn two_cameras_of_a_turntable_are_compared_at_equal_numbers() {
    // The images of the second camera see the same half a step later.
    let points = (0..12).map(|k| 20 * k).chain((0..12).map(|k| 20 * k + 10));
    let mut strip = Strip::new(points.collect());
    strip.sequences = vec![sequence((0..12).collect()), sequence((12..24).collect())];
    let first = &strip.rounds()[0];
    assert!(
        (0..12).all(|at| first.contains(&(at, at + 12))),
        "{first:?}"
    );
    assert!(
        first.contains(&(0, 11)) && first.contains(&(11, 12)),
        "{first:?}"
    );
    assert!(
        !first.contains(&(10, 12)),
        "windows end with their sequence: {first:?}"
    );
}

#[test]
fn images_of_similar_appearance_are_compared_across_sequences() {
    // Every image shows another place, but the first and the last one of two folders the same.
    let mut points: Vec<usize> = (0..24).map(|image| 1000 * image).collect();
    points[17] = points[3] + 10;
    let mut strip = Strip::new(points);
    strip.sequences = vec![sequence((0..12).collect()), sequence((12..24).collect())];
    strip.options.alike = 1;
    let first = &strip.rounds()[0];
    assert!(first.contains(&(3, 17)), "{first:?}");
}

#[test]
fn image_that_nothing_links_is_compared_with_all_others() {
    // Image 30 returns to what image 5 sees, between images that see something else.
    let mut points: Vec<usize> = (0..40).map(|image| 15 * image).collect();
    points[30] = points[5] + 20;
    let strip = Strip::new(points);
    let rounds = strip.rounds();
    assert!(!rounds[0].contains(&(5, 30)));
    let all = rounds.concat();
    assert!((0..30).all(|other| all.contains(&(other, 30))), "{all:?}");
    let of_linked = all.iter().filter(|&&(a, b)| a == 12 || b == 12).count();
    assert!(of_linked < 15, "the others are not: {of_linked}");
}

#[test]
fn parts_that_nothing_links_are_compared_with_each_other() {
    let points = (0..30).map(|k| 15 * k).chain((0..10).map(|k| 15 * k + 7));
    let mut strip = Strip::new(points.collect());
    // The second part does not follow the first one, and counts otherwise.
    let mut second = sequence((30..40).collect());
    second
        .counters
        .iter_mut()
        .for_each(|counter| *counter += 500);
    strip.sequences = vec![sequence((0..30).collect()), second];
    let all = strip.rounds().concat();
    assert!((0..10).all(|at| all.contains(&(at, at + 30))), "{all:?}");
}

#[test]
fn given_pairs_are_added_to_the_chosen_ones() {
    let mut strip = Strip::new((0..30).map(|image| 15 * image).collect());
    strip.options.given = vec![(19, 4), (4, 19), (7, 7), (7, 70)];
    let first = &strip.rounds()[0];
    assert!(first.contains(&(4, 19)));
    assert!(first.iter().all(|&(a, b)| a < b && b < 30), "{first:?}");
}
