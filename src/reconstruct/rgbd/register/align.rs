use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, Vector3};

use ostra_geometry::Pose;

/// Below this ratio of singular values points count as lying in one line.
const LINE_RATIO: f64 = 1e-9;

/// The rigid motion that brings sources nearest to targets in the sense of weighted least squares, from (source, target,
/// weight): W. Kabsch, *A solution for the best rotation to relate two sets of vectors*, Acta Cryst. A 1976. `None` for
/// pairs in one place or line, or without weight.
pub fn align(pairs: impl Iterator<Item = (DVec3, DVec3, f64)> + Clone) -> Option<Pose> {
    let (mut source_mean, mut target_mean, mut total) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (source, target, weight) in pairs.clone() {
        source_mean += weight * source;
        target_mean += weight * target;
        total += weight;
    }
    (source_mean, target_mean) = (source_mean / total, target_mean / total);
    let mut covariance = DMat3::ZERO;
    for (source, target, weight) in pairs {
        let (source, target) = (source - source_mean, weight * (target - target_mean));
        covariance += DMat3::from_cols(target * source.x, target * source.y, target * source.z);
    }
    if !covariance.is_finite() {
        return None;
    }
    let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
    let (u, vt, sigma) = (svd.u?, svd.v_t?, svd.singular_values);
    if sigma[0] <= 0.0 || sigma[1] <= LINE_RATIO * sigma[0] {
        return None;
    }
    let flip = if (u * vt).determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    let matrix = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, flip)) * vt;
    let rotation = DQuat::from_mat3(&DMat3::from_cols_slice(matrix.as_slice())).normalize();
    Some(Pose {
        rotation,
        translation: target_mean - rotation * source_mean,
    })
}
