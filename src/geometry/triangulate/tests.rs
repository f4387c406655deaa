use glam::{DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::{Camera, Distortion, Pose};

const CAMERA: Camera = Camera {
    width: 1600,
    height: 1200,
    focal_px: DVec2::new(1400.0, 1380.0),
    principal_px: DVec2::new(810.0, 590.0),
    distortion: Distortion::Radial { k: [-0.1, 0.01] },
};

/// Cameras on a quarter circle of radius 5 about the origin, looking inward.
fn ring(count: usize) -> Vec<Pose> {
    let pose = |i: usize| {
        let angle = 1.5 * i as f64 / count as f64;
        Pose {
            rotation: DQuat::from_rotation_y(angle),
            translation: DVec3::new(0.0, 0.0, 5.0),
        }
    };
    (0..count).map(pose).collect()
}

fn seen<'a>(
    poses: &'a [Pose],
    x: DVec3,
    random: &mut Pcg64Mcg,
    noise_px: f64,
) -> Vec<RayObservation<'a>> {
    let one = |pose: &'a Pose| {
        let mut off = || random.random_range(-1.0..1.0) * noise_px;
        let at_px = CAMERA.project(pose.transform(x)).unwrap() + DVec2::new(off(), off());
        RayObservation {
            camera: &CAMERA,
            camera_from_world: pose,
            at_px,
            at_plane: CAMERA.unproject(at_px),
        }
    };
    poses.iter().map(one).collect()
}

fn moved(view: &mut RayObservation, by_px: DVec2) {
    view.at_px += by_px;
    view.at_plane = view.camera.unproject(view.at_px);
}

fn somewhere(random: &mut Pcg64Mcg) -> DVec3 {
    DVec3::from_array([0; 3].map(|_| random.random_range(-1.0..1.0)))
}

#[test]
fn points_are_exact_without_noise_and_close_with_noise() {
    let poses = ring(6);
    for seed in 0..200 {
        let random = &mut Pcg64Mcg::seed_from_u64(seed);
        let x = somewhere(random);
        for count in 2..=6 {
            let exact = triangulate(&seen(&poses[..count], x, random, 0.0)).unwrap();
            assert!(exact.distance(x) < 1e-9, "{}", exact.distance(x));
        }
        let near = triangulate(&seen(&poses, x, random, 0.5)).unwrap();
        assert!(near.distance(x) < 5e-3, "{}", near.distance(x));
    }
}

#[test]
fn point_has_the_least_reprojection_error() {
    // One camera much nearer than the others: the point nearest to the rays is not the best one.
    let mut poses = ring(4);
    poses[0].translation.z = 1.0;
    let random = &mut Pcg64Mcg::seed_from_u64(1);
    let views = seen(&poses, DVec3::new(0.1, 0.05, 0.1), random, 2.0);
    let cost = |x: DVec3| views.iter().map(|view| view.error_squared(x)).sum::<f64>();
    let found = triangulate(&views).unwrap();
    for step in [
        DVec3::X,
        DVec3::Y,
        DVec3::Z,
        -DVec3::X,
        -DVec3::Y,
        -DVec3::Z,
    ] {
        assert!(cost(found) <= cost(found + 1e-4 * step));
    }
}

#[test]
fn wrong_observations_are_excluded() {
    for (count, wrong) in [(3, 1), (6, 2), (6, 3), (30, 12)] {
        let poses = ring(count);
        for seed in 0..100 {
            let random = &mut Pcg64Mcg::seed_from_u64(seed);
            let x = somewhere(random);
            let mut views = seen(&poses, x, random, 0.5);
            for (at, view) in views.iter_mut().take(wrong).enumerate() {
                let far = 40.0 + 37.0 * at as f64;
                moved(view, DVec2::new(0.0, if at % 2 == 0 { far } else { -far }));
            }
            let found = triangulate_robust(&views, &TriangulationOptions::default()).unwrap();
            assert_eq!(
                found.inliers,
                (wrong as u32..count as u32).collect::<Vec<_>>()
            );
            assert!(
                found.position.distance(x) < 2e-2,
                "{}",
                found.position.distance(x)
            );
        }
    }
}

#[test]
fn narrow_behind_and_degenerate_views_give_none() {
    let options = TriangulationOptions::default();
    let random = &mut Pcg64Mcg::seed_from_u64(2);
    let narrow = ring(200);
    let views = seen(&narrow[..2], DVec3::ZERO, random, 0.0);
    assert!(triangulate(&views).is_some());
    assert_eq!(triangulate_robust(&views, &options), None);
    let eager = TriangulationOptions {
        min_angle: 0.0,
        ..options
    };
    assert!(triangulate_robust(&views, &eager).is_some());

    // Rays that intersect only behind the cameras.
    let poses = ring(8);
    let mut apart = seen(&poses[..2], DVec3::ZERO, random, 0.0);
    moved(&mut apart[0], DVec2::new(-400.0, 0.0));
    moved(&mut apart[1], DVec2::new(400.0, 0.0));
    assert_eq!(triangulate(&apart), None);
    assert_eq!(triangulate_robust(&apart, &eager), None);

    let twice = [views[0], views[0]];
    let mut nan = views.clone();
    nan[0].at_plane = DVec2::NAN;
    for views in [&twice[..], &nan, &views[..1], &[]] {
        assert_eq!(triangulate(views), None);
        assert_eq!(triangulate_robust(views, &eager), None);
    }
}

#[test]
fn largest_angle_is_that_of_the_widest_pair() {
    let centres = [DVec3::X, DVec3::new(1.0, 1.0, 0.0), 3.0 * DVec3::Y];
    assert!((largest_angle(DVec3::ZERO, &centres) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    assert_eq!(largest_angle(DVec3::ZERO, &centres[..1]), 0.0);
    assert_eq!(largest_angle(DVec3::ZERO, &[]), 0.0);
}
