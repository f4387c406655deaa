use super::level::MAX_SOURCES;

/// Hypotheses compared when views are chosen: a pixel's own, one of each region, and one of another view.
pub const COMPARED: usize = 10;
/// A higher cost means that a view does not see the surface.
pub const BAD: f32 = 1.2;

/// Weight of each source at a pixel, and the sources with weight, heaviest first.
#[derive(Debug, Clone, Copy)]
pub struct ViewWeights {
    /// Weight by source; their sum is 1.
    pub weights: [f32; MAX_SOURCES],
    /// Sources by decreasing weight.
    pub order: [u8; MAX_SOURCES],
    /// How many of them have weight.
    pub count: usize,
}

/// Chooses views by the costs of several hypotheses together, so that all are compared over the same views.
///
/// A view counts if more than a quarter of the hypotheses are good in it and less than a third bad
/// (Xu and Tao, CVPR 2019). `times` is how often each hypothesis occurred.
#[inline(always)]
pub fn choose_views(
    costs: &[[f32; MAX_SOURCES]],
    times: &[u32],
    sources: usize,
    good: f32,
    best_views: usize,
) -> ViewWeights {
    let mut weights = [0.0; MAX_SOURCES];
    let total: u32 = times.iter().sum();
    for (source, weight) in weights.iter_mut().enumerate().take(sources) {
        let (mut goods, mut bads, mut sum) = (0, 0, 0.0);
        for (costs, &times) in costs.iter().zip(times) {
            let cost = costs[source];
            if cost < good {
                goods += times;
                sum += times as f32 * likelihood(cost);
            }
            bads += if cost > BAD { times } else { 0 };
        }
        if 4 * goods > total && 3 * bads < total {
            *weight = sum * (1.0 / goods as f32);
        }
    }
    if weights.iter().all(|&weight| weight <= 0.0) {
        weights = nearest_two(costs, sources);
    }
    ranked(weights, sources, best_views)
}

/// Returns `exp(−c² / (2 · 0.3²))` by its rational approximation.
#[inline(always)]
fn likelihood(cost: f32) -> f32 {
    let x = cost * (1.0 / 0.18) * cost;
    let y = 1.0 + x * (0.25 + x * 0.031_25);
    1.0 / (y * y * y * y)
}

/// Returns the two views in which any hypothesis costs least.
#[inline(always)]
fn nearest_two(costs: &[[f32; MAX_SOURCES]], sources: usize) -> [f32; MAX_SOURCES] {
    let mut weights = [0.0; MAX_SOURCES];
    let mut least = [f32::INFINITY; MAX_SOURCES];
    for source in 0..sources {
        least[source] = costs
            .iter()
            .fold(f32::INFINITY, |least, costs| least.min(costs[source]));
    }
    for _ in 0..2.min(sources) {
        let mut best = 0;
        for source in 1..sources {
            best = if least[source] < least[best] {
                source
            } else {
                best
            };
        }
        (weights[best], least[best]) = (1.0, f32::INFINITY);
    }
    weights
}

#[inline(always)]
fn ranked(mut weights: [f32; MAX_SOURCES], sources: usize, best_views: usize) -> ViewWeights {
    let mut order = [0u8; MAX_SOURCES];
    let mut left = weights;
    let (mut count, mut sum) = (0, 0.0);
    for _ in 0..best_views.min(sources) {
        let mut best = 0;
        for source in 1..sources {
            best = if left[source] > left[best] {
                source
            } else {
                best
            };
        }
        if left[best] <= 0.0 {
            break;
        }
        sum += left[best];
        (order[count], left[best]) = (best as u8, 0.0);
        count += 1;
    }
    let scale = 1.0 / sum;
    for (weight, left) in weights.iter_mut().zip(left) {
        *weight = if left > 0.0 { 0.0 } else { *weight * scale };
    }
    ViewWeights {
        weights,
        order,
        count,
    }
}
