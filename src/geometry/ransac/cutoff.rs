use pulp::{Simd, WithSimd};

/// Correspondences that are looked at side by side.
pub const LANES: usize = 8;
/// How many blocks are summed between two looks at the sum.
const BLOCKS_BETWEEN_CHECKS: usize = 8;

/// Sum of squared errors cut off at a limit, for [`super::Estimator::cost`]. Correspondences lie in blocks of [`LANES`],
/// of which the last may have places without one: their error is NaN, and they count nothing.
pub struct Cutoff<'a, B, E> {
    blocks: &'a [B],
    count: usize,
    limit: f64,
    enough: f64,
    errors: E,
}

impl<'a, B, E: Fn(&B) -> [f64; LANES]> Cutoff<'a, B, E> {
    /// Of `count` correspondences in blocks, whose squared errors `errors` tells; cut off at `limit`, and free to end
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
