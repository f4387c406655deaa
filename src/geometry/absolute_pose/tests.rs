use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::{Camera, Distortion, Pose};

const PLAIN: Camera = Camera {
    width: 1600,
    height: 1200,
    focal_px: DVec2::new(1400.0, 1380.0),
    principal_px: DVec2::new(810.0, 590.0),
    distortion: Distortion::None,
};

fn truth() -> Pose {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -0.8, 1.2);
    Pose {
        rotation,
        translation: DVec3::new(0.4, -0.3, 2.0),
    }
}

struct Made {
    at_px: Vec<DVec2>,
    points: Vec<DVec3>,
    good: Vec<bool>,
}

/// Returns points at depths of 2 to 8 with 0.5 px noise.
///
/// They are mixed with `bad` ones at random positions.
fn made(seed: u64, camera: &Camera, good: usize, bad: usize) -> Made {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let mut made = Made {
        at_px: Vec::new(),
        points: Vec::new(),
        good: Vec::new(),
    };
    for i in 0..good + bad {
        let place = |random: &mut Pcg64Mcg| {
            DVec2::new(
                random.random_range(0.0..1600.0),
                random.random_range(0.0..1200.0),
            )
        };
        let at = place(random);
        let depth = random.random_range(2.0..8.0);
        made.points.push(
            truth()
                .inverse()
                .transform(camera.unproject(at).extend(1.0) * depth),
        );
        let mut noise = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>() * 0.5;
        let noise = DVec2::new(noise(), noise());
        // Outliers first: the order must not matter.
        made.at_px
            .push(if i < bad { place(random) } else { at + noise });
        made.good.push(i >= bad);
    }
    made
}

/// Returns the rotation error in degrees and the error of the centre.
fn errors(found: &Pose) -> [f64; 2] {
    [
        found.rotation.angle_between(truth().rotation).to_degrees(),
        found.centre().distance(truth().centre()),
    ]
}

fn cameras() -> [Camera; 3] {
    [
        PLAIN,
        Camera {
            distortion: Distortion::OpenCv {
                k: [-0.2, 0.05],
                p: [1e-3, -2e-3],
            },
            ..PLAIN
        },
        Camera {
            distortion: Distortion::OpenCvFisheye {
                k: [0.05, -0.01, 0.004, -0.001],
            },
            focal_px: DVec2::splat(700.0),
            ..PLAIN
        },
    ]
}

#[test]
fn pose_is_estimated_with_half_outliers_for_every_lens() {
    for camera in cameras() {
        for seed in 0..10 {
            let made = made(seed, &camera, 200, 200);
            let found = estimate_absolute_pose(
                &camera,
                &made.at_px,
                &made.points,
                &AbsolutePoseOptions::default(),
            );
            let found = found.unwrap();
            let [turn, centre] = errors(&found.camera_from_world);
            assert!(turn < 0.03 && centre < 3e-3, "{turn} {centre}");
            let right = found
                .inliers
                .iter()
                .filter(|&&i| made.good[i as usize])
                .count();
            assert!(right == 200 && found.inliers.len() <= 203 && found.inliers.is_sorted());
        }
    }
}

#[test]
fn refinement_converges_from_a_bad_start_despite_outliers() {
    for camera in cameras() {
        let made = made(3, &camera, 200, 40);
        let start = Pose {
            rotation: DQuat::from_rotation_y(0.02) * truth().rotation,
            translation: truth().translation + DVec3::splat(0.03),
        };
        let [turn, centre] = errors(&refine_absolute_pose(
            &camera,
            &start,
            &made.at_px,
            &made.points,
        ));
        assert!(turn < 0.03 && centre < 3e-3, "{turn} {centre}");
    }
    let start = truth();
    assert_eq!(
        refine_absolute_pose(&PLAIN, &start, &[DVec2::ZERO; 2], &[DVec3::Z; 2]),
        start
    );
    assert_eq!(
        refine_absolute_pose(&PLAIN, &start, &[DVec2::NAN; 9], &[DVec3::Z; 9]),
        start
    );
}

#[test]
fn unknown_focal_length_is_estimated() {
    for camera in cameras() {
        let made = made(4, &camera, 300, 100);
        let guess = Camera {
            focal_px: camera.focal_px * 1.35,
            ..camera
        };
        let factors = [0.5, 0.6, 0.72, 0.85, 1.0, 1.2, 1.45];
        let options = AbsolutePoseOptions::default();
        let (factor, found) =
            estimate_absolute_pose_and_focal(&guess, &factors, &made.at_px, &made.points, &options)
                .unwrap();
        assert!((factor * 1.35 - 1.0).abs() < 2e-3, "{}", factor * 1.35);
        let [turn, centre] = errors(&found.camera_from_world);
        assert!(
            turn < 0.05 && centre < 1e-2 && found.inliers.len() >= 300,
            "{turn} {centre}"
        );
    }
}

#[test]
fn random_and_degenerate_input_give_none() {
    let options = AbsolutePoseOptions::default();
    let eager = AbsolutePoseOptions {
        min_inliers: 0,
        max_iterations: 200,
        ..options
    };
    let noise = made(5, &PLAIN, 0, 200);
    assert_eq!(
        estimate_absolute_pose(&PLAIN, &noise.at_px, &noise.points, &options),
        None
    );
    let line: Vec<DVec3> = (0..40)
        .map(|i| DVec3::new(0.1 * f64::from(i), 0.0, 5.0))
        .collect();
    let on_line: Vec<DVec2> = line.iter().map(|&x| PLAIN.project(x).unwrap()).collect();
    let at = [DVec2::new(100.0, 100.0); 40];
    for (at_px, points) in [
        (&on_line[..], &line[..]),
        (&at, &line),
        (&at, &[DVec3::Z; 40]),
        (&[DVec2::NAN; 40], &line),
        (&at, &[DVec3::NAN; 40]),
        (&at[..3], &line[..3]),
        (&[], &[]),
    ] {
        assert_eq!(estimate_absolute_pose(&PLAIN, at_px, points, &eager), None);
        assert_eq!(
            estimate_absolute_pose_and_focal(&PLAIN, &[1.0, f64::NAN], at_px, points, &eager),
            None
        );
    }
}
