use glam::{DQuat, DVec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

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
