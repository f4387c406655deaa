use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};

fn features(descriptors: Descriptors) -> Features {
    let keypoints = vec![DVec2::ZERO; descriptors.len()];
    Features {
        width: 1,
        height: 1,
        keypoints,
        scales_px: Vec::new(),
        orientations: Vec::new(),
        scores: Vec::new(),
        descriptors,
    }
}

fn unit(raw: &[f32]) -> Vec<f32> {
    let length = raw.iter().map(|value| value * value).sum::<f32>().sqrt();
    raw.iter().map(|value| value / length).collect()
}

/// Returns descriptors of two images of a world with crowds of similar descriptors.
///
/// Some keypoints of the second are nearly those of the first, in another order; the others are its
/// own.
fn two_images(counts: [usize; 2], dim: usize, seed: u64) -> [Vec<Vec<f32>>; 2] {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut row = |spread: f32, around: &[f32]| -> Vec<f32> {
        unit(
            &around
                .iter()
                .map(|value| value + spread * random.random_range(-1.0..1.0f32))
                .collect::<Vec<_>>(),
        )
    };
    let crowds: Vec<Vec<f32>> = (0..15).map(|_| row(1.0, &vec![0.8; dim])).collect();
    let first: Vec<Vec<f32>> = (0..counts[0])
        .map(|at| row(0.05, &crowds[at % 15]))
        .collect();
    let second = (0..counts[1])
        .map(|at| match first.get((7 * at) % (2 * counts[0])) {
            Some(same) => row(0.02, same),
            None => row(0.05, &crowds[at % 15]),
        })
        .collect();
    [first, second]
}

fn bytes(rows: &[Vec<f32>]) -> Descriptors {
    let values = rows
        .iter()
        .flatten()
        .map(|value| (512.0 * value).round().clamp(0.0, 255.0) as u8)
        .collect();
    Descriptors::Bytes {
        dim: rows[0].len(),
        values,
    }
}

fn floats(rows: &[Vec<f32>]) -> Descriptors {
    Descriptors::Floats {
        dim: rows[0].len(),
        values: rows.concat(),
    }
}

/// Computes the same by comparing everything with everything in double precision.
fn expected(
    first: &[Vec<f64>],
    second: &[Vec<f64>],
    ratio: f64,
    min_cosine: f64,
) -> Vec<(u32, u32)> {
    let one_way = |from: &[Vec<f64>], to: &[Vec<f64>]| -> Vec<Option<usize>> {
        from.iter()
            .map(|row| {
                let mut found: Vec<(f64, usize)> = to
                    .iter()
                    .map(|other| row.iter().zip(other).map(|(a, b)| a * b).sum::<f64>())
                    .zip(0..)
                    .collect();
                found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
                let distance = |at: usize| {
                    found
                        .get(at)
                        .map_or(2.0, |one| (2.0 - 2.0 * one.0).max(0.0).sqrt())
                };
                let distinct = ratio >= 1.0 || distance(0) < ratio * distance(1);
                (distinct && found[0].0 > min_cosine).then_some(found[0].1)
            })
            .collect()
    };
    let (forth, back) = (one_way(first, second), one_way(second, first));
    let pairs = (0..first.len()).filter_map(|at| forth[at].map(|other| (at, other)));
    pairs
        .filter(|&(at, other)| back[other] == Some(at))
        .map(|(a, b)| (a as u32, b as u32))
        .collect()
}

#[test]
fn byte_matches_equal_exhaustive_search() {
    for (counts, seed) in [([300, 410], 1), ([95, 7], 2), ([1, 33], 3), ([257, 256], 4)] {
        let both = two_images(counts, 128, seed).map(|rows| bytes(&rows));
        let exact = both.each_ref().map(|descriptors| match descriptors {
            Descriptors::Bytes { dim, values } => values
                .chunks(*dim)
                .map(|row| row.iter().map(|&value| f64::from(value) / 512.0).collect())
                .collect(),
            Descriptors::Floats { .. } => Vec::new(),
        });
        let [first, second] = both.map(features);
        for (ratio, min_cosine) in [(0.8, 0.764_842), (1.0, 0.9), (0.6, -1.0), (1.0, -1.0)] {
            let found = NearestMatcher::new(ratio, min_cosine)
                .matches(&first, &second)
                .unwrap();
            let expected = expected(
                &exact[0],
                &exact[1],
                f64::from(ratio),
                f64::from(min_cosine),
            );
            assert_eq!(
                found, expected,
                "{counts:?}, ratio {ratio}, cosine {min_cosine}"
            );
            assert!(
                counts[0] < 200 || found.len() > 100,
                "{} matches test nothing",
                found.len()
            );
        }
    }
}

