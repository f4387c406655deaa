//! Centres of descriptors: blocked inner products, nearest centres, k-means.

use pulp::{Arch, Simd, WithSimd};

use super::tile::{BytePair, LANES, ROWS, byte_tile, tile};

/// Length of SIFT descriptors in bytes.
const BYTE_LENGTH: f32 = 512.0;
/// Number of partial sums of a dot product of floats, in the same order on every processor.
const PARTS: usize = 16;

/// One value of a descriptor.
pub(crate) trait Value: Copy + Send + Sync {
    /// Returns it as a value of a vector of length 1.
    fn unit(self) -> f32;

    /// Returns the dot product of two descriptors as vectors of length 1.
    fn dot(a: &[Self], b: &[Self]) -> f32;

    /// [`Self::STEP`] neighbouring values, as [`Self::tile`] takes them.
    type Packed: Copy + Default;

    /// Number of values in one [`Self::Packed`].
    const STEP: usize;

    /// Packs values, and passes each pack to `put` with its number.
    fn pack(values: &[Self], put: impl FnMut(usize, Self::Packed));

    /// Computes the dot products of some rows with the columns of a panel, for vectors of length 1.
    fn tile<const FUSED: bool>(
        rows: [&[Self::Packed]; ROWS],
        panel: &[[Self::Packed; LANES]],
    ) -> [[f32; LANES]; ROWS];
}

impl Value for u8 {
    #[inline(always)]
    fn unit(self) -> f32 {
        f32::from(self) / BYTE_LENGTH
    }

    #[inline(always)]
    fn dot(a: &[Self], b: &[Self]) -> f32 {
        let sum: i32 = a
            .iter()
            .zip(b)
            .map(|(&a, &b)| i32::from(a) * i32::from(b))
            .sum();
        sum as f32 / (BYTE_LENGTH * BYTE_LENGTH)
    }

    type Packed = BytePair;

    const STEP: usize = 2;

    #[inline(always)]
    fn pack(values: &[Self], put: impl FnMut(usize, BytePair)) {
        BytePair::each_of(values, put);
    }

    #[inline(always)]
    fn tile<const FUSED: bool>(
        rows: [&[BytePair]; ROWS],
        panel: &[[BytePair; LANES]],
    ) -> [[f32; LANES]; ROWS] {
        let length = BYTE_LENGTH * BYTE_LENGTH;
        byte_tile(rows, panel).map(|sums| sums.map(|sum| sum as f32 / length))
    }
}

impl Value for f32 {
    #[inline(always)]
    fn unit(self) -> f32 {
        self
    }

    #[inline(always)]
    fn dot(a: &[Self], b: &[Self]) -> f32 {
        let mut sums = [0.0; PARTS];
        let (a, a_rest) = a.as_chunks::<PARTS>();
        let (b, b_rest) = b.as_chunks::<PARTS>();
        for (a, b) in a.iter().zip(b) {
            for lane in 0..PARTS {
                sums[lane] += a[lane] * b[lane];
            }
        }
        sums.iter().sum::<f32>() + a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum::<f32>()
    }

    type Packed = Self;

    const STEP: usize = 1;

    #[inline(always)]
    fn pack(values: &[Self], mut put: impl FnMut(usize, Self)) {
        for (k, &value) in values.iter().enumerate() {
            put(k, value);
        }
    }

    #[inline(always)]
    fn tile<const FUSED: bool>(
        rows: [&[Self]; ROWS],
        panel: &[[Self; LANES]],
    ) -> [[f32; LANES]; ROWS] {
        tile::<FUSED>(rows, panel)
    }
}

/// Stands for a centre where there are fewer than requested.
pub(crate) const NO_CENTRE: u32 = u32::MAX;

/// The `N` nearest of a few centres for each of many descriptors.
struct Assign<'a, T, const N: usize> {
    centres: &'a [f32],
    dim: usize,
    values: &'a [T],
}

/// Returns the numbers of the `N` nearest centres of each descriptor, nearest first.
///
/// `values` holds `dim` values per descriptor. The lower number wins a tie.
pub(crate) fn nearest_centres<T: Value, const N: usize>(
    values: &[T],
    centres: &[f32],
    dim: usize,
) -> Vec<[u32; N]> {
    Arch::new().dispatch(Assign {
        centres,
        dim,
        values,
    })
}

