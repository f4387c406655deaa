//! Random sample consensus (RANSAC): one loop for every model.
//!
//! A model implements [`Estimator`]: how it is fitted to a few correspondences, its cost, and its
//! refinement. The same input and seed give the same output.

use pulp::{Simd, WithSimd};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A model and its correspondences, as the RANSAC loop needs them.
pub trait Estimator {
    /// The model to estimate.
    type Model: Copy;
    /// Number of correspondences that determine a model; at most 8.
    const SAMPLE: usize;

    /// Returns the number of correspondences.
    ///
    /// The more trustworthy ones should come first.
    fn count(&self) -> usize;
    /// Appends all models that satisfy the correspondences of a sample.
    fn fit(&self, sample: &[usize], found: &mut Vec<Self::Model>);
    /// Returns the sum over all correspondences of the truncated squared error.
    ///
    /// Errors are truncated at the squared threshold (MSAC: P. Torr, A. Zisserman, *MLESAC*, CVIU
    /// 2000). Once the sum exceeds `enough`, any number above it may be returned.
    fn cost(&self, model: &Self::Model, enough: f64) -> f64;
    /// Returns the indices of correspondences within the threshold, ascending.
    fn inliers(&self, model: &Self::Model) -> Vec<u32>;
    /// Returns a model near `model` that fits many correspondences better, if there is one.
    fn refine(&self, model: &Self::Model) -> Option<Self::Model>;
}

/// Options of [`consensus`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RansacOptions {
    /// Required probability of having drawn one sample without outliers, below 1.
    pub confidence: f64,
    /// Maximum number of samples.
    pub max_iterations: usize,
    /// Maximum number of samples while fewer than `min_inliers` agree.
    pub max_vain: usize,
    /// Minimum number of inliers of an accepted model.
    pub min_inliers: usize,
    /// Seed of the samples.
    pub seed: u64,
}

/// Model with the most support.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus<M> {
    /// Model with the lowest cost.
    pub model: M,
    /// Indices of its inliers, ascending.
    pub inliers: Vec<u32>,
    /// Its cost.
    pub cost: f64,
}

/// Returns the model with the lowest cost over random samples.
///
/// Every model that beats the best so far is refined over its inliers (O. Chum, J. Matas, J.
/// Kittler, *Locally Optimized RANSAC*, DAGM 2003). Every second sample prefers early
/// correspondences, in the spirit of O. Chum, J. Matas, *Matching with PROSAC*, CVPR 2005. Returns
/// `None` if fewer than `min_inliers` agree.
pub fn consensus<E: Estimator>(
    estimator: &E,
    options: &RansacOptions,
) -> Option<Consensus<E::Model>> {
    let count = estimator.count();
    if count < E::SAMPLE.max(options.min_inliers) {
        return None;
    }
    let mut sampler = Sampler::new(options.seed, count);
    let mut drawn = [0; 8];
    let sample = &mut drawn[..E::SAMPLE];
    let mut models = Vec::new();
    let mut best: Option<Consensus<E::Model>> = None;
    let mut needed = options.max_vain.min(options.max_iterations);
    let mut iteration = 0;
    while iteration < needed {
        if iteration % 2 == 0 {
            sampler.early(sample);
        } else {
            sampler.uniform(sample);
        }
        iteration += 1;
        models.clear();
        estimator.fit(sample, &mut models);
        if let Some(better) = best_of(
            estimator,
            &models,
            best.as_ref().map_or(f64::INFINITY, |b| b.cost),
        ) {
            let found = optimised(estimator, better);
            if found.inliers.len() >= options.min_inliers {
                needed = trials(options, sampler.shares(&found.inliers), E::SAMPLE);
            }
            best = Some(found);
        }
    }
    best.filter(|found| found.inliers.len() >= options.min_inliers)
}

/// A model with its cost.
#[derive(Clone, Copy)]
struct ScoredModel<M> {
    model: M,
    cost: f64,
}

/// Returns the model with the lowest cost, if it is below `enough`.
fn best_of<E: Estimator>(
    estimator: &E,
    models: &[E::Model],
    mut enough: f64,
) -> Option<ScoredModel<E::Model>> {
    let mut best = None;
    for model in models {
        let cost = estimator.cost(model, enough);
        if cost < enough {
            enough = cost;
            best = Some(ScoredModel {
                model: *model,
                cost,
            });
        }
    }
    best
}

/// Minimum number of samples.
///
/// A model of the wrong kind, such as the second motion that a plane allows, can explain most of
/// the correct model's inliers. More samples let the correct one win.
const MIN_ITERATIONS: usize = 60;
/// Maximum number of refinements of the best model.
const REFINEMENTS: usize = 3;

/// Refines a model as long as its cost falls.
fn optimised<E: Estimator>(estimator: &E, start: ScoredModel<E::Model>) -> Consensus<E::Model> {
    let ScoredModel {
        mut model,
        mut cost,
    } = start;
    for _ in 0..REFINEMENTS {
        let Some(refined) = estimator.refine(&model) else {
            break;
        };
        let its_cost = estimator.cost(&refined, cost);
        let gain = cost - its_cost;
        if gain.is_nan() || gain <= 0.0 {
            break;
        }
        let last = gain < 1e-3 * cost;
        (model, cost) = (refined, its_cost);
        if last {
            break;
        }
    }
    Consensus {
        model,
        inliers: estimator.inliers(&model),
        cost,
    }
}