#[test]
fn float_matches_equal_exhaustive_search() {
    for dim in [7, 64, 256] {
        let both = two_images([300, 220], dim, 9);
        let exact = both.each_ref().map(|rows| {
            rows.iter()
                .map(|row| row.iter().map(|&value| f64::from(value)).collect())
                .collect::<Vec<_>>()
        });
        let [first, second] = both.map(|rows| features(floats(&rows)));
        for (ratio, min_cosine) in [(1.0, 0.82), (0.9, 0.5), (0.8, -1.0)] {
            let found = NearestMatcher::new(ratio, min_cosine)
                .matches(&first, &second)
                .unwrap();
            assert_eq!(
                found,
                expected(
                    &exact[0],
                    &exact[1],
                    f64::from(ratio),
                    f64::from(min_cosine)
                ),
                "{dim}"
            );
        }
    }
}

#[test]
fn nearly_all_matches_are_found_in_large_images() {
    let both = two_images([3000, 2600], 128, 5);
    let exact = both.each_ref().map(|rows| {
        let rounded = rows.iter().map(|row| {
            row.iter()
                .map(|value| f64::from((512.0 * value).round()) / 512.0)
        });
        rounded.map(Iterator::collect).collect::<Vec<Vec<f64>>>()
    });
    let [first, second] = both.map(|rows| features(bytes(&rows)));
    let found = NearestMatcher::for_bytes()
        .matches(&first, &second)
        .unwrap();
    let expected = expected(&exact[0], &exact[1], 0.8, 0.764_842);
    let common = found
        .iter()
        .filter(|pair| expected.binary_search(pair).is_ok())
        .count();
    assert!(expected.len() > 500, "{}", expected.len());
    assert!(
        common as f64 > 0.97 * expected.len() as f64,
        "{common} of {}",
        expected.len()
    );
    assert!(
        (found.len() as f64) < 1.03 * expected.len() as f64,
        "{} found",
        found.len()
    );
}

#[test]
fn equal_descriptors_are_ambiguous_unless_the_ratio_is_one() {
    let row = unit(&[1.0, 2.0, 3.0, 4.0]);
    let one = features(floats(std::slice::from_ref(&row)));
    let twins = features(floats(&[row.clone(), row]));
    assert_eq!(
        NearestMatcher::new(0.8, -1.0)
            .matches(&one, &twins)
            .unwrap(),
        []
    );
    assert_eq!(
        NearestMatcher::new(1.0, -1.0)
            .matches(&one, &twins)
            .unwrap(),
        [(0, 0)]
    );
}

#[test]
fn descriptors_of_different_kinds_are_refused() {
    let rows = two_images([5, 5], 32, 1);
    let longer = two_images([5, 5], 64, 1);
    let matcher = NearestMatcher::for_floats();
    let given = features(floats(&rows[0]));
    for other in [bytes(&rows[1]), floats(&longer[1])] {
        assert!(matches!(
            matcher.matches(&given, &features(other)),
            Err(FeatureError::Kinds(_))
        ));
    }
    let none = features(Descriptors::Bytes {
        dim: 128,
        values: Vec::new(),
    });
    assert_eq!(matcher.matches(&given, &none), Ok(Vec::new()));
}

#[test]
fn nan_descriptors_match_nothing() {
    let [first, mut second] = two_images([40, 40], 32, 8);
    second[3][5] = f32::NAN;
    let bad = second
        .iter()
        .map(|_| vec![f32::NAN; 32])
        .collect::<Vec<_>>();
    let matcher = NearestMatcher::for_floats();
    assert_eq!(
        matcher.matches(&features(floats(&first)), &features(floats(&bad))),
        Ok(Vec::new())
    );
    let some = matcher
        .matches(&features(floats(&first)), &features(floats(&second)))
        .unwrap();
    assert!(
        some.len() > 5 && some.iter().all(|&(_, other)| other != 3),
        "{some:?}"
    );
}
