//! Axes and bounds of a scene; the up direction is estimated from the cameras.

use glam::{DQuat, DVec3, Mat3, Vec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use ostra_core::statistics::trimmed_range;
use ostra_frames::Frame;

/// Minimum length of the horizontal part of the mean viewing direction.
///
/// A shorter one does not define the front.
const LEVEL_SHARE: f32 = 0.2;

/// The right, up and forward directions of a scene: orthogonal unit vectors in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// To the right.
    pub right: Vec3,
    /// Upwards.
    pub up: Vec3,
    /// Away from a viewer in front of the scene.
    pub forward: Vec3,
}

/// A side that the scene can be viewed from.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum Side {
    /// From the side of the cameras.
    Front,
    /// From behind.
    Back,
    /// From the left.
    Left,
    /// From the right.
    Right,
    /// From above.
    Top,
    /// From below.
    Bottom,
}

impl Side {
    /// All six sides.
    pub const ALL: [Self; 6] = [
        Self::Front,
        Self::Back,
        Self::Left,
        Self::Right,
        Self::Top,
        Self::Bottom,
    ];
}

impl Axes {
    /// Creates axes from an up direction and the part of `forward` that is orthogonal to it.
    #[must_use]
    pub fn new(up: Vec3, forward: Vec3) -> Self {
        let up = up.normalize_or(Vec3::NEG_Y);
        let forward = forward
            .reject_from_normalized(up)
            .try_normalize()
            .unwrap_or_else(|| up.any_orthonormal_vector());
        Self {
            right: forward.cross(up),
            up,
            forward,
        }
    }

    /// Estimates the axes from the cameras.
    ///
    /// Up is the estimated vertical. Forward is the mean viewing direction, or the first camera's
    /// if the cameras are all around the scene. Without cameras, y points down and z forward.
    #[must_use]
    pub fn of_cameras(frames: &[Frame]) -> Self {
        let posed = frames.iter().filter_map(Frame::posed_camera);
        let turns: Vec<DQuat> = posed.map(|(_, pose)| pose.rotation.conjugate()).collect();
        let up = upright(&turns).as_vec3();
        let directions: Vec<Vec3> = turns.iter().map(|turn| turn.as_quat() * Vec3::Z).collect();
        let level = (directions.iter().sum::<Vec3>() / directions.len().max(1) as f32)
            .reject_from_normalized(up);
        let first = directions.first().copied().unwrap_or(Vec3::Z);
        Self::new(
            up,
            if level.length() > LEVEL_SHARE {
                level
            } else {
                first
            },
        )
    }

    /// Returns the rotation from world space to coordinates along right, up and forward.
    #[must_use]
    pub fn axes_from_world(&self) -> Mat3 {
        Mat3::from_cols(self.right, self.up, self.forward).transpose()
    }

    /// Returns the box along these axes that contains the points; see [`Bounds::of`].
    #[must_use]
    pub fn bounds(&self, points: impl Iterator<Item = Vec3>) -> Option<Bounds> {
        let axes_from_world = self.axes_from_world();
        Bounds::of(points.map(|x| axes_from_world * x))
    }

    /// Returns the viewing direction from a side and the direction that is up in the image.
    #[must_use]
    pub fn look_from(&self, side: Side) -> (Vec3, Vec3) {
        match side {
            Side::Front => (self.forward, self.up),
            Side::Back => (-self.forward, self.up),
            Side::Left => (self.right, self.up),
            Side::Right => (-self.right, self.up),
            Side::Top => (-self.up, self.forward),
            Side::Bottom => (self.up, self.forward),
        }
    }
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Minimum corner.
    pub min: Vec3,
    /// Maximum corner.
    pub max: Vec3,
}

impl Bounds {
    /// Returns the box that contains all but the outermost points along each axis.
    ///
    /// 0.5 % of the points are cut off at either end. Without this cut, a few outliers would shrink
    /// the scene to a dot. Returns `None` without finite points.
    #[must_use]
    pub fn of(points: impl Iterator<Item = Vec3>) -> Option<Self> {
        let points: Vec<Vec3> = points.filter(|p| p.is_finite()).collect();
        if points.is_empty() {
            return None;
        }
        let (mut min, mut max) = (Vec3::ZERO, Vec3::ZERO);
        for axis in 0..3 {
            let mut values: Vec<f32> = points.iter().map(|p| p[axis]).collect();
            let cut = values.len() / 200;
            [min[axis], max[axis]] = trimmed_range(&mut values, cut)?;
        }
        Some(Self { min, max })
    }

    /// Returns the centre.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) / 2.0
    }

    /// Returns half the diagonal, above 0.
    #[must_use]
    pub fn radius(&self) -> f32 {
        ((self.max - self.min).length() / 2.0).max(1e-6)
    }
}

/// Standard deviation of the roll of a hand-held level camera, as the sine of the angle (3°).
const ROLL: f64 = 0.05;
/// Standard deviation of the mean camera up from vertical, as the sine of the angle (15°).
const PITCH: f64 = 0.26;
/// Number of reweighting rounds; further rounds make no visible difference.
const ROUNDS: usize = 12;

