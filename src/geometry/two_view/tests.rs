use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::epipolar::{essential_from_pose, fundamental_in_pixels};
use crate::{Camera, Distortion, Pose};

const FIRST: Camera = Camera {
    width: 1600,
    height: 1200,
    focal_px: DVec2::splat(1400.0),
    principal_px: DVec2::new(800.0, 600.0),
    distortion: Distortion::None,
};

fn random(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

fn in_image(random: &mut Pcg64Mcg) -> DVec2 {
    DVec2::new(
        random.random_range(0.0..1600.0),
        random.random_range(0.0..1200.0),
    )
}

/// Returns roughly normal noise of a given standard deviation.
fn noise(random: &mut Pcg64Mcg, px: f64) -> DVec2 {
    let one =
        |random: &mut Pcg64Mcg| (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>() * px;
    DVec2::new(one(random), one(random))
}

fn sideways() -> Pose {
    let rotation = DQuat::from_euler(glam::EulerRot::XYZ, 0.05, -0.25, 0.1);
    Pose {
        rotation,
        translation: DVec3::new(1.2, 0.1, 0.3),
    }
}

struct Made {
    matches: Vec<[DVec2; 2]>,
    good: Vec<bool>,
}

/// Returns matches of points, mixed with `bad` random ones.
///
/// `depth` is called for each ray of the first camera.
fn made(
    seed: u64,
    good: usize,
    bad: usize,
    cameras: [&Camera; 2],
    pose: &Pose,
    depth: impl Fn(f64, DVec2) -> f64,
) -> Made {
    let random = &mut random(seed);
    let mut made = Made {
        matches: Vec::new(),
        good: Vec::new(),
    };
    let mut left = [good, bad];
    while left != [0, 0] {
        let at = in_image(random);
        if random.random_range(0..left[0] + left[1]) < left[0] {
            let ray = cameras[0].unproject(at);
            let x = ray.extend(1.0) * depth(random.random(), ray);
            let Some(seen) = cameras[1]
                .project(pose.transform(x))
                .filter(|&at| cameras[1].contains(at))
            else {
                continue;
            };
            made.matches
                .push([at + noise(random, 0.5), seen + noise(random, 0.5)]);
            made.good.push(true);
            left[0] -= 1;
        } else {
            made.matches.push([at, in_image(random)]);
            made.good.push(false);
            left[1] -= 1;
        }
    }
    made
}

fn deep(share: f64, _: DVec2) -> f64 {
    4.0 + 4.0 * share
}

fn plane(_: f64, ray: DVec2) -> f64 {
    5.0 / DVec3::new(0.3, 0.2, 1.0).dot(ray.extend(1.0))
}

/// Returns the errors of the rotation and of the translation's direction, in degrees.
fn errors(found: &Pose, truth: &Pose) -> [f64; 2] {
    [
        found.rotation.angle_between(truth.rotation),
        found.translation.angle_between(truth.translation),
    ]
    .map(f64::to_degrees)
}

fn epipolar_error(f: &DMat3, [a, b]: [DVec2; 2]) -> f64 {
    let (line, back) = (*f * a.extend(1.0), f.transpose() * b.extend(1.0));
    let spread = line.truncate().length_squared() + back.truncate().length_squared();
    b.extend(1.0).dot(line).abs() / spread.sqrt()
}

fn assert_inliers(found: &TwoView, made: &Made) {
    let right = found
        .inliers
        .iter()
        .filter(|&&i| made.good[i as usize])
        .count();
    let good = made.good.iter().filter(|&&good| good).count();
    assert!(found.inliers.is_sorted());
    assert!(right as f64 >= 0.98 * good as f64, "{right} of {good}");
    assert!(
        found.inliers.len() - right <= made.good.len() / 20,
        "{} wrong",
        found.inliers.len() - right
    );
}

#[test]
fn motion_is_estimated_with_half_outliers() {
    for seed in 0..20 {
        let made = made(seed, 200, 200, [&FIRST; 2], &sideways(), deep);
        let found = estimate_two_view([&FIRST; 2], true, &made.matches, &TwoViewOptions::default())
            .unwrap();
        assert_eq!(found.kind, TwoViewKind::Calibrated);
        assert_inliers(&found, &made);
        let [turn, direction] = errors(&found.second_from_first.unwrap(), &sideways());
        assert!(turn < 0.15 && direction < 1.0, "{turn} {direction}");
        assert!((0.1..0.3).contains(&found.parallax), "{}", found.parallax);
        let f = found.fundamental.unwrap();
        assert!(
            found
                .inliers
                .iter()
                .all(|&i| epipolar_error(&f, made.matches[i as usize]) < 4.0 + 1e-6)
        );
    }
}

#[test]
fn motion_is_estimated_with_nine_of_ten_outliers_if_neighbours_agree() {
    // Points on a surface: neighbours in one image are neighbours in the other.
    let surface = |_: f64, ray: DVec2| 5.0 + (3.0 * ray.x).sin() + (4.0 * ray.y).cos();
    let made = made(1, 80, 720, [&FIRST; 2], &sideways(), surface);
    let found =
        estimate_two_view([&FIRST; 2], true, &made.matches, &TwoViewOptions::default()).unwrap();
    assert_inliers(&found, &made);
    let [turn, direction] = errors(&found.second_from_first.unwrap(), &sideways());
    assert!(turn < 2.0 && direction < 8.0, "{turn} {direction}");
}

#[test]
fn rotation_is_recognised_for_any_focal_length() {
    let turn = Pose {
        rotation: DQuat::from_rotation_y(0.12),
        translation: DVec3::ZERO,
    };
    for factor in [0.45, 0.6, 0.8, 1.3, 1.7, 2.2] {
        let made = made(7, 200, 40, [&FIRST; 2], &turn, deep);
        let guess = Camera {
            focal_px: FIRST.focal_px * factor,
            ..FIRST
        };
        let found = estimate_two_view(
            [&guess; 2],
            false,
            &made.matches,
            &TwoViewOptions::default(),
        )
        .unwrap();
        assert_eq!(found.kind, TwoViewKind::Panoramic, "factor {factor}");
        assert!(found.second_from_first.is_none());
    }
}

#[test]
fn plane_is_distinguished_from_depth() {
    for calibrated in [true, false] {
        let made = made(5, 150, 100, [&FIRST; 2], &sideways(), plane);
        let found = estimate_two_view(
            [&FIRST; 2],
            calibrated,
            &made.matches,
            &TwoViewOptions::default(),
        )
        .unwrap();
        assert_eq!(found.kind, TwoViewKind::Planar);
        assert_inliers(&found, &made);
        // A plane allows two motions; only points behind a camera distinguish them.
        let pose = found.second_from_first.unwrap();
        let f = fundamental_in_pixels(essential_from_pose(&pose), [&FIRST; 2]);
        let off = found
            .inliers
            .iter()
            .filter(|&&i| epipolar_error(&f, made.matches[i as usize]) > 6.0)
            .count();
        assert!(off <= 5 && found.parallax > 0.0, "{off}");
    }
}

#[test]
fn rotating_camera_is_panoramic() {
    let turn = Pose {
        translation: DVec3::ZERO,
        ..sideways()
    };
    for calibrated in [true, false] {
        let made = made(6, 150, 100, [&FIRST; 2], &turn, deep);
        let found = estimate_two_view(
            [&FIRST; 2],
            calibrated,
            &made.matches,
            &TwoViewOptions::default(),
        )
        .unwrap();
        assert_eq!(found.kind, TwoViewKind::Panoramic, "{calibrated}");
        assert_eq!(
            (found.second_from_first, found.fundamental, found.parallax),
            (None, None, 0.0)
        );
        assert_inliers(&found, &made);
    }
}

#[test]
fn wrong_focal_length_is_recognised_and_keeps_the_inliers() {
    let wrong = Camera {
        focal_px: DVec2::splat(900.0),
        ..FIRST
    };
    let forward = Pose {
        translation: DVec3::new(1.2, 0.3, -1.5),
        ..sideways()
    };
    let made = made(7, 300, 100, [&FIRST; 2], &forward, deep);
    for calibrated in [true, false] {
        let found = estimate_two_view(
            [&wrong; 2],
            calibrated,
            &made.matches,
            &TwoViewOptions::default(),
        )
        .unwrap();
        assert_eq!(found.kind, TwoViewKind::Uncalibrated, "{calibrated}");
        assert_inliers(&found, &made);
        assert!(found.second_from_first.is_some());
    }
}

#[test]
fn lens_distortion_is_taken_into_account() {
    let bent = Camera {
        distortion: Distortion::Radial { k: [-0.15, 0.02] },
        ..FIRST
    };
    let fisheye = Camera {
        distortion: Distortion::OpenCvFisheye {
            k: [0.05, -0.01, 0.004, -0.001],
        },
        focal_px: DVec2::splat(600.0),
        ..FIRST
    };
    for cameras in [[&bent, &bent], [&bent, &fisheye], [&fisheye, &fisheye]] {
        let made = made(8, 300, 300, cameras, &sideways(), deep);
        let found =
            estimate_two_view(cameras, true, &made.matches, &TwoViewOptions::default()).unwrap();
        assert_eq!(found.kind, TwoViewKind::Calibrated);
        assert_inliers(&found, &made);
        let [turn, direction] = errors(&found.second_from_first.unwrap(), &sideways());
        assert!(turn < 0.2 && direction < 1.0, "{turn} {direction}");
    }
}

#[test]
fn random_matches_give_none() {
    for (seed, count) in [(0, 15), (1, 40), (2, 100), (3, 300), (4, 1000), (5, 3000)] {
        for calibrated in [true, false] {
            let made = made(seed, 0, count, [&FIRST; 2], &sideways(), deep);
            let found = estimate_two_view(
                [&FIRST; 2],
                calibrated,
                &made.matches,
                &TwoViewOptions::default(),
            );
            assert_eq!(found, None, "{count}");
        }
    }
}

#[test]
fn degenerate_matches_give_none() {
    let options = TwoViewOptions::default();
    let same = vec![[DVec2::new(300.0, 200.0), DVec2::new(310.0, 220.0)]; 60];
    let line: Vec<[DVec2; 2]> = (0..60)
        .map(|i| {
            [
                DVec2::splat(10.0 * f64::from(i)),
                DVec2::new(20.0 * f64::from(i), 300.0),
            ]
        })
        .collect();
    let nan = vec![[DVec2::NAN, DVec2::new(1.0, f64::INFINITY)]; 60];
    let three = vec![[DVec2::new(1.0, 2.0), DVec2::new(3.0, 4.0)]; 3];
    for matches in [same, line, nan, three, Vec::new()] {
        for calibrated in [true, false] {
            assert_eq!(
                estimate_two_view([&FIRST; 2], calibrated, &matches, &options),
                None
            );
            let eager = TwoViewOptions {
                min_inliers: 0,
                ..options
            };
            assert_eq!(
                estimate_two_view([&FIRST; 2], calibrated, &matches, &eager),
                None
            );
        }
    }
}

#[test]
fn result_is_reproducible_and_nan_matches_are_skipped() {
    let made = made(9, 200, 200, [&FIRST; 2], &sideways(), deep);
    let options = TwoViewOptions {
        seed: 4,
        ..TwoViewOptions::default()
    };
    let once = estimate_two_view([&FIRST; 2], true, &made.matches, &options).unwrap();
    assert_eq!(
        once,
        estimate_two_view([&FIRST; 2], true, &made.matches, &options).unwrap()
    );
    let mut with_nan = vec![[DVec2::NAN; 2]; 2];
    with_nan.extend(&made.matches);
    let shifted = estimate_two_view([&FIRST; 2], true, &with_nan, &options).unwrap();
    assert!(shifted.inliers.len().abs_diff(once.inliers.len()) <= 3 && shifted.inliers[0] >= 2);
}

#[test]
fn refinement_improves_the_estimate() {
    let made = made(10, 300, 0, [&FIRST; 2], &sideways(), deep);
    let matched = matched::Matched::new([&FIRST; 2], &made.matches, 4.0);
    let off = Pose {
        rotation: sideways().rotation * DQuat::from_rotation_x(0.002),
        ..sideways()
    };
    let start = essential_from_pose(&off);
    let cost = |m: &DMat3| matched.cost(f64::INFINITY, |b| matched::epipolar_errors(m, b));
    let essential = refine::refine_essential(&matched, start).unwrap();
    let fundamental = refine::refine_fundamental(&matched, start, 1.0).unwrap();
    // Noise of 0.5 px leaves 0.25 px² per match.
    assert!(cost(&start) > 2.0 * cost(&essential) && cost(&essential) < 0.3 * 300.0);
    assert!(cost(&fundamental) < 1.01 * cost(&essential) && fundamental.determinant().abs() < 1e-9);
}
