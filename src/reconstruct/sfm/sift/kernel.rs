/// Reach of a Gaussian kernel in standard deviations: what lies beyond weighs less than a ten-thousandth.
const REACH: f32 = 4.0;

/// Weights of neighbouring samples; `taps[0]` belongs to the sample `first` steps from the one asked for.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Kernel {
    /// Offset of the first tap in samples.
    pub first: isize,
    /// Weights, summing to 1.
    pub taps: Vec<f32>,
}

impl Kernel {
    /// A Gaussian of standard deviation `sigma` samples.
    pub fn gaussian(sigma: f32) -> Self {
        let reach = (REACH * sigma).ceil().max(1.0) as isize;
        let weights: Vec<f32> = (-reach..=reach)
            .map(|k| (-0.5 * (k as f32 / sigma).powi(2)).exp())
            .collect();
        Self {
            first: -reach,
            taps: normalised(weights),
        }
    }

    /// Doubling by linear interpolation followed by a Gaussian of `sigma` doubled samples, as two kernels over the
    /// original samples: for the doubled samples at `2i` and for those at `2i + 1`.
    pub fn doubling(sigma: f32) -> [Self; 2] {
        let fine = Self::gaussian(sigma);
        let reach = -fine.first + 1;
        let weight = |offset: isize| {
            let tap = |at: isize| {
                let known = usize::try_from(at - fine.first)
                    .ok()
                    .and_then(|k| fine.taps.get(k));
                known.copied().unwrap_or(0.0)
            };
            0.5 * tap(offset - 1) + tap(offset) + 0.5 * tap(offset + 1)
        };
        [0, 1].map(|phase| {
            let first = -(reach - phase) / 2;
            let last = (reach + phase) / 2;
            let weights = (first..=last).map(|k| weight(phase - 2 * k)).collect();
            Self {
                first,
                taps: normalised(weights),
            }
        })
    }
}

/// Variance that linear interpolation to the double adds, in squared doubled samples.
pub(super) const DOUBLING_VARIANCE: f32 = 0.5;

fn normalised(weights: Vec<f32>) -> Vec<f32> {
    let sum: f32 = weights.iter().sum();
    weights.into_iter().map(|weight| weight / sum).collect()
}