/// Runs Lloyd's k-means, started from the first `count` rows of a sample.
///
/// The sample should be in random order. A centre without nearest rows stays where it is.
pub(crate) fn k_means(sample: &[f32], dim: usize, count: usize, rounds: usize) -> Vec<f32> {
    let mut centres = sample[..sample.len().min(count * dim)].to_vec();
    for _ in 0..rounds {
        let nearest = nearest_centres::<f32, 1>(sample, &centres, dim);
        let mut sums = vec![0.0; centres.len()];
        let mut counts = vec![0.0; centres.len() / dim];
        for (row, &[centre]) in sample
            .chunks_exact(dim)
            .zip(&nearest)
            .filter(|(_, to)| to[0] != NO_CENTRE)
        {
            let centre = centre as usize;
            counts[centre] += 1.0;
            sums[centre * dim..(centre + 1) * dim]
                .iter_mut()
                .zip(row)
                .for_each(|(sum, value)| *sum += value);
        }
        let moved = centres
            .chunks_exact_mut(dim)
            .zip(sums.chunks_exact(dim))
            .zip(&counts);
        for ((centre, sum), &count) in moved.filter(|(_, count)| **count > 0.0) {
            centre
                .iter_mut()
                .zip(sum)
                .for_each(|(to, sum)| *to = sum / count);
        }
    }
    centres
}

impl<T: Value, const N: usize> Assign<'_, T, N> {
    #[inline(always)]
    fn run<const FUSED: bool>(&self) -> Vec<[u32; N]> {
        let dim = self.dim;
        let (panels, halves) = self.panels();
        let mut nearest = Vec::with_capacity(self.values.len() / dim);
        let mut units = vec![0.0; ROWS * dim];
        for group in self.values.chunks(ROWS * dim) {
            for (unit, value) in units.iter_mut().zip(group) {
                *unit = value.unit();
            }
            let rows: [&[f32]; ROWS] =
                std::array::from_fn(|row| &units[row * dim..(row + 1) * dim]);
            let mut best = [[(f32::NEG_INFINITY, NO_CENTRE); N]; ROWS];
            for (at, panel) in panels.iter().enumerate() {
                let products = tile::<FUSED>(rows, panel);
                for (best, products) in best.iter_mut().zip(&products) {
                    for lane in 0..LANES {
                        enter(
                            best,
                            products[lane] - halves[at][lane],
                            (at * LANES + lane) as u32,
                        );
                    }
                }
            }
            nearest.extend(
                best.iter()
                    .take(group.len() / dim)
                    .map(|best| best.map(|(_, centre)| centre)),
            );
        }
        nearest
    }

    /// Returns the centres as columns, and half their squared lengths.
    ///
    /// |x − c|² is smallest where x·c − c·c / 2 is largest.
    #[inline(always)]
    fn panels(&self) -> (Vec<Vec<[f32; LANES]>>, Vec<[f32; LANES]>) {
        let count = self.centres.len() / self.dim;
        let mut panels = vec![vec![[0.0; LANES]; self.dim]; count.div_ceil(LANES)];
        let mut halves = vec![[f32::INFINITY; LANES]; count.div_ceil(LANES)];
        for (at, centre) in self.centres.chunks_exact(self.dim).enumerate() {
            let (panel, lane) = (at / LANES, at % LANES);
            for (column, value) in panels[panel].iter_mut().zip(centre) {
                column[lane] = *value;
            }
            halves[panel][lane] = 0.5 * f32::dot(centre, centre);
        }
        (panels, halves)
    }
}

/// Inserts a score in its place among the best.
#[inline(always)]
fn enter<const N: usize>(best: &mut [(f32, u32); N], score: f32, centre: u32) {
    if score > best[N - 1].0 {
        let mut place = N - 1;
        while place > 0 && score > best[place - 1].0 {
            best[place] = best[place - 1];
            place -= 1;
        }
        best[place] = (score, centre);
    }
}

impl<T: Value, const N: usize> WithSimd for Assign<'_, T, N> {
    type Output = Vec<[u32; N]>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Self::Output {
        if S::IS_SCALAR {
            self.run::<false>()
        } else {
            self.run::<true>()
        }
    }
}
