use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::Pose;

const SEEDS: u64 = 1000;

fn between(random: &mut Pcg64Mcg, low: f64, high: f64) -> f64 {
    random.random_range(low..high)
}

fn vector(random: &mut Pcg64Mcg, reach: f64) -> DVec3 {
    DVec3::from_array([0; 3].map(|_| between(random, -reach, reach)))
}

/// Returns a second camera that sees much of the first camera's view.
fn pose(random: &mut Pcg64Mcg) -> Pose {
    let axis = vector(random, 1.0).normalize();
    let angle = between(random, 0.0, 0.6);
    Pose {
        rotation: DQuat::from_axis_angle(axis, angle),
        translation: vector(random, 1.0),
    }
}

fn points<const N: usize>(random: &mut Pcg64Mcg) -> [DVec3; N] {
    [0; N].map(|_| vector(random, 1.5) + 5.0 * DVec3::Z)
}

fn ray(x: DVec3) -> DVec2 {
    x.truncate() / x.z
}

fn pairs<const N: usize>(points: &[DVec3; N], pose: &Pose) -> [[DVec2; 2]; N] {
    points.map(|x| [ray(x), ray(pose.transform(x))])
}

fn cross_matrix(t: DVec3) -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.0, t.z, -t.y),
        DVec3::new(-t.z, 0.0, t.x),
        DVec3::new(t.y, -t.x, 0.0),
    )
}

fn norm(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
}

/// Returns the distance of two matrices up to scale and sign.
fn distance(a: DMat3, b: DMat3) -> f64 {
    let (a, b) = (a * (1.0 / norm(a)), b * (1.0 / norm(b)));
    norm(a - b).min(norm(a + b))
}

fn essential(pose: &Pose) -> DMat3 {
    cross_matrix(pose.translation) * DMat3::from_quat(pose.rotation)
}

fn epipolar_miss(m: DMat3, [x1, x2]: [DVec2; 2]) -> f64 {
    x2.extend(1.0).dot(m * x1.extend(1.0)).abs()
}

/// Number of seeds for which the ground truth was not among the solutions.
fn misses(mut is_found: impl FnMut(&mut Pcg64Mcg) -> bool) -> usize {
    (0..SEEDS)
        .filter(|&seed| !is_found(&mut Pcg64Mcg::seed_from_u64(seed)))
        .count()
}

#[test]
fn five_point_finds_the_ground_truth_and_only_essential_matrices() {
    let missed = misses(|random| {
        let pose = pose(random);
        let pairs = pairs(&points::<5>(random), &pose);
        let found = five_point(&pairs);
        assert!(found.len() <= 10);
        for e in &found {
            assert!((norm(*e) - 1.0).abs() < 1e-9);
            assert!(pairs.iter().all(|&pair| epipolar_miss(*e, pair) < 1e-9));
            let gram = *e * e.transpose();
            let trace = gram.x_axis.x + gram.y_axis.y + gram.z_axis.z;
            assert!(
                norm(2.0 * gram * *e - trace * *e) < 1e-6,
                "{}",
                norm(2.0 * gram * *e - trace * *e)
            );
            assert!(e.determinant().abs() < 1e-6);
        }
        found.iter().any(|e| distance(*e, essential(&pose)) < 1e-6)
    });
    assert!(missed <= 1, "missed {missed} of {SEEDS}");
}

#[test]
fn seven_point_finds_the_ground_truth_and_only_singular_matrices() {
    let missed = misses(|random| {
        let pose = pose(random);
        let pairs = pairs(&points::<7>(random), &pose);
        let found = seven_point(&pairs);
        assert!(!found.is_empty() && found.len() <= 3);
        for f in &found {
            assert!(
                pairs.iter().all(|&pair| epipolar_miss(*f, pair) < 1e-9)
                    && f.determinant().abs() < 1e-9
            );
        }
        found.iter().any(|f| distance(*f, essential(&pose)) < 1e-6)
    });
    assert!(missed <= 1, "missed {missed} of {SEEDS}");
}

