//! The one inner loop: products of blocks of six rows, as columns of six that the compiler turns into vectors.

/// Unknowns in a block: a pose has six; a camera's intrinsics are padded to six or twelve.
pub const BLOCK: usize = 6;

/// One column of a block.
pub type Column = [f64; BLOCK];

/// A block as its six columns.
pub type Block = [Column; BLOCK];

/// `target −= Σ_k a[k] · b[k]ᵀ`.
#[inline(always)]
pub fn subtract_products(target: &mut Block, a: &[Column], b: &[Column]) {
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

/// The inner product of two columns.
#[inline(always)]
pub fn dot(a: &Column, b: &Column) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
