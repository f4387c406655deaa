use super::sample::Sampler;

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
    /// Zisserman, *MLESAC*, CVIU 2000). Once the sum passes `enough` any number above it may be told.
    fn cost(&self, model: &Self::Model, enough: f64) -> f64;
    /// Correspondences within the threshold, ascending.
    fn inliers(&self, model: &Self::Model) -> Vec<u32>;
    /// A model that fits many correspondences better, found near `model`; `None` where there is none.
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
