use glam::DVec3;
use nalgebra::{Matrix6, Vector6};

use super::icp::Extent;
use super::levels::{Level, Partner};

/// Sum over partners of JᵀJ with J = how the moved point changes with a motion `exp(delta)`, turn first.
pub fn information(partners: &[Partner]) -> [[f64; 6]; 6] {
    let mut sum = Matrix6::zeros();
    for partner in partners {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let turn = partner.moved.cross(axis);
            let row = Vector6::new(turn.x, turn.y, turn.z, axis.x, axis.y, axis.z);
            sum.ger(1.0, &row, &row, 1.0);
        }
    }
    sum.into()
}

/// How firmly the surfaces hold the motion that they hold least, 0 to 1/6: the mean over partners of the squared cosine
/// between that motion and the one that changes their point-to-plane distance most, in the units of their extent.
pub fn firmness(level: &Level, partners: &[Partner]) -> f64 {
    let extent = Extent::new(partners);
    let mut sum: Matrix6<f64> = Matrix6::zeros();
    for partner in partners {
        let row = extent
            .along(
                partner.moved,
                level.target.normals[partner.target].as_dvec3(),
            )
            .normalize();
        sum.ger(1.0, &row, &row, 1.0);
    }
    (sum.symmetric_eigenvalues().min() / partners.len() as f64).max(0.0)
}

/// Root mean square of the partners' point-to-plane distances.
pub fn rmse(level: &Level, partners: &[Partner]) -> f64 {
    let squares: f64 = partners
        .iter()
        .map(|partner| level.distance(partner).powi(2))
        .sum();
    (squares / partners.len().max(1) as f64).sqrt()
}

/// Pearson's correlation of the partners' intensities; `None` where one cloud's are all alike.
pub fn correlation(level: &Level, partners: &[Partner]) -> Option<f64> {
    let pairs = || {
        let intensity = |partner: &Partner| {
            [
                level.source.intensities[partner.source],
                level.target.intensities[partner.target],
            ]
            .map(f64::from)
        };
        partners.iter().map(intensity)
    };
    let count = partners.len().max(1) as f64;
    let mean = pairs().fold([0.0; 2], |sum, pair| {
        [sum[0] + pair[0] / count, sum[1] + pair[1] / count]
    });
    let [mut source, mut target, mut both] = [0.0; 3];
    for pair in pairs() {
        let [a, b] = [pair[0] - mean[0], pair[1] - mean[1]];
        source += a * a;
        target += b * b;
        both += a * b;
    }
    let scale = (source * target).sqrt();
    (scale > 1e-9 * count).then(|| both / scale)
}
