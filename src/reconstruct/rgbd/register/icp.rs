use glam::{DQuat, DVec3};
use nalgebra::{Matrix6, Vector6};

use super::levels::{IcpLevel, Partner};
use ostra_core::job::{Progress, Stopped};
use ostra_core::statistics::upper_median;
use ostra_geometry::Pose;

/// Tukey's constant: 95 % as efficient as least squares for normal errors.
const TUKEY: f64 = 4.685;
/// Standard deviations per median absolute error.
const DEVIATIONS: f64 = 1.4826;
/// Iteration ends when a step rotates by less than this (radians) …
const LAST_TURN: f64 = 1e-5;
/// … and shifts by less than this (voxels).
const LAST_SHIFT: f64 = 1e-3;
/// Motions that the partners constrain by less than this share of the best constrained one are not
/// made: only noise constrains them.
const HELD: f64 = 1e-3;

/// Derivative of a residual by a motion in [`PartnerExtent`]'s units, and the residual.
type IcpResidual = (Vector6<f64>, f64);

/// Runs iterative closest point on one level.
///
/// The cost is point-to-plane (Y. Chen, G. Medioni, *Object modelling by registration of multiple
/// range images*, Image and Vision Computing 1992) and, as 1 − `lambda` of it, the difference of
/// brightness (J. Park, Q.-Y. Zhou, V. Koltun, *Colored Point Cloud Registration Revisited*, ICCV
/// 2017). Both have Tukey's weights for the current spread of the errors. An unconstrained motion,
/// as along a wall, is not made (J. Zhang, M. Kaess, S. Singh, *On degeneracy of optimization-based
/// state estimation problems*, ICRA 2016).
pub fn iterate(
    level: &IcpLevel,
    start: Pose,
    iterations: usize,
    lambda: f64,
    progress: &Progress,
) -> Result<Pose, Stopped> {
    let mut pose = start;
    let mut seen = Vec::new();
    for _ in 0..iterations {
        let partners = level.partners(&pose, &mut seen, progress)?;
        let extent = PartnerExtent::new(&partners);
        let delta = step(level, &partners, &extent, lambda);
        pose = extent.motion(&delta).compose(&pose);
        let [turn, shift] = [
            delta.fixed_rows::<3>(0).norm(),
            delta.fixed_rows::<3>(3).norm(),
        ];
        if turn < LAST_TURN * extent.radius && shift < LAST_SHIFT * level.voxel {
            break;
        }
    }
    Ok(pose)
}

/// Position and size of the set of partners.
///
/// In its units a motion is a rotation about their middle, expressed as the shift at their typical
/// distance from it, followed by a shift.
pub struct PartnerExtent {
    middle: DVec3,
    /// Root mean square distance from the middle; above 0.
    radius: f64,
}

impl PartnerExtent {
    pub fn new(partners: &[Partner]) -> Self {
        let count = partners.len().max(1) as f64;
        let middle = partners.iter().map(|partner| partner.moved).sum::<DVec3>() / count;
        let spread: f64 = partners
            .iter()
            .map(|partner| partner.moved.distance_squared(middle))
            .sum();
        Self {
            middle,
            radius: (spread / count).sqrt().max(f64::MIN_POSITIVE),
        }
    }

    /// Returns the derivative of a point's position along a direction by a motion.
    pub fn along(&self, point: DVec3, direction: DVec3) -> Vector6<f64> {
        let turn = ((point - self.middle) / self.radius).cross(direction);
        Vector6::new(
            turn.x,
            turn.y,
            turn.z,
            direction.x,
            direction.y,
            direction.z,
        )
    }

    fn motion(&self, delta: &Vector6<f64>) -> Pose {
        let rotation =
            DQuat::from_scaled_axis(DVec3::new(delta[0], delta[1], delta[2]) / self.radius);
        let shift = DVec3::new(delta[3], delta[4], delta[5]);
        Pose {
            rotation,
            translation: self.middle - rotation * self.middle + shift,
        }
    }
}

/// Returns the motion that lowers the cost most.
fn step(
    level: &IcpLevel,
    partners: &[Partner],
    extent: &PartnerExtent,
    lambda: f64,
) -> Vector6<f64> {
    let rows = |of: fn(&IcpLevel, &PartnerExtent, &Partner) -> IcpResidual| {
        weighted(
            partners
                .iter()
                .map(|partner| of(level, extent, partner))
                .collect(),
        )
    };
    let (mut matrix, mut right) = rows(distance_row);
    (matrix, right) = (matrix * lambda, right * lambda);
    if lambda < 1.0 {
        let brightness = rows(brightness_row);
        matrix += brightness.0 * (1.0 - lambda);
        right += brightness.1 * (1.0 - lambda);
    }
    // Brightness that is not a number must not reach the eigenvectors.
    if !matrix
        .iter()
        .chain(right.iter())
        .all(|value| value.is_finite())
    {
        return Vector6::zeros();
    }
    let eigen = matrix.symmetric_eigen();
    let least = HELD * eigen.eigenvalues.max();
    let mut delta = Vector6::zeros();
    for (value, direction) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > least {
            delta -= direction * (direction.dot(&right) / value);
        }
    }
    delta
}

fn distance_row(level: &IcpLevel, extent: &PartnerExtent, partner: &Partner) -> IcpResidual {
    let normal = level.target.normals[partner.target].as_dvec3();
    (extent.along(partner.moved, normal), level.distance(partner))
}

fn brightness_row(level: &IcpLevel, extent: &PartnerExtent, partner: &Partner) -> IcpResidual {
    let slope = level.slopes[partner.target].as_dvec3();
    let step = partner.moved - level.target.positions[partner.target].as_dvec3();
    let [there, here] = [
        level.target.intensities[partner.target],
        level.source.intensities[partner.source],
    ];
    (
        extent.along(partner.moved, slope),
        f64::from(there) + slope.dot(step) - f64::from(here),
    )
}

/// Returns the sums of J Jᵀ and J r.
fn weighted(rows: Vec<IcpResidual>) -> (Matrix6<f64>, Vector6<f64>) {
    let mut errors: Vec<f64> = rows.iter().map(|(_, residual)| residual.abs()).collect();
    let (mut matrix, mut right) = (Matrix6::zeros(), Vector6::zeros());
    let Some(median) = upper_median(&mut errors) else {
        return (matrix, right);
    };
    let cut = (TUKEY * DEVIATIONS * median).max(f64::MIN_POSITIVE);
    for (row, residual) in rows {
        let share = (1.0 - (residual / cut).powi(2)).max(0.0);
        let weight = share * share;
        matrix.ger(weight, &row, &row, 1.0);
        right.axpy(weight * residual, &row, 1.0);
    }
    (matrix, right)
}