#[test]
fn eight_point_finds_the_ground_truth_and_ignores_zero_weights() {
    let missed = misses(|random| {
        let pose = pose(random);
        let mut pairs = pairs(&points::<12>(random), &pose);
        let mut weights = [1.0; 12];
        pairs[3][0] += 0.1;
        weights[3] = 0.0;
        let f = eight_point(&pairs, &weights).unwrap();
        assert!(f.determinant().abs() < 1e-9);
        distance(f, essential(&pose)) < 1e-6
    });
    assert!(missed <= 1, "missed {missed} of {SEEDS}");
}

#[test]
fn homography_solvers_find_the_ground_truth() {
    let missed = misses(|random| {
        let pose = pose(random);
        let normal = (DVec3::Z + vector(random, 0.4)).normalize();
        let plane_distance = between(random, 3.0, 6.0);
        let on_plane = [0; 9].map(|_| {
            let seen = DVec3::new(between(random, -0.6, 0.6), between(random, -0.6, 0.6), 1.0);
            seen * (plane_distance / normal.dot(seen))
        });
        let outer = |a: DVec3, b: DVec3| DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        let truth =
            DMat3::from_quat(pose.rotation) + outer(pose.translation, normal / plane_distance);
        let pairs = pairs(&on_plane, &pose);
        let minimal = homography4(&[pairs[0], pairs[1], pairs[2], pairs[3]]);
        let all = homography(&pairs, &[1.0; 9]);
        [minimal, all]
            .iter()
            .all(|h| h.is_some_and(|h| distance(h, truth) < 1e-6))
    });
    assert!(missed <= 1, "missed {missed} of {SEEDS}");
}

#[test]
fn p3p_finds_the_ground_truth_and_only_poses_that_fit() {
    let missed = misses(|random| {
        let pose = pose(random);
        let points = points::<3>(random);
        let rays = points.map(|x| ray(pose.transform(x)));
        let found = p3p(&rays, &points);
        assert!(found.len() <= 4);
        for found in &found {
            assert!((found.rotation.length() - 1.0).abs() < 1e-12);
            for (&x, &seen) in points.iter().zip(&rays) {
                let at = found.transform(x);
                assert!(
                    at.z > 0.0 && (ray(at) - seen).length() < 1e-6,
                    "{found:?} {} {}",
                    ray(at),
                    seen
                );
            }
        }
        found.iter().any(|found| {
            found.rotation.angle_between(pose.rotation) < 1e-6
                && found.translation.distance(pose.translation) < 1e-6
        })
    });
    assert!(missed <= 1, "missed {missed} of {SEEDS}");
}

#[test]
fn degenerate_input_yields_no_model_and_no_panic() {
    let same = [[DVec2::new(0.1, 0.2), DVec2::new(-0.1, 0.3)]; 8];
    let line: [[DVec2; 2]; 8] =
        std::array::from_fn(|i| [DVec2::splat(0.1 * i as f64), DVec2::splat(0.05 * i as f64)]);
    let nan = [[DVec2::NAN; 2]; 8];
    for pairs in [same, line, nan] {
        assert!(five_point(pairs.first_chunk().unwrap()).is_empty());
        assert!(seven_point(pairs.first_chunk().unwrap()).is_empty());
        assert_eq!(homography4(pairs.first_chunk().unwrap()), None);
    }
    for pairs in [same, nan] {
        assert_eq!(eight_point(&pairs, &[1.0; 8]), None);
        assert_eq!(homography(&pairs, &[1.0; 8]), None);
    }
    assert_eq!(eight_point(&line[..7], &[1.0; 7]), None);
    let rays = [DVec2::ZERO, DVec2::X, DVec2::Y];
    assert!(p3p(&rays, &[DVec3::Z, 2.0 * DVec3::Z, 3.0 * DVec3::Z]).is_empty());
    assert!(p3p(&rays, &[DVec3::NAN; 3]).is_empty());
    assert!(p3p(&[DVec2::NAN; 3], &[DVec3::X, DVec3::Y, DVec3::Z]).is_empty());
}
