//! ALIKED and LightGlue with small networks that have the interfaces of COLMAP's files.

use std::f32::consts::PI;
use std::path::Path;

use glam::DVec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::super::aliked::{DIM, MULTIPLE, pixel_of};
use super::super::keypoints::PreparedImage;
use super::super::lightglue::{accepted, positions, sift_inputs};
use super::super::{Aliked, AlikedOptions, LightGlue, LightGlueFeatures, LightGlueOptions};
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features, Sift};
use ostra_compute::nn::{Catalogue, Network, NnError, Runtime, Tensor};
use ostra_core::image::ImageSize;
use ostra_frames::Image;

/// Returns a network that `tests/parity/public.py` wrote, if it has the interface of the catalogue.
fn network(file: &str, name: &str) -> Network {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/public");
    let catalogue = Catalogue::bundled().unwrap();
    let expected = catalogue.entry(name).unwrap().files()[0].signature.as_ref();
    Network::load(&Runtime::find().unwrap(), &folder.join(file), expected).unwrap()
}

pub(super) fn aliked(options: AlikedOptions) -> Aliked {
    Aliked::of_network(network("aliked.onnx", "aliked"), options)
}

fn lightglue(features: LightGlueFeatures) -> LightGlue {
    let name = match features {
        LightGlueFeatures::Aliked => "aliked-lightglue",
        LightGlueFeatures::Sift => "sift-lightglue",
    };
    let network = network(&format!("{name}.onnx"), name);
    LightGlue::of_network(network, features, LightGlueOptions::default()).unwrap()
}

fn sensitive() -> AlikedOptions {
    AlikedOptions {
        least_score: 0.05,
        ..AlikedOptions::default()
    }
}

/// Returns grey values with a spot of a few pixels at each of these pixels.
fn spots(size: [usize; 2], at: &[[usize; 2]]) -> Vec<f32> {
    let [width, height] = size;
    let mut grey = vec![0.2; width * height];
    for &[x, y] in at {
        for (near_x, near_y) in [(0, 0), (1, 0), (0, 1), (2, 1), (1, 2)] {
            grey[(y + near_y - 1) * width + x + near_x - 1] += 0.1;
        }
        grey[y * width + x] = 0.9;
    }
    grey
}

fn colored(grey: &[f32], [width, height]: [usize; 2], channel: usize) -> Image {
    let pixel = |&value: &f32| {
        let mut pixel = [50; 3];
        pixel[channel] = (255.0 * value) as u8;
        pixel
    };
    Image {
        width: width as u32,
        height: height as u32,
        pixels: grey.iter().map(pixel).collect(),
    }
}

fn features(keypoints: usize, descriptors: Descriptors) -> Features {
    let at = |number| DVec2::new(10.5 + 3.0 * number as f64, 20.25);
    Features {
        width: 640,
        height: 480,
        keypoints: (0..keypoints).map(at).collect(),
        scales_px: vec![2.5; keypoints],
        orientations: vec![0.25; keypoints],
        scores: Vec::new(),
        descriptors,
    }
}

#[test]
fn places_count_from_the_centres_of_the_outer_pixels() {
    let padded = [96, 64];
    assert_eq!(pixel_of(DVec2::new(-1.0, -1.0), padded), DVec2::splat(0.5));
    assert_eq!(pixel_of(DVec2::ONE, padded), DVec2::new(95.5, 63.5));
    assert_eq!(pixel_of(DVec2::ZERO, padded), DVec2::new(48.0, 32.0));
}

#[test]
fn last_column_and_row_are_repeated_up_to_a_multiple() {
    let (width, height) = (33, 31);
    let grey: Vec<f32> = (0..width * height).map(|at| at as f32).collect();
    let shown = PreparedImage::new(&grey, ImageSize { width, height }, 1600, MULTIPLE);
    assert_eq!((shown.width, shown.height), (64, 32));
    for y in 0..32 {
        for x in 0..64 {
            let inside = grey[y.min(height - 1) * width + x.min(width - 1)];
            assert_eq!(shown.grey[y * 64 + x], inside, "column {x}, row {y}");
        }
    }
}

#[test]
fn positions_count_from_the_centre_of_the_first_pixel() {
    let descriptors = Descriptors::Floats {
        dim: DIM,
        values: vec![0.0; 2 * DIM],
    };
    let found = features(2, descriptors);
    assert_eq!(positions(&found, 2), [10.0, 19.75, 13.0, 19.75]);
    assert_eq!(positions(&found, 1), [10.0, 19.75]);
}

