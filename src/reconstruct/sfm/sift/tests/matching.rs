use super::super::{SiftFeatures, SiftOptions, extract_sift};
use super::{Blob, painted, strewn};
use crate::sfm::{FeatureExtractor, Sift};
use glam::{DVec2, Vec2};
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Returns the same spots rotated by `angle` and magnified about the image's centre.
fn turned(blobs: &[Blob], centre: Vec2, angle: f32, scale: f32) -> Vec<Blob> {
    let moved = |blob: &Blob| Blob {
        at_px: moved(blob.at_px, centre, angle, scale),
        sigma_px: blob.sigma_px * scale,
        contrast: blob.contrast,
    };
    blobs.iter().map(moved).collect()
}

fn moved(at_px: Vec2, centre: Vec2, angle: f32, scale: f32) -> Vec2 {
    centre + scale * Vec2::from_angle(angle).rotate(at_px - centre)
}

/// Returns the index of the feature with the nearest descriptor, if it is clearly nearer than the second.
fn best(of: &[u8; 128], among: &SiftFeatures) -> Option<usize> {
    let apart = |other: &[u8; 128]| {
        of.iter()
            .zip(other)
            .map(|(&a, &b)| (f32::from(a) - f32::from(b)).powi(2))
            .sum::<f32>()
    };
    let mut order: Vec<(f32, usize)> = among
        .descriptors
        .iter()
        .enumerate()
        .map(|(k, d)| (apart(d), k))
        .collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    (order[0].0 < 0.64 * order[1].0).then_some(order[0].1)
}

#[test]
fn features_match_in_a_rotated_and_magnified_image() {
    let (size, centre) = (400, Vec2::splat(200.0));
    let blobs = strewn(900, size, size);
    let options = SiftOptions::default();
    let first = extract_sift(&painted(&blobs, size, size), size, size, None, &options);
    for (angle, scale) in [(0.5_f32, 1.0), (2.1, 1.37), (-1.2, 0.8)] {
        let again = painted(&turned(&blobs, centre, angle, scale), size, size);
        let second = extract_sift(&again, size, size, None, &options);
        let (mut matches, mut right, mut upright) = (0, 0, 0);
        for (keypoint, descriptor) in first.keypoints.iter().zip(&first.descriptors) {
            if keypoint.at_px.distance(centre) > 120.0 || keypoint.scale_px > 8.0 {
                continue;
            }
            let Some(k) = best(descriptor, &second) else {
                continue;
            };
            let other = second.keypoints[k];
            let off = other
                .at_px
                .distance(moved(keypoint.at_px, centre, angle, scale));
            let turn = Vec2::from_angle(other.angle - keypoint.angle)
                .angle_to(Vec2::from_angle(angle))
                .abs();
            matches += 1;
            right += usize::from(
                off < 1.0 && (0.8..1.25).contains(&(other.scale_px / keypoint.scale_px / scale)),
            );
            upright += usize::from(turn < 0.1);
        }
        assert!(matches > 150, "{angle} {scale}: {matches} matches");
        assert!(
            right as f32 > 0.97 * matches as f32,
            "{angle} {scale}: {right} of {matches}"
        );
        assert!(
            upright as f32 > 0.95 * matches as f32,
            "{angle} {scale}: {upright} of {matches} turned rightly"
        );
    }
}

#[test]
fn descriptors_are_invariant_to_brightness_and_contrast() {
    let grey = painted(&strewn(200, 200, 200), 200, 200);
    let dimmed: Vec<f32> = grey.iter().map(|value| 0.1 + 0.5 * value).collect();
    let options = |peak_threshold| SiftOptions {
        peak_threshold,
        ..SiftOptions::default()
    };
    let (first, second) = (
        extract_sift(&grey, 200, 200, None, &options(0.02)),
        extract_sift(&dimmed, 200, 200, None, &options(0.01)),
    );
    assert_eq!(first.keypoints.len(), second.keypoints.len());
    let same = first.descriptors.iter().filter(|&descriptor| {
        let near = |other: &[u8; 128]| {
            descriptor
                .iter()
                .zip(other)
                .all(|(a, b)| a.abs_diff(*b) <= 4)
        };
        second.descriptors.iter().any(near)
    });
    assert!(same.count() * 100 >= 98 * first.descriptors.len());
}

#[test]
fn descriptors_are_square_roots_of_shares() {
    let features = extract_sift(
        &painted(&strewn(200, 200, 200), 200, 200),
        200,
        200,
        None,
        &SiftOptions::default(),
    );
    assert!(!features.descriptors.is_empty());
    for descriptor in features.descriptors {
        let length = descriptor
            .iter()
            .map(|&value| f32::from(value).powi(2))
            .sum::<f32>()
            .sqrt();
        assert!((length - 512.0).abs() < 8.0, "{length}");
    }
}

#[test]
fn orientations_of_features_turn_with_the_image() {
    let side = 240;
    let grey = painted(&strewn(200, side, side), side, side);
    // A quarter turn from the x axis towards the y axis.
    let turned: Vec<f32> = (0..side * side)
        .map(|at| grey[(side - 1 - at % side) * side + at / side])
        .collect();
    let [first, second] =
        [&grey, &turned].map(|grey| Sift::default().extract(grey, side, side, None).unwrap());
    assert_eq!(first.orientations.len(), first.keypoints.len());
    let turn = |from: f32, to: f32| (to - from - FRAC_PI_2 + PI).rem_euclid(TAU) - PI;
    let (mut again, mut turned) = (0, 0);
    for (at, &angle) in first.keypoints.iter().zip(&first.orientations) {
        let expected = DVec2::new(side as f64 - at.y, at.x);
        let there = second.keypoints.iter().zip(&second.orientations);
        let near: Vec<f32> = there
            .filter(|(at, _)| at.distance(expected) < 0.3)
            .map(|(_, &other)| other)
            .collect();
        again += usize::from(!near.is_empty());
        turned += usize::from(near.iter().any(|&other| turn(angle, other).abs() < 0.1));
    }
    assert!(
        again > 100 && 10 * turned > 9 * again,
        "{turned} of {again}"
    );
}
