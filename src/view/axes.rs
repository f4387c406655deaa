//! Axes and bounds of a scene; which way is up, from the cameras.

use glam::{DQuat, DVec3, Mat3, Vec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use ostra_core::statistics::trimmed_range;
use ostra_frames::Frame;

/// Least share of the cameras' common direction that must point sideways for it to say where the front is.
const LEVEL_SHARE: f32 = 0.2;

/// Which way is right, up and away as one stands before a scene: unit vectors in world space, square to each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axes {
    /// To the right.
    pub right: Vec3,
    /// Upwards.
    pub up: Vec3,
    /// Away from who looks at the front.
    pub forward: Vec3,
}

/// The sides that a scene can be seen from.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize, serde::Deserialize,
)]
pub enum Side {
    /// As the cameras stood.
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
    /// All six.
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
    /// Axes with this up and, as far as it is square to that, this direction away from the viewer.
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

    /// Upright as the cameras were held; the front is what most of them look at, or the first one where they
    /// stand all around. Without cameras y is down and z away.
    #[must_use]
    pub fn of_cameras(frames: &[Frame]) -> Self {
        let posed = frames.iter().filter_map(Frame::posed_camera);
        let turns: Vec<DQuat> = posed.map(|(_, pose)| pose.rotation.conjugate()).collect();
        let up = upright(&turns).as_vec3();
        let looks: Vec<Vec3> = turns.iter().map(|turn| turn.as_quat() * Vec3::Z).collect();
        let level =
            (looks.iter().sum::<Vec3>() / looks.len().max(1) as f32).reject_from_normalized(up);
        let first = looks.first().copied().unwrap_or(Vec3::Z);
        Self::new(
            up,
            if level.length() > LEVEL_SHARE {
                level
            } else {
                first
            },
        )
    }

    /// Takes world space to distances along right, up and forward.
    #[must_use]
    pub fn axes_from_world(&self) -> Mat3 {
        Mat3::from_cols(self.right, self.up, self.forward).transpose()
    }

    /// The box along these axes that holds all but the outermost points, see [`Bounds::of`].
    #[must_use]
    pub fn bounds(&self, points: impl Iterator<Item = Vec3>) -> Option<Bounds> {
        let axes_from_world = self.axes_from_world();
        Bounds::of(points.map(|x| axes_from_world * x))
    }

    /// The direction to look along from a side, and what is up in the picture then.
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

/// An axis-parallel box in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: Vec3,
    /// Largest corner.
    pub max: Vec3,
}

impl Bounds {
    /// The box that holds all but the outermost 0.5 % of the points along each axis, so that a few stray points do not
    /// shrink the scene to a dot; `None` without finite points.
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

    /// The middle.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        (self.min + self.max) / 2.0
    }

    /// Half the diagonal, above 0.
    #[must_use]
    pub fn radius(&self) -> f32 {
        ((self.max - self.min).length() / 2.0).max(1e-6)
    }
}

/// Standard deviation of how far a camera held level is rolled, as the sine of the angle: 3° by hand.
const ROLL: f64 = 0.05;
/// Standard deviation of how far the mean of the cameras' ups is off vertical, as the sine of the angle: 15°.
const PITCH: f64 = 0.26;
/// Rounds of weighting, after which the direction moves no more by what a screen shows.
const ROUNDS: usize = 12;

/// Which way is up for cameras with these turns from camera to world space: unit length, in world space; -y without any.
///
/// A camera may look down or up, yet whoever holds it keeps its picture level (or upright, turned by a quarter): the axis
/// to its right is horizontal, so up is the direction most square to these axes of all cameras, by least squares. Cameras
/// that are rolled count little (Cauchy's weights). Where the axes are nearly parallel, as of cameras side by side, they leave
/// open how far to lean forward; there the mean of the cameras' ups decides.
pub(super) fn upright(turns: &[DQuat]) -> DVec3 {
    let mean =
        turns.iter().map(|&turn| turn * DVec3::NEG_Y).sum::<DVec3>() / turns.len().max(1) as f64;
    let Some(mut up) = mean.try_normalize() else {
        return DVec3::NEG_Y;
    };
    let toward_mean = (Matrix3::identity() - outer(mean)) / PITCH.powi(2);
    for round in 0..ROUNDS {
        let level = turns.iter().map(|turn| level_axis(*turn, up)).map(|axis| {
            // The first direction, the mean of ups, may lie far off: it weighs all alike.
            let off = if round == 0 { 0.0 } else { axis.dot(up) / ROLL };
            outer(axis) / (ROLL.powi(2) * (1.0 + off * off))
        });
        let least = least_axis(toward_mean + level.sum::<Matrix3<f64>>());
        up = least * least.dot(mean).signum();
    }
    up
}

/// Of the axes along a camera's picture the one that lies flatter: across it, or along it where it is held upright.
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

    /// Cameras `yaw` degrees around the vertical (-y), looking `down` degrees, rolled by `roll` degrees.
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

    /// A third of a circle in steps of 5°, rolled by hand.
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
    fn an_arc_of_cameras_that_look_down_or_up_stands_upright() {
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
    fn cameras_held_upright_or_askew_do_not_tilt_it() {
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

    /// Right axes that are parallel say nothing about leaning forward: the mean of ups does, and is made square to them.
    #[test]
    fn cameras_side_by_side_stand_as_their_mean_up() {
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