#[test]
fn sift_is_given_with_the_directions_and_angles_of_colmap() {
    let mut bytes = vec![0; 3 * DIM];
    // Second feature: directions 0, 1 and 6 of the first cell, and 3 of the last one.
    for (at, value) in [(0, 1), (1, 2), (6, 4), (DIM - 5, 10)] {
        bytes[DIM + at] = value;
    }
    let mut found = features(
        3,
        Descriptors::Bytes {
            dim: DIM,
            values: bytes,
        },
    );
    found.orientations = vec![0.5 * PI, 1.5 * PI, PI];
    let (descriptors, [scales, orientations]) = sift_inputs(&found, 2).unwrap();
    let second = &descriptors[DIM..];
    assert_eq!(descriptors.len(), 2 * DIM);
    for (at, value) in [(0, 1.0), (7, 2.0), (2, 4.0), (DIM - 3, 10.0)] {
        assert!((second[at] - value / 11.0).abs() < 1e-6, "{second:?}");
    }
    assert_eq!(second.iter().filter(|&&value| value > 0.0).count(), 4);
    assert_eq!(scales, [2.5; 2]);
    for (angle, expected) in orientations.iter().zip([0.5 * PI, -0.5 * PI]) {
        assert!((angle - expected).abs() < 1e-6, "{orientations:?}");
    }
    found.orientations.clear();
    let error = sift_inputs(&found, 2).unwrap_err();
    assert!(error.to_string().contains("scales and orientations"));
}

