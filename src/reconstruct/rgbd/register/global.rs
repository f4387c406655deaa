//! Pose between two clouds without an initial guess: Fast Global Registration, or RANSAC.

use glam::DVec3;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::fpfh::DescribedCloud;
use super::matching;
use super::pairs::{PointPairs, align};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_geometry::Pose;
use ostra_geometry::ransac::{Estimator, RansacOptions, consensus};

/// Method that finds a pose without an initial guess.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GlobalRegistration {
    /// Fast Global Registration: one robust fit to all matches.
    #[default]
    Fgr,
    /// RANSAC: the best of many fits to three matches each.
    Ransac,
}

/// Options of alignment without an initial guess.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct GlobalOptions {
    /// Method that finds the pose.
    pub method: GlobalRegistration,
    /// Minimum number of matches that agree on a pose, 3 or more; with fewer there is no result.
    pub min_agreeing: usize,
    /// Minimum share of all matches that agree, 0–1; by chance about 0.01 to 0.03 of them agree.
    pub min_share: f64,
    /// Seed of the random samples.
    pub seed: u64,
}

impl Default for GlobalOptions {
    fn default() -> Self {
        Self {
            method: GlobalRegistration::default(),
            min_agreeing: 20,
            min_share: 0.03,
            seed: 0,
        }
    }
}

/// Maximum distance of the points of a pair that agrees with a pose, in voxels.
const AGREEING: f64 = 1.5;
/// Maximum number of times that the pose is fitted again to the pairs that agree with it.
const REFINEMENTS: usize = 5;

/// A pose found without an initial guess, accurate to about a voxel if it is right.
///
/// `agreeing` shows whether to trust it. Matches depend on the shapes around points alone. So wrong
/// ones lie anywhere, and hardly any wrong pose makes many of them agree. In fragments of a
/// Kinect's clip through a kitchen (some 500 to 1500 matches) wrong poses had 3 to 22 that agree,
/// at most 0.03 of `matches`; right ones had more than 27, and where the fragments share half
/// mostly more than 100. Below 40 a right one may be off by several voxels. Two places of the same
/// shape, and an object and its mirror image, have many that agree too; no number here shows that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlobalAlignment {
    /// Pose that brings the source onto the target.
    pub target_from_source: Pose,
    /// Number of pairs of points whose descriptors are each other's nearest.
    pub matches: usize,
    /// Number of these that the pose brings within 1.5 voxels, with normals within 45°.
    pub agreeing: usize,
}

/// Aligns two clouds without an initial guess; `None` if too few matches agree on a pose.
///
/// Both must be described with the same voxels. The same input and seed give the same bytes,
/// whatever the number of threads.
///
/// # Errors
/// [`SceneError::Request`] for clouds of different voxels, or a share out of range;
/// [`SceneError::Stopped`].
pub fn register_globally(
    source: &DescribedCloud,
    target: &DescribedCloud,
    options: &GlobalOptions,
    progress: &Progress,
) -> Result<Option<GlobalAlignment>, SceneError> {
    if source.voxel.to_bits() != target.voxel.to_bits() {
        let voxels = [source.voxel, target.voxel];
        return Err(SceneError::Request(format!(
            "clouds with voxels of {voxels:?} cannot be matched; use one size"
        )));
    }
    if !(0.0..=1.0).contains(&options.min_share) {
        return Err(SceneError::Request(
            "the share of matches that agree must be from 0 to 1".into(),
        ));
    }
    let matches = matching::mutual(&source.descriptors, &target.descriptors, progress)?;
    let distance = AGREEING * f64::from(source.voxel);
    let pairs = PointPairs::new(source, target, &matches, distance);
    let least = options
        .min_agreeing
        .max((options.min_share * matches.len() as f64).ceil() as usize)
        .max(3);
    let found = match options.method {
        GlobalRegistration::Fgr => fast(&pairs, distance, options.seed),
        GlobalRegistration::Ransac => sampled(&pairs, least, options.seed),
    };
    progress.check()?;
    let alignment = found.map(|pose| {
        let target_from_source = settled(&pairs, pose);
        let agreeing = pairs.agreeing(&target_from_source);
        GlobalAlignment {
            target_from_source,
            matches: matches.len(),
            agreeing,
        }
    });
    Ok(alignment.filter(|found| found.agreeing >= least))
}

/// Fits the pose again to the pairs that agree with it, as long as that reduces the cost.
fn settled(pairs: &PointPairs, mut pose: Pose) -> Pose {
    let mut cost = pairs.cost(&pose, f64::INFINITY);
    for _ in 0..REFINEMENTS {
        let Some(refined) = pairs.refined(&pose) else {
            break;
        };
        let its_cost = pairs.cost(&refined, f64::INFINITY);
        if its_cost >= cost {
            break;
        }
        (pose, cost) = (refined, its_cost);
    }
    pose
}

