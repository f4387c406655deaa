use std::collections::BTreeSet;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::sfm::{Descriptors, Features};

/// Returns images of a synthetic world of several places.
///
/// Each place has descriptors around prototypes of its own, more than a vocabulary has centres.
fn images(bytes: bool) -> Vec<Features> {
    let mut random = Pcg64Mcg::seed_from_u64(4);
    let mut row = |spread: f32, around: &[f32]| -> Vec<f32> {
        let raw: Vec<f32> = around
            .iter()
            .map(|value| (value + spread * random.random::<f32>()).max(0.0))
            .collect();
        let length = raw.iter().map(|value| value * value).sum::<f32>().sqrt();
        raw.iter().map(|value| value / length).collect()
    };
    let prototypes: Vec<Vec<Vec<f32>>> = (0..4)
        .map(|_| (0..50).map(|_| row(1.0, &[-0.5; 32])).collect())
        .collect();
    [0, 1, 2, 3, 2, 1, 0]
        .map(|place: usize| {
            let values: Vec<f32> = (0..300)
                .flat_map(|at| row(0.1, &prototypes[place][at % 50]))
                .collect();
            let descriptors = if bytes {
                Descriptors::Bytes {
                    dim: 32,
                    values: values.iter().map(|value| (value * 512.0) as u8).collect(),
                }
            } else {
                Descriptors::Floats { dim: 32, values }
            };
            Features {
                width: 1,
                height: 1,
                keypoints: vec![glam::DVec2::ZERO; 300],
                scales_px: Vec::new(),
                orientations: Vec::new(),
                scores: Vec::new(),
                descriptors,
            }
        })
        .into()
}

/// Returns vectors of all images by their own vocabulary.
fn pooled(set: &[Features]) -> Vec<Vec<f32>> {
    let set: Vec<&Features> = set.iter().collect();
    Vocabulary::learn(&set, 1).pool_all(&set)
}

#[test]
fn images_of_one_place_are_most_similar() {
    for bytes in [false, true] {
        let pooled = pooled(&images(bytes));
        let pairs = most_alike(&pooled, 1, &BTreeSet::new());
        for same in [(0, 6), (1, 5), (2, 4)] {
            assert!(pairs.contains(&same), "{pairs:?}");
        }
        assert!(
            pooled
                .iter()
                .all(|one| (one.iter().map(|value| value * value).sum::<f32>() - 1.0).abs() < 1e-4)
        );
    }
}

#[test]
fn known_pairs_make_room_for_others() {
    let pooled = vec![vec![1.0, 0.0], vec![0.9, 0.436], vec![0.6, 0.8]];
    assert_eq!(most_alike(&pooled, 1, &BTreeSet::new()), [(0, 1), (1, 2)]);
    assert_eq!(
        most_alike(&pooled, 1, &BTreeSet::from([(0, 1)])),
        [(0, 2), (1, 2)]
    );
}

#[test]
fn ties_go_to_the_lower_index() {
    let pooled = vec![vec![1.0, 0.0]; 4];
    assert_eq!(
        most_alike(&pooled, 1, &BTreeSet::new()),
        [(0, 1), (0, 2), (0, 3)]
    );
}

#[test]
fn seed_determines_the_vocabulary() {
    let set = images(false);
    let set: Vec<&Features> = set.iter().collect();
    assert_eq!(Vocabulary::learn(&set, 1), Vocabulary::learn(&set, 1));
    assert_ne!(Vocabulary::learn(&set, 1), Vocabulary::learn(&set, 2));
}

#[test]
fn images_without_comparable_descriptors_are_similar_to_none() {
    let mut set = images(false);
    set[0].descriptors = Descriptors::Bytes {
        dim: 1,
        values: Vec::new(),
    };
    set[1].descriptors = Descriptors::Floats {
        dim: 32,
        values: Vec::new(),
    };
    set[6].descriptors = Descriptors::Bytes {
        dim: 32,
        values: vec![90; 32],
    };
    let pooled = pooled(&set);
    assert!(
        [0, 1, 6]
            .iter()
            .all(|&at| pooled[at].iter().all(|&value| value == 0.0))
    );
    let pairs = most_alike(&pooled, 6, &BTreeSet::new());
    assert_eq!(pairs, [(2, 3), (2, 4), (2, 5), (3, 4), (3, 5), (4, 5)]);
    assert!(most_alike(&self::pooled(&[]), 1, &BTreeSet::new()).is_empty());
}