/// Estimates the up direction from the rotations of cameras (`world_from_camera`).
///
/// Returns a unit vector in world space, or -y without cameras.
///
/// A camera may be pitched up or down, but people hold it level, in landscape or portrait format.
/// One of its image axes is then horizontal. Up is the direction most orthogonal to these axes of
/// all cameras, by least squares. Rolled cameras have little weight (Cauchy weights). If the axes
/// are nearly parallel, as for cameras in a row, they do not determine the forward tilt. The mean of
/// the cameras' up directions then decides.
pub(super) fn upright(turns: &[DQuat]) -> DVec3 {
    let mean =
        turns.iter().map(|&turn| turn * DVec3::NEG_Y).sum::<DVec3>() / turns.len().max(1) as f64;
    let Some(mut up) = mean.try_normalize() else {
        return DVec3::NEG_Y;
    };
    let toward_mean = (Matrix3::identity() - outer(mean)) / PITCH.powi(2);
    for round in 0..ROUNDS {
        let level = turns.iter().map(|turn| level_axis(*turn, up)).map(|axis| {
            // The initial direction, the mean of the up directions, may be far off. All cameras
            // have the same weight in the first round.
            let off = if round == 0 { 0.0 } else { axis.dot(up) / ROLL };
            outer(axis) / (ROLL.powi(2) * (1.0 + off * off))
        });
        let least = least_axis(toward_mean + level.sum::<Matrix3<f64>>());
        up = least * least.dot(mean).signum();
    }
    up
}

/// Returns the image axis that is closer to horizontal: x, or y in portrait format.
fn level_axis(turn: DQuat, up: DVec3) -> DVec3 {
    let [across, along] = [turn * DVec3::X, turn * DVec3::Y];
    if across.dot(up).abs() <= along.dot(up).abs() {
        across
    } else {
        along
    }
}

fn outer(axis: DVec3) -> Matrix3<f64> {
    let axis = Vector3::from(axis.to_array());
    axis * axis.transpose()
}

fn least_axis(sum: Matrix3<f64>) -> DVec3 {
    let eigen = SymmetricEigen::new(sum);
    let least = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    DVec3::new(least[0], least[1], least[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a camera turned by `yaw` around -y, pitched `down` and rolled by `roll` (degrees).
    fn turn(yaw: f64, down: f64, roll: f64) -> DQuat {
        let around =
            DQuat::from_rotation_y(yaw.to_radians()) * DQuat::from_rotation_x(-down.to_radians());
        around * DQuat::from_rotation_z(roll.to_radians())
    }

    fn off_deg(turns: &[DQuat]) -> f64 {
        upright(turns).angle_between(DVec3::NEG_Y).to_degrees()
    }

    fn mean_off_deg(turns: &[DQuat]) -> f64 {
        turns
            .iter()
            .map(|&turn| turn * DVec3::NEG_Y)
            .sum::<DVec3>()
            .angle_between(DVec3::NEG_Y)
            .to_degrees()
    }

    /// Returns a third of a circle of cameras in steps of 5°, with the roll of a hand-held camera.
    fn arc(down: f64) -> Vec<DQuat> {
        (-12..=12)
            .map(|k| {
                turn(
                    5.0 * f64::from(k),
                    down,
                    [1.0, -2.0, 0.5, 1.5, -1.0][(k + 12) as usize % 5],
                )
            })
            .collect()
    }

    #[test]
    fn pitched_cameras_on_an_arc_give_the_vertical() {
        for down in [20.0, 25.0, 30.0, -20.0, 55.0] {
            let turns = arc(down);
            assert!(
                mean_off_deg(&turns) > 15.0 && off_deg(&turns) < 1.5,
                "{down}: {}",
                off_deg(&turns)
            );
        }
    }

    #[test]
    fn portrait_and_rolled_cameras_do_not_tilt_the_vertical() {
        let mut turns = arc(25.0);
        turns
            .iter_mut()
            .step_by(3)
            .for_each(|turn| *turn *= DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2));
        assert!(
            off_deg(&turns) < 1.5,
            "a quarter turned: {}",
            off_deg(&turns)
        );
        let mut turns = arc(25.0);
        turns
            .iter_mut()
            .take(5)
            .for_each(|turn| *turn *= DQuat::from_rotation_z(0.5));
        assert!(off_deg(&turns) < 1.5, "five askew: {}", off_deg(&turns));
    }

    /// Parallel right axes do not determine the forward tilt: the mean up direction decides.
    #[test]
    fn cameras_in_a_row_use_their_mean_up() {
        for down in [0.0, 10.0, 30.0] {
            for turns in [vec![turn(30.0, down, 0.0); 6], vec![turn(0.0, down, 0.0)]] {
                assert!(
                    (off_deg(&turns) - down).abs() < 1e-6,
                    "{down}: {}",
                    off_deg(&turns)
                );
            }
        }
        for (spread, roll) in [(2.0, 2.0), (5.0, 2.0), (10.0, 1.0)] {
            let few = [turn(0.0, 0.0, roll), turn(spread, 0.0, -roll)];
            assert!(off_deg(&few) < 10.0, "{spread}: {}", off_deg(&few));
        }
        assert_eq!(upright(&[]), DVec3::NEG_Y);
    }
}
