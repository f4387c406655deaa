/// Which source pixels make each target pixel of a row, with their shares of its length.
pub(super) struct Resampling {
    /// Per target pixel: the first source pixel, and the shares of it and of those after it.
    shares: Vec<(usize, Vec<f32>)>,
}

impl Resampling {
    /// From `source` to at most as many `target` pixels by area.
    pub fn new(source: usize, target: usize) -> Self {
        let step = source as f64 / target as f64;
        let shares = (0..target).map(|at| {
            let (start, end) = (at as f64 * step, (at + 1) as f64 * step);
            let (first, last) = (start as usize, (end.ceil() as usize).min(source));
            let share = |pixel: usize| {
                ((end.min(pixel as f64 + 1.0) - start.max(pixel as f64)) / step) as f32
            };
            (first, (first..last).map(share).collect())
        });
        Self {
            shares: shares.collect(),
        }
    }

    /// One row of pixels, each channel averaged by area.
    pub fn row<const N: usize>(&self, source: &[[f32; N]], target: &mut [[f32; N]]) {
        for ((first, shares), target) in self.shares.iter().zip(target) {
            *target = [0.0; N];
            for (share, pixel) in shares.iter().zip(&source[*first..]) {
                (0..N).for_each(|channel| target[channel] += share * pixel[channel]);
            }
        }
    }

    /// Source rows and shares that make one target row.
    pub fn of(&self, target: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let (first, shares) = &self.shares[target];
        shares
            .iter()
            .enumerate()
            .map(move |(at, &share)| (first + at, share))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_taken_by_area() {
        let mut target = [[0.0]; 2];
        Resampling::new(3, 2).row(&[[0.0], [3.0], [9.0]], &mut target);
        assert!(
            (target[0][0] - 1.0).abs() < 1e-6 && (target[1][0] - 7.0).abs() < 1e-6,
            "{target:?}"
        );
    }
}
