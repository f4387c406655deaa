//! Keypoints of ALIKED in images of a plane that differ by a homography.

use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::super::AlikedOptions;
use super::lightglue::aliked;
use crate::sfm::FeatureExtractor;

/// Neither side is a multiple of 32, and shrunk to 200 pixels, one is rounded.
const SIZE: [usize; 2] = [333, 251];
const SIGMA_PX: f64 = 2.0;

/// Returns the homography from pixels of the first image to those of the second one.
fn homography() -> DMat3 {
    DMat3::from_cols(
        DVec3::new(0.93, 0.04, 1.2e-4),
        DVec3::new(-0.05, 0.9, -0.9e-4),
        DVec3::new(12.3, 9.7, 1.0),
    )
}

fn mapped(homography: &DMat3, at: DVec2) -> DVec2 {
    let at = *homography * at.extend(1.0);
    at.truncate() / at.z
}

/// Returns positions in the first image, with any fractions of a pixel.
fn spots() -> Vec<DVec2> {
    let mut random = Pcg64Mcg::seed_from_u64(45);
    let mut spot = |column: u32, row: u32| {
        let by = DVec2::new(random.random_range(0.0..4.0), random.random_range(0.0..4.0));
        9.0 + 18.5 * DVec2::new(column.into(), row.into()) + by
    };
    let rows = (0..13).flat_map(|row| (0..17).map(move |column| (column, row)));
    rows.map(|(column, row)| spot(column, row)).collect()
}

/// Returns the grey values of Gaussian spots in an image, of which `first_from_here` maps pixels.
fn image(first_from_here: &DMat3) -> Vec<f32> {
    let spots = spots();
    let value = |number: usize| {
        let here = DVec2::new((number % SIZE[0]) as f64, (number / SIZE[0]) as f64) + 0.5;
        let at = mapped(first_from_here, here);
        let near = spots.iter().map(|spot| spot.distance_squared(at));
        let sum: f64 = near.map(|d| (-0.5 * d / SIGMA_PX.powi(2)).exp()).sum();
        (0.2 + 0.3 * sum) as f32
    };
    (0..SIZE[0] * SIZE[1]).map(value).collect()
}

/// Name of a half of the image, and whether a position in shares of the sides is in it.
type Half = (&'static str, fn(DVec2) -> bool);

/// Checks that keypoints are at the spots of an image, when shrunk to a longer side of `max_side`.
fn check_positions(here_from_first: &DMat3, max_side: usize) {
    let options = AlikedOptions {
        max_side,
        ..AlikedOptions::default()
    };
    let grey = image(&here_from_first.inverse());
    let found = aliked(options).extract(&grey, SIZE[0], SIZE[1], None);
    let found = found.unwrap().keypoints;
    let size = DVec2::new(SIZE[0] as f64, SIZE[1] as f64);
    // Keypoints of the small network are whole pixels of the image that it sees.
    let pixel = (size.x / max_side as f64).max(1.0);
    let is_inside = |at: &DVec2| at.min_element() > 8.0 && (size - at).min_element() > 8.0;
    let expected: Vec<DVec2> = spots()
        .iter()
        .map(|&at| mapped(here_from_first, at))
        .filter(is_inside)
        .collect();
    assert!(expected.len() > 150, "{}", expected.len());
    let errors = expected.iter().map(|&at| {
        let nearest = found
            .iter()
            .min_by(|a, b| a.distance(at).total_cmp(&b.distance(at)));
        (*nearest.unwrap() - at) / pixel
    });
    let errors: Vec<DVec2> = errors.collect();
    let largest = errors.iter().map(|error| error.abs().max_element());
    let largest = largest.fold(0.0, f64::max);
    assert!(largest < 0.65, "{max_side}: {largest}");
    // Rounding to pixels cancels out over each half of the image, unlike an offset or a wrong scale.
    // The standard error of a mean of rounding is 0.03.
    let halves: [Half; 4] = [
        ("left", |share| share.x < 0.5),
        ("right", |share| share.x >= 0.5),
        ("top", |share| share.y < 0.5),
        ("bottom", |share| share.y >= 0.5),
    ];
    for (half, is_here) in halves {
        let both = expected.iter().zip(&errors);
        let here = both.filter(|(at, _)| is_here(**at / size));
        let here: Vec<DVec2> = here.map(|(_, &error)| error).collect();
        let mean = here.iter().sum::<DVec2>() / here.len() as f64;
        println!("{max_side}, {half}: {} spots, mean {mean}", here.len());
        assert!(mean.abs().max_element() < 0.1, "{max_side}, {half}: {mean}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn aliked_keypoints_follow_a_homography() {
    for max_side in [1600, 200] {
        check_positions(&DMat3::IDENTITY, max_side);
        check_positions(&homography(), max_side);
    }
}
