//! Skyline storage and block Cholesky factorisation.
//!
//! The inner loop is products of blocks of six rows, stored as columns of six that the compiler
//! vectorises.

use pulp::{Arch, Simd, WithSimd};

/// Number of unknowns in a block.
///
/// A pose has six; a camera's intrinsics are padded to six or twelve.
pub const BLOCK: usize = 6;

/// One column of a block.
pub type Column6 = [f64; BLOCK];

/// A block, stored as its six columns.
pub type Block6 = [Column6; BLOCK];

/// Computes `target −= Σ_k a[k] · b[k]ᵀ`.
#[inline(always)]
pub fn subtract_products(target: &mut Block6, a: &[Column6], b: &[Column6]) {
    let mut sum = *target;
    for (a, b) in a.iter().zip(b) {
        for (column, factor) in sum.iter_mut().zip(b) {
            for (value, a) in column.iter_mut().zip(a) {
                *value -= a * factor;
            }
        }
    }
    *target = sum;
}

/// Returns the inner product of two columns.
#[inline(always)]
pub fn dot(a: &Column6, b: &Column6) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// A symmetric matrix of 6×6 blocks in skyline storage.
///
/// Each block row is stored from its first non-zero block to the diagonal; factorisation fills
/// nothing left of that (A. Jennings, *A compact storage scheme for the solution of symmetric
/// linear simultaneous equations*, The Computer Journal 1966).
#[derive(Debug, Clone, Default)]
pub struct Skyline {
    pub rows: Vec<SkylineRow>,
}

/// One row of blocks.
#[derive(Debug, Clone)]
pub struct SkylineRow {
    /// Column of the first stored block.
    pub first: usize,
    /// Blocks from the first to the diagonal one.
    pub blocks: Vec<Block6>,
}

/// Ratio to its original entry below which a pivot counts as zero.
const PIVOT: f64 = 1e-13;

struct Factor<'a>(&'a mut Skyline);

impl WithSimd for Factor<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        (0..self.0.rows.len()).all(|i| self.0.factor_row(i))
    }
}

impl Skyline {
    /// Returns a zero matrix; `first` holds the column of the first block of each row.
    pub fn new(first: &[usize]) -> Self {
        let row = |(i, &first): (usize, &usize)| SkylineRow {
            first,
            blocks: vec![[[0.0; BLOCK]; BLOCK]; i + 1 - first],
        };
        Self {
            rows: first.iter().enumerate().map(row).collect(),
        }
    }

    /// Returns the number of multiplications that [`Self::factor`] takes.
    pub fn work(&self) -> f64 {
        let of = |row: &SkylineRow| (row.blocks.len() * row.blocks.len()) as f64;
        0.5 * (BLOCK * BLOCK * BLOCK) as f64 * self.rows.iter().map(of).sum::<f64>()
    }

    /// Replaces the matrix by its Cholesky factor; returns `false` if it is not positive definite.
    pub fn factor(&mut self) -> bool {
        Arch::new().dispatch(Factor(self))
    }

    #[inline(always)]
    fn factor_row(&mut self, i: usize) -> bool {
        let (done, rest) = self.rows.split_at_mut(i);
        let SkylineRow { first, blocks } = &mut rest[0];
        for (j, row) in done.iter().enumerate().skip(*first) {
            let from = row.first.max(*first);
            let (left, right) = blocks.split_at_mut(j - *first);
            let Some((diagonal, others)) = row.blocks.split_last() else {
                return false;
            };
            let target = &mut right[0];
            subtract_products(
                target,
                left[from - *first..].as_flattened(),
                others[from - row.first..].as_flattened(),
            );
            divide(target, diagonal);
        }
        let Some((diagonal, others)) = blocks.split_last_mut() else {
            return false;
        };
        let before = *diagonal;
        subtract_products(diagonal, others.as_flattened(), others.as_flattened());
        factor_block(diagonal, &before)
    }

    /// Solves for a right-hand side in place, given the factor.
    pub fn solve(&self, x: &mut [Column6]) {
        for (i, row) in self.rows.iter().enumerate() {
            let (before, rest) = x.split_at_mut(i);
            for (block, known) in row.blocks.iter().zip(&before[row.first..]) {
                subtract_product(&mut rest[0], block, known);
            }
            forward(&row.blocks[row.blocks.len() - 1], &mut rest[0]);
        }
        for (i, row) in self.rows.iter().enumerate().rev() {
            let (before, rest) = x.split_at_mut(i);
            backward(&row.blocks[row.blocks.len() - 1], &mut rest[0]);
            for (block, other) in row.blocks.iter().zip(&mut before[row.first..]) {
                for (value, column) in other.iter_mut().zip(block) {
                    *value -= dot(column, &rest[0]);
                }
            }
        }
    }
}

/// Computes `target −= block · x`.
#[inline(always)]
pub fn subtract_product(target: &mut Column6, block: &Block6, x: &Column6) {
    for (column, x) in block.iter().zip(x) {
        for (value, entry) in target.iter_mut().zip(column) {
            *value -= entry * x;
        }
    }
}

/// Computes `block := block · L⁻ᵀ`; factors store the inverse of their diagonal.
#[inline(always)]
fn divide(block: &mut Block6, factor: &Block6) {
    for c in 0..BLOCK {
        let (done, rest) = block.split_at_mut(c);
        for (before, entries) in done.iter().zip(factor) {
            for (value, before) in rest[0].iter_mut().zip(before) {
                *value -= before * entries[c];
            }
        }
        for value in &mut rest[0] {
            *value *= factor[c][c];
        }
    }
}

/// Computes the Cholesky factor of a block that was `before` on the diagonal of the whole matrix.
#[inline(always)]
pub fn factor_block(block: &mut Block6, before: &Block6) -> bool {
    for c in 0..BLOCK {
        let (done, rest) = block.split_at_mut(c);
        let column = &mut rest[0];
        for before in done.iter() {
            for r in c..BLOCK {
                column[r] -= before[r] * before[c];
            }
        }
        let pivot = column[c];
        if pivot.is_nan() || pivot <= PIVOT * before[c][c] {
            return false;
        }
        let inverse = 1.0 / pivot.sqrt();
        for value in &mut column[c + 1..] {
            *value *= inverse;
        }
        column[c] = inverse;
    }
    true
}

/// Computes `x := L⁻¹ x` with a factored block.
#[inline(always)]
pub fn forward(factor: &Block6, x: &mut Column6) {
    for c in 0..BLOCK {
        x[c] *= factor[c][c];
        for r in c + 1..BLOCK {
            x[r] -= factor[c][r] * x[c];
        }
    }
}

/// Computes `x := L⁻ᵀ x` with a factored block.
#[inline(always)]
pub fn backward(factor: &Block6, x: &mut Column6) {
    for c in (0..BLOCK).rev() {
        for r in c + 1..BLOCK {
            x[c] -= factor[c][r] * x[r];
        }
        x[c] *= factor[c][c];
    }
}