#[test]
fn matches_need_a_partner_and_a_score() {
    let partners = [2, -1, 0, 9, 1, 1, 3];
    let scores = [0.9, 0.9, 0.05, 0.9, 0.3, 0.8, 0.1];
    let whole = Tensor::integers(&[7], partners.to_vec()).unwrap();
    let expected = [(0, 2), (5, 1), (6, 3)];
    assert_eq!(accepted(&whole, &scores, 0.1, 4), expected);
    let floats = partners.map(|partner| partner as f32).to_vec();
    let floats = Tensor::floats(&[7], floats).unwrap();
    assert_eq!(accepted(&floats, &scores, 0.1, 4), expected);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn aliked_finds_spots_at_the_centres_of_their_pixels() {
    let at = [[10, 12], [40, 30], [66, 41], [25, 25]];
    // Neither side is a multiple of 32, and the last spot is next to the repeated margin.
    let size = [70, 45];
    let grey = spots(size, &at);
    let found = aliked(AlikedOptions::default())
        .extract(&grey, size[0], size[1], None)
        .unwrap();
    assert_eq!((found.width, found.height), (70, 45));
    for [x, y] in at {
        let expected = DVec2::new(x as f64, y as f64) + 0.5;
        let nearest = found.keypoints.iter().map(|at| at.distance(expected));
        let nearest = nearest.fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-4, "{expected}: {:?}", found.keypoints);
    }
    let is_inside = |at: &DVec2| at.x < 70.0 && at.y < 45.0;
    assert!(found.keypoints.iter().all(is_inside), "none in the margin");
    assert!(found.scores.is_sorted_by(|a, b| a >= b), "strongest first");
    assert_eq!(found.descriptors.len(), found.keypoints.len());
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn aliked_sees_colours_and_respects_masks_and_limits() {
    let size = [96, 64];
    let grey = spots(size, &[[20, 20], [40, 30], [80, 40]]);
    let network = aliked(sensitive());
    let strongest = |channel| {
        let image = colored(&grey, size, channel);
        network.extract_from_image(&image, None).unwrap().scores[0]
    };
    let [red, green, blue] = [0, 1, 2].map(strongest);
    // The small network weights them by 0.3, 0.5 and 0.2.
    assert!(
        green > 1.5 * red && red > 1.3 * blue,
        "{red} {green} {blue}"
    );
    let right: Vec<bool> = (0..size[0] * size[1])
        .map(|at| at % size[0] >= 60)
        .collect();
    let found = network
        .extract(&grey, size[0], size[1], Some(&right))
        .unwrap();
    assert!(found.keypoints[0].distance(DVec2::new(80.5, 40.5)) < 1e-4);
    assert!(found.keypoints.iter().all(|at| at.x >= 60.0));
    let limited = aliked(AlikedOptions {
        most: 2,
        ..sensitive()
    });
    let found = limited.extract(&grey, size[0], size[1], None).unwrap();
    assert_eq!(found.keypoints.len(), 2);
    let none = limited.extract(&[0.5; 33 * 20], 33, 20, None).unwrap();
    assert!(none.keypoints.is_empty() && none.descriptors.is_empty());
    let glue = lightglue(LightGlueFeatures::Aliked);
    assert_eq!(glue.matches(&none, &found), Ok(Vec::new()));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn shrunk_images_have_keypoints_in_original_pixels() {
    let (width, height) = (320, 240);
    let centre = DVec2::new(201.0, 99.0);
    let value = |at: usize| {
        let px = DVec2::new((at % width) as f64, (at / width) as f64) + 0.5;
        (0.2 + 0.1 * (-0.5 * px.distance_squared(centre) / 9.0).exp()) as f32
    };
    let grey: Vec<f32> = (0..width * height).map(value).collect();
    let found = aliked(AlikedOptions {
        max_side: 160,
        ..sensitive()
    })
    .extract(&grey, width, height, None)
    .unwrap();
    // Keypoints of the small network are pixels, of which one covers two here.
    assert!(
        found.keypoints[0].distance(centre) <= 2f64.sqrt(),
        "{}",
        found.keypoints[0]
    );
}

/// Returns random squares, which are rich in corners.
fn squares(width: usize, height: usize) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(45);
    let mut grey = vec![0.5; width * height];
    for _ in 0..700 {
        let (left, top) = (
            random.random_range(0..width - 12),
            random.random_range(0..height - 12),
        );
        let (side, value) = (random.random_range(4..12), random.random_range(0.0..1.0));
        for y in top..top + side {
            grey[y * width + left..][..side].fill(value);
        }
    }
    grey
}

fn part(grey: &[f32], width: usize, [x, y]: [usize; 2], size: [usize; 2]) -> Vec<f32> {
    let rows = grey.chunks_exact(width).skip(y).take(size[1]);
    rows.flat_map(|row| &row[x..x + size[0]]).copied().collect()
}

/// Returns the numbers of matches of an image with its shifted copy, and of the correct ones.
fn shifted_matches(extractor: &dyn FeatureExtractor, matcher: &dyn FeatureMatcher) -> [usize; 2] {
    let (shift, size) = ([17, 9], [300, 220]);
    let whole = squares(size[0] + shift[0], size[1] + shift[1]);
    let [first, second] = [shift, [0, 0]].map(|from| {
        let grey = part(&whole, size[0] + shift[0], from, size);
        extractor.extract(&grey, size[0], size[1], None).unwrap()
    });
    let matches = matcher.matches(&first, &second).unwrap();
    assert!(matches.is_sorted_by(|a, b| a.0 < b.0));
    let by = DVec2::new(shift[0] as f64, shift[1] as f64);
    let is_correct = |&&(a, b): &&(u32, u32)| {
        let moved = first.keypoints[a as usize] + by;
        moved.distance(second.keypoints[b as usize]) < 0.5
    };
    [matches.len(), matches.iter().filter(is_correct).count()]
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn shifted_image_is_matched_with_the_true_shift() {
    let glue = lightglue(LightGlueFeatures::Aliked);
    let [found, correct] = shifted_matches(&aliked(AlikedOptions::default()), &glue);
    assert!(
        correct > 200 && 10 * correct > 9 * found,
        "{correct} of {found}"
    );
    let glue = lightglue(LightGlueFeatures::Sift);
    let [found, correct] = shifted_matches(&Sift::default(), &glue);
    assert!(
        correct > 200 && 10 * correct > 9 * found,
        "{correct} of {found}"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn scales_and_orientations_reach_the_network() {
    let glue = lightglue(LightGlueFeatures::Sift);
    let values: Vec<u8> = (0..4 * DIM).map(|at| (at * at % 97) as u8).collect();
    let first = features(4, Descriptors::Bytes { dim: DIM, values });
    assert_eq!(glue.matches(&first, &first).unwrap().len(), 4);
    // The small network wants them equal.
    let mut turned = first.clone();
    turned.orientations[1] += 0.5 * PI;
    turned.scales_px[2] *= 3.0;
    let matches = glue.matches(&first, &turned).unwrap();
    assert_eq!(matches, [(0, 0), (3, 3)]);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn features_and_networks_of_another_kind_are_refused() {
    let of_64 = Descriptors::Floats {
        dim: 64,
        values: vec![0.1; 128],
    };
    let xfeat = features(2, of_64);
    for kind in [LightGlueFeatures::Aliked, LightGlueFeatures::Sift] {
        let refused = lightglue(kind).matches(&xfeat, &xfeat);
        assert!(matches!(refused, Err(FeatureError::Kinds(_))));
    }
    let other = network("aliked.onnx", "aliked");
    let error = LightGlue::of_network(
        other,
        LightGlueFeatures::Aliked,
        LightGlueOptions::default(),
    );
    let error = error.unwrap_err();
    assert!(
        matches!(&error, NnError::Mismatch { what, .. } if what.contains("matches0")),
        "{error}"
    );
}