/// Minimum ratio of the edges of a tuple in both clouds.
const TUPLE_RATIO: f64 = 0.95;
/// Tuples tried for each pair; ten times the paper's, so that clouds which share a quarter still yield some.
const TRIALS: usize = 1000;
/// Maximum number of tuples used.
const MAX_TUPLES: usize = 1000;
const ITERATIONS: usize = 64;
/// Divisor of the width of the kernel, every `STEPS` iterations.
const DIVISION: f64 = 1.4;
const STEPS: usize = 4;

/// Runs Fast Global Registration (Q.-Y. Zhou, J. Park, V. Koltun, *Fast Global Registration*, ECCV 2016).
///
/// The result is the pose of least Geman–McClure cost over the matched points of tuples of three
/// whose edges have the same lengths in both clouds. The kernel, as wide as the clouds at first,
/// narrows in steps down to `distance`. The pose of each step is solved in closed form, so
/// rotations of any size are found.
fn fast(pairs: &PointPairs, distance: f64, seed: u64) -> Option<Pose> {
    let chosen = tuples(pairs, seed);
    let diameter = [0, 1]
        .map(|end| 2.0 * reach(&chosen, end))
        .into_iter()
        .fold(0.0, f64::max);
    let mut width = diameter * diameter;
    let mut pose = align(chosen.iter().map(|&[source, target]| (source, target, 1.0)))?;
    for iteration in 1..=ITERATIONS {
        let weighted = chosen.iter().map(|&[source, target]| {
            let share = width / (width + pose.transform(source).distance_squared(target));
            (source, target, share * share)
        });
        pose = align(weighted)?;
        if iteration % STEPS == 0 {
            width = (width / DIVISION).max(distance * distance);
        }
    }
    Some(pose)
}

/// Returns matched points of random tuples that fit together.
fn tuples(pairs: &PointPairs, seed: u64) -> Vec<[DVec3; 2]> {
    let (count, mut random) = (pairs.points.len(), Pcg64Mcg::seed_from_u64(seed));
    let mut chosen = Vec::new();
    if count < 3 {
        return chosen;
    }
    for _ in 0..TRIALS * count {
        let [a, b, c] = std::array::from_fn(|_| random.random_range(0..count));
        if [[a, b], [b, c], [c, a]]
            .iter()
            .all(|&[one, other]| pairs.fit_together(one, other, TUPLE_RATIO))
        {
            chosen.extend([a, b, c].map(|pair| pairs.points[pair]));
            if chosen.len() >= 3 * MAX_TUPLES {
                break;
            }
        }
    }
    chosen
}

/// Returns the largest distance of a point to the middle of all.
fn reach(points: &[[DVec3; 2]], end: usize) -> f64 {
    let middle = points.iter().map(|pair| pair[end]).sum::<DVec3>() / points.len().max(1) as f64;
    points
        .iter()
        .map(|pair| pair[end].distance(middle))
        .fold(0.0, f64::max)
}

/// Minimum ratio of the edges of a sample in both clouds.
const EDGE_RATIO: f64 = 0.9;
const MAX_ITERATIONS: usize = 1_000_000;
const CONFIDENCE: f64 = 0.999;

/// Returns the pose that most matched points agree on, over random samples.
///
/// Samples are three matches whose edges have the same lengths in both clouds (M. A. Fischler, R.
/// C. Bolles, *Random sample consensus*, CACM 1981; the check of edges: A. G. Buch et al., *Pose
/// estimation using local structure-specific shape and appearance context*, ICRA 2013).
pub fn sampled(pairs: &PointPairs, min_agreeing: usize, seed: u64) -> Option<Pose> {
    let options = RansacOptions {
        confidence: CONFIDENCE,
        max_iterations: MAX_ITERATIONS,
        max_vain: MAX_ITERATIONS,
        min_inliers: min_agreeing,
        seed,
    };
    consensus(pairs, &options).map(|found| found.model)
}

impl Estimator for PointPairs {
    type Model = Pose;
    const SAMPLE: usize = 3;

    fn count(&self) -> usize {
        self.points.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<Pose>) {
        let &[a, b, c] = sample else { return };
        if ![[a, b], [b, c], [c, a]]
            .iter()
            .all(|&[one, other]| self.fit_together(one, other, EDGE_RATIO))
        {
            return;
        }
        let pose = align(
            sample
                .iter()
                .map(|&pair| (self.points[pair][0], self.points[pair][1], 1.0)),
        );
        found.extend(pose.filter(|pose| sample.iter().all(|&pair| self.same_normal(pose, pair))));
    }

    fn cost(&self, pose: &Pose, enough: f64) -> f64 {
        Self::cost(self, pose, enough)
    }

    fn inliers(&self, pose: &Pose) -> Vec<u32> {
        self.within(pose)
    }

    fn refine(&self, pose: &Pose) -> Option<Pose> {
        self.refined(pose)
    }
}