/// Returns the number of samples for the required probability of one without outliers.
///
/// `shares` are the probabilities that a correspondence of an early and of a uniform sample is an
/// inlier; the two kinds alternate.
fn trials(options: &RansacOptions, shares: [f64; 2], sample: usize) -> usize {
    let power = i32::try_from(sample).unwrap_or(i32::MAX);
    let tainted: f64 = shares
        .map(|share| {
            (1.0 - share.min(1.0).powi(power))
                .max(f64::MIN_POSITIVE)
                .ln()
        })
        .iter()
        .sum();
    let wanted = 2.0 * (1.0 - options.confidence).max(f64::MIN_POSITIVE).ln() / tainted;
    // The cast saturates for floats beyond the range.
    (wanted.ceil() as usize).clamp(
        MIN_ITERATIONS.min(options.max_iterations),
        options.max_iterations,
    )
}

/// Draws distinct indices below a count.
pub(super) struct Sampler {
    random: Pcg64Mcg,
    count: usize,
}

impl Sampler {
    pub fn new(seed: u64, count: usize) -> Self {
        Self {
            random: Pcg64Mcg::seed_from_u64(seed),
            count,
        }
    }

    /// Fills `sample` with distinct indices, all equally likely.
    ///
    /// `sample` must not be longer than the count.
    pub fn uniform(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share);
    }

    /// Fills `sample` with distinct indices, preferring low ones: half come from the first eighth.
    pub fn early(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share * share * share);
    }

    /// Returns the probability that a sampled index is among those given.
    ///
    /// The first value is for early samples, the second for uniform ones.
    pub fn shares(&self, places: &[u32]) -> [f64; 2] {
        let count = self.count as f64;
        let below = |place: f64| (place / count).cbrt();
        let early = places
            .iter()
            .map(|&place| below(f64::from(place) + 1.0) - below(f64::from(place)))
            .sum();
        [early, places.len() as f64 / count]
    }

    fn fill(&mut self, sample: &mut [usize], place: impl Fn(f64) -> f64) {
        for i in 0..sample.len() {
            sample[i] = loop {
                let share: f64 = self.random.random();
                let drawn = ((place(share) * self.count as f64) as usize).min(self.count - 1);
                if !sample[..i].contains(&drawn) {
                    break drawn;
                }
            };
        }
    }
}

/// Number of correspondences that are processed at once with SIMD.
pub const LANES: usize = 8;
/// Number of blocks between two checks of the sum.
const BLOCKS_BETWEEN_CHECKS: usize = 8;

/// Sum of squared errors truncated at a limit, for [`Estimator::cost`].
///
/// Correspondences are stored in blocks of [`LANES`]. Unused lanes of the last block must have NaN
/// as their error; they do not count.
pub struct Cutoff<'a, B, E> {
    blocks: &'a [B],
    count: usize,
    limit: f64,
    enough: f64,
    errors: E,
}

impl<'a, B, E: Fn(&B) -> [f64; LANES]> Cutoff<'a, B, E> {
    /// Sums over `count` correspondences in blocks, whose squared errors `errors` computes.
    ///
    /// Errors are truncated at `limit`; the sum may end early above `enough`.
    pub fn new(blocks: &'a [B], count: usize, [limit, enough]: [f64; 2], errors: E) -> Self {
        Self {
            blocks,
            count,
            limit,
            enough,
            errors,
        }
    }
}

impl<B, E: Fn(&B) -> [f64; LANES]> WithSimd for Cutoff<'_, B, E> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let Self {
            blocks,
            count,
            limit,
            enough,
            errors,
        } = self;
        let mut total = -limit * (blocks.len() * LANES - count) as f64;
        for chunk in blocks.chunks(BLOCKS_BETWEEN_CHECKS) {
            let mut sums = [0.0; LANES];
            for block in chunk {
                let errors = errors(block);
                for lane in 0..LANES {
                    // NaN compares false and costs the limit.
                    sums[lane] += if errors[lane] < limit {
                        errors[lane]
                    } else {
                        limit
                    };
                }
            }
            total += sums.iter().sum::<f64>();
            if total > enough {
                break;
            }
        }
        total
    }
}

/// Returns the indices of correspondences whose squared error is below a limit, ascending.
pub fn within<B>(blocks: &[B], limit: f64, errors: impl Fn(&B) -> [f64; LANES]) -> Vec<u32> {
    let mut places = Vec::new();
    for (at, block) in blocks.iter().enumerate() {
        let errors = errors(block);
        places.extend(
            (0..LANES)
                .filter(|&lane| errors[lane] < limit)
                .map(|lane| (at * LANES + lane) as u32),
        );
    }
    places
}

#[cfg(test)]
mod tests;
