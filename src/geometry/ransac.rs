//! Random sample consensus: one loop for every model. A model brings how it is fitted to a few correspondences, what it
//! costs, and how it is refined; same input + seed → same output.

use pulp::{Simd, WithSimd};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// What the loop must know of a model and its correspondences.
pub trait Estimator {
    /// What is sought.
    type Model: Copy;
    /// How many correspondences fix a model; at most 8.
    const SAMPLE: usize;

    /// How many correspondences there are; the more trustworthy should come first.
    fn count(&self) -> usize;
    /// Appends all models that satisfy the correspondences of a sample.
    fn fit(&self, sample: &[usize], found: &mut Vec<Self::Model>);
    /// The sum over all correspondences of the squared error, cut off at the squared threshold (MSAC: P. Torr, A.
    /// Zisserman, *MLESAC*, CVIU 2000). Once the sum passes `enough` any number above it may be returned.
    fn cost(&self, model: &Self::Model, enough: f64) -> f64;
    /// Correspondences within the threshold, ascending.
    fn inliers(&self, model: &Self::Model) -> Vec<u32>;
    /// A model that fits many correspondences better, found near `model`; `None` if none was found.
    fn refine(&self, model: &Self::Model) -> Option<Self::Model>;
}

/// How long to look.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RansacOptions {
    /// Wanted probability of having drawn one sample without outliers, below 1.
    pub confidence: f64,
    /// Samples at most.
    pub max_iterations: usize,
    /// Samples after which the search ends where fewer than `min_inliers` agree.
    pub max_vain: usize,
    /// Fewer inliers are no agreement.
    pub min_inliers: usize,
    /// Seed of the samples.
    pub seed: u64,
}

/// What most correspondences agree on.
#[derive(Debug, Clone, PartialEq)]
pub struct Consensus<M> {
    /// The model of least cost.
    pub model: M,
    /// Its inliers, ascending.
    pub inliers: Vec<u32>,
    /// Its cost.
    pub cost: f64,
}

/// The model of least cost over random samples, every model that beats the best so far refined over what agrees with it
/// (O. Chum, J. Matas, J. Kittler, *Locally Optimized RANSAC*, DAGM 2003). Every second sample prefers early
/// correspondences, in the spirit of O. Chum, J. Matas, *Matching with PROSAC*, CVPR 2005. `None` where fewer than
/// `min_inliers` agree.
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

/// The model that costs least, where it costs less than `enough`.
fn best_of<E: Estimator>(
    estimator: &E,
    models: &[E::Model],
    mut enough: f64,
) -> Option<(E::Model, f64)> {
    let mut best = None;
    for model in models {
        let cost = estimator.cost(model, enough);
        if cost < enough {
            enough = cost;
            best = Some((*model, cost));
        }
    }
    best
}

/// Samples at least: a model of the wrong kind, such as the second motion that a plane allows, can explain most of what
/// the right one explains, and must have a chance to be beaten.
const MIN_ITERATIONS: usize = 60;
/// How often the refined model is refined again.
const REFINEMENTS: usize = 3;

fn optimised<E: Estimator>(
    estimator: &E,
    (mut model, mut cost): (E::Model, f64),
) -> Consensus<E::Model> {
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

/// Samples after which one without outliers was drawn with the wanted probability, given the probabilities that a
/// correspondence of an early and of a uniform sample is an inlier; the two kinds take turns.
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
    // A float beyond the range becomes the largest number.
    (wanted.ceil() as usize).clamp(
        MIN_ITERATIONS.min(options.max_iterations),
        options.max_iterations,
    )
}

/// Draws different indices below a count.
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

    /// Fills `sample` with different indices, each as likely as the others; `sample` may not be longer than the count.
    pub fn uniform(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share);
    }

    /// Fills `sample` with different indices, low ones far more often: half of them come from the first eighth.
    pub fn early(&mut self, sample: &mut [usize]) {
        self.fill(sample, |share| share * share * share);
    }

    /// The probability that an index of an early and of a uniform sample is among those given.
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

/// Correspondences that are looked at side by side.
pub const LANES: usize = 8;
/// How many blocks are summed between two checks of the sum.
const BLOCKS_BETWEEN_CHECKS: usize = 8;

/// Sum of squared errors cut off at a limit, for [`Estimator::cost`]. Correspondences lie in blocks of [`LANES`],
/// of which the last may have places without one: their error is NaN, and they count nothing.
pub struct Cutoff<'a, B, E> {
    blocks: &'a [B],
    count: usize,
    limit: f64,
    enough: f64,
    errors: E,
}

impl<'a, B, E: Fn(&B) -> [f64; LANES]> Cutoff<'a, B, E> {
    /// Of `count` correspondences in blocks, whose squared errors `errors` gives; cut off at `limit`, and free to end
    /// early above `enough`.
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

/// Places of correspondences whose squared error is below a limit, ascending.
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
