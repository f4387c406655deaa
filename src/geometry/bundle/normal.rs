use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::layout::{Factors, Groups, Layout, PointBlock};
use super::linearise::{Derivatives, Linearise};
use super::state::CameraState;
use crate::blocks::{BLOCK, Column6, Skyline, SkylineRow, solve, subtract_products};

/// Number of pieces whose derivatives are held at once.
const WAVE: usize = 8;
/// Minimum curvature for damping, relative to the largest one in the same block.
const LEAST_CURVATURE: f64 = 1e-12;

/// Damped normal equations of poses and intrinsics, with the points eliminated.
#[derive(Debug, Clone)]
pub(super) struct Normal {
    pub matrix: Skyline,
    pub right: Vec<Column6>,
    /// Curvature of each unknown before the points are eliminated.
    curvature: Vec<Column6>,
    wave: Vec<Derivatives>,
}

impl Normal {
    pub fn new(layout: &Layout) -> Self {
        let zero = vec![[0.0; BLOCK]; layout.len()];
        let matrix = Skyline::new(&layout.first);
        Self {
            matrix,
            right: zero.clone(),
            curvature: zero,
            wave: vec![Derivatives::default(); WAVE],
        }
    }

    /// Builds the equations at `state`.
    ///
    /// Each row of blocks is summed by one thread in the order of the pieces, so that the result
    /// does not depend on the number of threads.
    pub fn build(
        &mut self,
        point_blocks: &[PointBlock],
        layout: &Layout,
        state: &CameraState,
        damping: f64,
    ) {
        for row in &mut self.matrix.rows {
            row.blocks.fill([[0.0; BLOCK]; BLOCK]);
        }
        self.right.fill([0.0; BLOCK]);
        self.curvature.fill([0.0; BLOCK]);
        let arch = Arch::new();
        for point_blocks in point_blocks.chunks(WAVE) {
            let wave = &mut self.wave[..point_blocks.len()];
            let fill = |(point_block, out)| {
                arch.dispatch(Linearise {
                    point_block,
                    layout,
                    state,
                    damping,
                    out,
                });
            };
            point_blocks
                .par_iter()
                .zip(wave.par_iter_mut())
                .for_each(fill);
            let rows = self
                .matrix
                .rows
                .par_iter_mut()
                .zip(&mut self.right)
                .zip(&mut self.curvature)
                .enumerate();
            let wave = &*wave;
            rows.for_each(|(block, ((row, right), curvature))| {
                for (point_block, derivatives) in point_blocks.iter().zip(wave) {
                    let (groups, factors) =
                        (&point_block.by_observation, &derivatives.by_observation);
                    arch.dispatch(Add {
                        block,
                        curvature: Some(curvature),
                        row,
                        right,
                        groups,
                        factors,
                    });
                    let (groups, factors) = (&point_block.by_point, &derivatives.by_point);
                    arch.dispatch(Add {
                        block,
                        curvature: None,
                        row,
                        right,
                        groups,
                        factors,
                    });
                }
            });
        }
        self.damp(damping);
    }

    /// Returns the step of all poses and intrinsics; `None` if the equations cannot be solved.
    ///
    /// Overwrites the matrix.
    pub fn solve(&mut self) -> Option<Vec<Column6>> {
        solve(&mut self.matrix, &self.right)
    }

    /// Adds the damping to the diagonal; unknowns without any influence are fixed.
    fn damp(&mut self, damping: f64) {
        for ((row, right), curvature) in self
            .matrix
            .rows
            .iter_mut()
            .zip(&mut self.right)
            .zip(&self.curvature)
        {
            let Some(block) = row.blocks.last_mut() else {
                continue;
            };
            let largest = curvature.iter().fold(0.0f64, |a, &b| a.max(b));
            for (i, &own) in curvature.iter().enumerate() {
                if own > 0.0 {
                    block[i][i] += damping * own.max(LEAST_CURVATURE * largest);
                } else {
                    (block[i][i], right[i]) = (1.0, 0.0);
                }
            }
        }
    }
}

/// Adds the products of one block row's entries with their partners and right-hand sides.
///
/// Subtracts them instead if no curvature is summed.
struct Add<'a, const K: usize> {
    block: usize,
    curvature: Option<&'a mut Column6>,
    row: &'a mut SkylineRow,
    right: &'a mut Column6,
    groups: &'a Groups,
    factors: &'a Factors<K>,
}

impl<const K: usize> WithSimd for Add<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            block,
            mut curvature,
            row,
            right,
            groups,
            factors,
        } = self;
        let sign = if curvature.is_some() { -1.0 } else { 1.0 };
        for (entry, group, partners) in groups.of_block(block) {
            let signed = factors.columns[entry].map(|column| column.map(|v| sign * v));
            for (column, value) in signed.iter().zip(&factors.values[group]) {
                for (sum, entry) in right.iter_mut().zip(column) {
                    *sum += entry * value;
                }
                for (sum, entry) in curvature.iter_mut().flat_map(|c| c.iter_mut()).zip(column) {
                    *sum += entry * entry;
                }
            }
            for partner in partners {
                let target = &mut row.blocks[groups.blocks[partner] as usize - row.first];
                subtract_products(target, &signed, &factors.columns[partner]);
            }
        }
    }
}
