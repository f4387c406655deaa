use pulp::{Arch, Simd, WithSimd};

use crate::scene::sfm::matching::{LANES, ROWS, Value, tile};

/// The nearest of a few centres for each of many descriptors.
pub(super) struct Assign<'a, T> {
    /// Centres, one after the other.
    pub centres: &'a [f32],
    /// Values per centre and descriptor.
    pub dim: usize,
    /// Descriptors, one after the other.
    pub values: &'a [T],
}

impl<T: Value> Assign<'_, T> {
    /// For each descriptor the index of the nearest centre; the lowest where several are equally near.
    pub fn nearest(self) -> Vec<usize> {
        Arch::new().dispatch(self)
    }

    #[inline(always)]
    fn run<const FUSED: bool>(&self) -> Vec<usize> {
        let dim = self.dim;
        let (panels, halves) = self.panels();
        let mut nearest = Vec::with_capacity(self.values.len() / dim);
        let mut units = vec![0.0; ROWS * dim];
        for group in self.values.chunks(ROWS * dim) {
            for (unit, value) in units.iter_mut().zip(group) {
                *unit = value.unit();
            }
            let rows: [&[f32]; ROWS] = std::array::from_fn(|row| &units[row * dim..(row + 1) * dim]);
            let mut best = [(f32::NEG_INFINITY, 0); ROWS];
            for (at, panel) in panels.iter().enumerate() {
                let products = tile::<FUSED>(rows, panel);
                for (best, products) in best.iter_mut().zip(&products) {
                    for lane in 0..LANES {
                        let score = products[lane] - halves[at][lane];
                        if score > best.0 {
                            *best = (score, at * LANES + lane);
                        }
                    }
                }
            }
            nearest.extend(best.iter().take(group.len() / dim).map(|&(_, centre)| centre));
        }
        nearest
    }

    /// Centres as columns, and half their squared lengths: |x − c|² is least where x·c − c·c / 2 is largest.
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

impl<T: Value> WithSimd for Assign<'_, T> {
    type Output = Vec<usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Vec<usize> {
        if S::IS_SCALAR { self.run::<false>() } else { self.run::<true>() }
    }
}
