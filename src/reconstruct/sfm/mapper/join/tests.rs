use std::sync::Arc;

use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::join_models;
use crate::sfm::mapper::tests::{Made, RING, Recipe};
use crate::sfm::mapper::{Mapped, MapperOptions};
use crate::sfm::{MapProblem, SparseModel, VerifiedPair};
use ostra_core::job::Progress;
use ostra_geometry::Similarity;

/// First image of the second group.
const BORDER: u32 = 18;

/// A ring of views in two groups, mapped apart, and the pairs that connect the groups.
struct Parted {
    made: Made,
    models: Vec<Mapped>,
    between: Vec<VerifiedPair>,
}

impl Parted {
    fn new(seed: u64) -> Self {
        let mut made = Made::new(
            &Recipe {
                outliers: 0.1,
                ..RING
            },
            seed,
        );
        let is_within =
            |pair: &VerifiedPair| (pair.images[0] < BORDER) == (pair.images[1] < BORDER);
        let all = std::mem::take(&mut made.problem.pairs);
        let (within, between) = all.into_iter().partition(is_within);
        made.problem.pairs = within;
        let models = made.map();
        assert_eq!(models.len(), 2);
        Self {
            made,
            models,
            between,
        }
    }

    /// Returns the problem with so many matches of each pair between the groups, and as many wrong ones
    /// per right one as `wrong` says.
    fn with_matches(&self, each: usize, wrong: f64) -> MapProblem {
        let mut problem = self.made.problem.clone();
        let mut rng = Pcg64Mcg::seed_from_u64(3);
        for (index, pair) in self.between.iter().enumerate() {
            // Each pair shows other points.
            let matches = pair.matches.iter().skip(20 * index).take(each);
            let mut matches: Vec<[u32; 2]> = matches.copied().collect();
            let right = matches.len();
            for _ in 0..(wrong * right as f64).round() as usize {
                let first = matches[rng.random_range(0..right)][0];
                let second = rng.random_range(0..problem.images[29].keypoints.len()) as u32;
                matches.push([first, second]);
            }
            let pair = VerifiedPair {
                matches: matches.into(),
                ..pair.clone()
            };
            problem.pairs.push(pair);
        }
        problem
    }

    fn joined(&self, problem: &MapProblem) -> Vec<Mapped> {
        join_models(
            problem,
            self.models.clone(),
            &MapperOptions::default(),
            &Progress::default(),
        )
    }
}

/// Moves all poses and points of a model by a similarity.
fn moved(model: &SparseModel, by: &Similarity) -> SparseModel {
    let mut moved = model.clone();
    for pose in moved.poses.iter_mut().flatten() {
        *pose = by.transform_camera(pose);
    }
    for (number, point) in model.points() {
        moved.move_to(number, by.transform(point.position));
    }
    moved
}

#[test]
fn models_that_share_points_become_one_despite_noise_and_outliers() {
    for (seed, wrong) in [(2, 0.0), (3, 0.8)] {
        let mut parted = Parted::new(seed);
        // The second model has other axes and another unit.
        let by = Similarity {
            scale: 7.0,
            rotation: DQuat::from_rotation_y(2.0),
            translation: DVec3::new(30.0, -4.0, 9.0),
        };
        parted.models[1].model = moved(&parted.models[1].model, &by);
        // No image of one group has enough matches to be placed in the other.
        let problem = parted.with_matches(5, wrong);
        let models = parted.joined(&problem);
        assert_eq!(models.len(), 1, "seed {seed}");
        assert_eq!(models[0].model.placed().count(), 30);
        let (centre, rotation) = parted.made.errors(&models[0]);
        assert!(
            centre < 3e-3 && rotation < 0.1,
            "seed {seed}: centre {centre:.2e}, rotation {rotation:.3}°"
        );
    }
}

#[test]
fn models_with_too_little_in_common_stay_apart() {
    let parted = Parted::new(2);
    let sizes = |models: &[Mapped]| -> Vec<usize> {
        models
            .iter()
            .map(|mapped| mapped.model.placed().count())
            .collect()
    };
    assert_eq!(sizes(&parted.joined(&parted.made.problem)), [18, 12]);
    let few = parted.with_matches(1, 0.0);
    assert_eq!(sizes(&parted.joined(&few)), [18, 12], "too few points");
}

#[test]
fn wrong_matches_join_nothing() {
    let parted = Parted::new(2);
    let mut problem = parted.with_matches(40, 0.0);
    let mut rng = Pcg64Mcg::seed_from_u64(5);
    for pair in &mut problem.pairs {
        if pair.images[0] < BORDER && pair.images[1] >= BORDER {
            for [_, second] in Arc::make_mut(&mut pair.matches) {
                *second = rng.random_range(0..RING.points) as u32;
            }
        }
    }
    assert_eq!(parted.joined(&problem).len(), 2);
}

#[test]
fn stopped_joining_leaves_the_models() {
    let parted = Parted::new(2);
    let problem = parted.with_matches(5, 0.0);
    let progress = Progress::default();
    progress.stop();
    let options = MapperOptions::default();
    let models = join_models(&problem, parted.models.clone(), &options, &progress);
    assert_eq!(models.len(), 2);
}

#[test]
fn one_pair_with_many_matches_connects_two_groups() {
    let mut parted = Parted::new(2);
    let is_picked = |pair: &&VerifiedPair| pair.images == [BORDER - 1, BORDER];
    let picked = parted.between.iter().find(is_picked).unwrap();
    parted.made.problem.pairs.push(picked.clone());
    let models = parted.made.map();
    assert_eq!(models.len(), 1);
    assert_eq!(models[0].model.placed().count(), 30);
}
