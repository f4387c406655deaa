use glam::{DMat3, DVec2};
use nalgebra::{Matrix3, SMatrix};

use super::null_space::{epipolar_equation, from_rows};

/// Returns the fundamental matrix `F` with the least `Σ weight (x2ᵀ F x1)²` over pairs `[x1, x2]`.
///
/// Needs eight or more pairs. Each image's points are centred and scaled first, and the result is
/// made singular (R. Hartley, *In Defense of the Eight-Point Algorithm*, PAMI 1997). It has
/// Frobenius norm 1. Returns `None` for fewer than eight pairs with a weight above 0, and for
/// points in one place.
#[must_use]
pub fn eight_point(pairs: &[[DVec2; 2]], weights: &[f64]) -> Option<DMat3> {
    if weights.iter().filter(|&&w| w > 0.0).count() < 8 {
        return None;
    }
    let to_first = Centring::of(pairs, weights, 0)?;
    let to_second = Centring::of(pairs, weights, 1)?;
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (pair, weight) in pairs.iter().zip(weights) {
        let row = epipolar_equation([to_first.apply(pair[0]), to_second.apply(pair[1])]);
        for i in 0..9 {
            let scaled = weight * row[i];
            (0..9).for_each(|j| normal[(j, i)] += scaled * row[j]);
        }
    }
    let centred = singular(from_rows(&least_eigenvector(normal)?))?;
    let f = to_second.matrix().transpose() * centred * to_first.matrix();
    let norm = f.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    (norm.is_finite() && norm > 0.0).then(|| f * (1.0 / norm))
}

/// The normalisation `scale · (x − centre)`.
pub(super) struct Centring {
    centre: DVec2,
    scale: f64,
}

impl Centring {
    /// Moves the weighted centroid to the origin and scales the root mean square distance to √2.
    pub fn of(pairs: &[[DVec2; 2]], weights: &[f64], side: usize) -> Option<Self> {
        let total: f64 = weights.iter().sum();
        let weighted = || pairs.iter().zip(weights).map(|(pair, &w)| (pair[side], w));
        let centre = weighted().map(|(x, w)| x * w).sum::<DVec2>() / total;
        let spread = weighted()
            .map(|(x, w)| w * x.distance_squared(centre))
            .sum::<f64>()
            / total;
        let rounding = 1e-24 * (1.0 + centre.length_squared());
        (spread.is_finite() && spread > rounding).then(|| Self {
            centre,
            scale: (2.0 / spread).sqrt(),
        })
    }

    pub fn apply(&self, x: DVec2) -> DVec2 {
        self.scale * (x - self.centre)
    }

    pub fn matrix(&self) -> DMat3 {
        let shift = -self.scale * self.centre;
        DMat3::from_cols_array(&[
            self.scale, 0.0, 0.0, 0.0, self.scale, 0.0, shift.x, shift.y, 1.0,
        ])
    }
}

/// Returns the eigenvector of the smallest eigenvalue.
pub(super) fn least_eigenvector(normal: SMatrix<f64, 9, 9>) -> Option<[f64; 9]> {
    if !normal.iter().all(|v| v.is_finite()) {
        return None;
    }
    let eigen = normal.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let mut entries = [0.0; 9];
    entries.copy_from_slice(eigen.eigenvectors.column(least).as_slice());
    Some(entries)
}

/// Returns the nearest matrix of rank two.
fn singular(m: DMat3) -> Option<DMat3> {
    let mut svd = Matrix3::from_column_slice(&m.to_cols_array()).svd(true, true);
    let least = svd.singular_values.imin();
    svd.singular_values[least] = 0.0;
    let nearest = svd.recompose().ok()?;
    Some(DMat3::from_cols_slice(nearest.as_slice()))
}
