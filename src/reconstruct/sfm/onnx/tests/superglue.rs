//! SuperPoint and SuperGlue compared with the reference's results on the same weights.

use std::path::{Path, PathBuf};

use glam::DVec2;
use serde::Deserialize;

use super::super::{SuperGlue, SuperGlueOptions, SuperPoint, SuperPointOptions};
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, FeatureMatcher, Features};
use ostra_compute::nn::{Network, Runtime};
use ostra_frames::Image;

/// Largest difference, in standard deviations of the reference's tensor.
const TOLERANCE: f64 = 1e-3;

#[derive(Deserialize)]
struct Reference {
    points: String,
    glue: String,
    frames: Vec<FrameReference>,
    agreement: Place,
    /// For each keypoint of the first image its partner, or -1.
    matches: Vec<i64>,
}

#[derive(Deserialize)]
struct FrameReference {
    #[serde(rename = "picture")]
    image: String,
    /// Positions are in pixels from the centre of the first pixel.
    keypoints: Place,
    scores: Place,
    descriptors: Place,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
pub(super) struct Place {
    pub(super) start: usize,
    pub(super) shape: Vec<usize>,
}

/// A folder written by `tests/parity/superglue.py`, and its networks.
struct Folder {
    path: PathBuf,
    reference: Reference,
    values: Vec<f32>,
    points: SuperPoint,
    glue: SuperGlue,
}

impl Folder {
    fn open(path: &Path) -> Self {
        let runtime = Runtime::find().unwrap();
        let reference: Reference =
            serde_json::from_slice(&std::fs::read(path.join("reference.json")).unwrap()).unwrap();
        let bytes = std::fs::read(path.join("reference.bin")).unwrap();
        let values = bytes
            .chunks_exact(4)
            .map(|word| f32::from_le_bytes(word.try_into().unwrap()))
            .collect();
        let load = |file: &str| Network::load(&runtime, &path.join(file), None).unwrap();
        let most = reference.frames[0].scores.shape[0];
        let points = SuperPointOptions {
            most,
            ..SuperPointOptions::default()
        };
        let points = SuperPoint::of_network(load(&reference.points), points).unwrap();
        let glue = SuperGlueOptions {
            first_keypoints: most,
            ..SuperGlueOptions::default()
        };
        let glue = SuperGlue::of_network(load(&reference.glue), glue);
        Self {
            path: path.to_owned(),
            reference,
            values,
            points,
            glue,
        }
    }

    fn image(&self, at: usize) -> Image {
        let image = image::open(self.path.join(&self.reference.frames[at].image))
            .unwrap()
            .to_rgb8();
        let pixels = image.pixels().map(|pixel| pixel.0).collect();
        Image {
            width: image.width(),
            height: image.height(),
            pixels,
        }
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }

    fn found(&self, image: &Image) -> Features {
        self.points
            .extract(
                &image.luma(),
                image.width as usize,
                image.height as usize,
                None,
            )
            .unwrap()
    }

    /// Returns the share of the reference's keypoints that are found, and the largest difference of
    /// scores and descriptors.
    fn compare(&self, at: usize, found: &Features) -> (f64, f64) {
        let of = &self.reference.frames[at];
        let expected = self.tensor(&of.keypoints).chunks_exact(2);
        let Descriptors::Floats { dim, values } = &found.descriptors else {
            panic!("floats")
        };
        let place = |at: &[f32]| DVec2::new(f64::from(at[0]), f64::from(at[1])).round() + 0.5;
        let index = |at: &[f32]| found.keypoints.iter().position(|&found| found == place(at));
        let indices: Vec<Option<usize>> = expected.map(index).collect();
        let count = indices.len() as f64;
        let both: Vec<(usize, usize)> = indices
            .iter()
            .enumerate()
            .filter_map(|(at, index)| index.map(|index| (at, index)))
            .collect();
        let gathered =
            |values: &[f32], dim: usize, indices: &mut dyn Iterator<Item = usize>| -> Vec<f32> {
                indices
                    .flat_map(|index| values[index * dim..(index + 1) * dim].to_vec())
                    .collect()
            };
        let mut largest = 0.0f64;
        for (expected, values, dim) in [
            (&of.scores, &found.scores, 1),
            (&of.descriptors, values, *dim),
        ] {
            let expected = gathered(
                self.tensor(expected),
                dim,
                &mut both.iter().map(|&(at, _)| at),
            );
            let found = gathered(values, dim, &mut both.iter().map(|&(_, index)| index));
            largest = largest.max(difference(&expected, &found));
        }
        (both.len() as f64 / count, largest)
    }

    /// Returns the reference's results as features.
    fn expected(&self, at: usize) -> Features {
        let (of, image) = (&self.reference.frames[at], self.image(at));
        let place = |at: &[f32]| DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5;
        Features {
            width: image.width,
            height: image.height,
            keypoints: self
                .tensor(&of.keypoints)
                .chunks_exact(2)
                .map(place)
                .collect(),
            scales_px: Vec::new(),
            orientations: Vec::new(),
            scores: self.tensor(&of.scores).to_vec(),
            descriptors: Descriptors::Floats {
                dim: of.descriptors.shape[1],
                values: self.tensor(&of.descriptors).to_vec(),
            },
        }
    }

    fn matches(&self) -> Vec<(u32, u32)> {
        let matches = self.reference.matches.iter().zip(0u32..);
        matches
            .filter_map(|(&other, at)| u32::try_from(other).ok().map(|other| (at, other)))
            .collect()
    }
}

/// Returns the largest difference of two tensors in standard deviations of the first.
fn difference(expected: &[f32], found: &[f32]) -> f64 {
    assert_eq!(expected.len(), found.len());
    let count = expected.len() as f64;
    let mean = expected.iter().map(|&value| f64::from(value)).sum::<f64>() / count;
    let variance = expected
        .iter()
        .map(|&value| (f64::from(value) - mean).powi(2))
        .sum::<f64>()
        / count;
    let largest = expected
        .iter()
        .zip(found)
        .map(|(&a, &b)| f64::from(a - b).abs())
        .fold(0.0, f64::max);
    largest / variance.sqrt()
}

fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/superglue-tiny")
}

/// Returns the committed folder, or the one that `OSTRA_PARITY_SUPERGLUE` names.
fn folder() -> Folder {
    Folder::open(&std::env::var_os("OSTRA_PARITY_SUPERGLUE").map_or_else(tiny, PathBuf::from))
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn keypoints_and_descriptors_equal_the_reference() {
    let folder = folder();
    for at in 0..2 {
        let found = folder.found(&folder.image(at));
        let (share, largest) = folder.compare(at, &found);
        println!("image {at}: {share:.4} of the keypoints, scores and descriptors {largest:.1e}");
        // If keypoints are equally strong to the last bits, another one may be the last.
        assert!(
            share >= 0.995 && largest < TOLERANCE,
            "image {at}: {share} {largest}"
        );
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn keypoints_have_the_same_partners_as_in_the_reference() {
    let folder = folder();
    let both = [folder.expected(0), folder.expected(1)];
    let [first, second] = &both;
    let agreement = folder
        .glue
        .agreement([first, second], usize::MAX)
        .unwrap()
        .unwrap()
        .0;
    let largest = difference(
        folder.tensor(&folder.reference.agreement),
        agreement.as_floats(),
    );
    println!("agreement {largest:.1e}");
    assert!(largest < TOLERANCE, "{largest}");
    let (expected, found) = (
        folder.matches(),
        folder.glue.matches(first, second).unwrap(),
    );
    println!("{} partners", expected.len());
    assert!(
        expected.len() >= 9 && found == expected,
        "{found:?} {expected:?}"
    );
    let unassigned = first.select(&[]);
    assert_eq!(folder.glue.matches(&unassigned, second).unwrap(), []);
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn swapped_channels_and_half_pixel_shifts_are_detected() {
    let folder = Folder::open(&tiny());
    let right = folder.image(0);
    let swapped = Image {
        pixels: right.pixels.iter().map(|&[r, g, b]| [b, g, r]).collect(),
        ..right.clone()
    };
    let (share, largest) = folder.compare(0, &folder.found(&swapped));
    assert!(
        share < 0.9 || largest > 10.0 * TOLERANCE,
        "blue for red: {share} {largest}"
    );
    let mut moved = folder.expected(1);
    moved.keypoints.iter_mut().for_each(|at| at.x += 0.5);
    let agreement = folder
        .glue
        .agreement([&folder.expected(0), &moved], usize::MAX)
        .unwrap()
        .unwrap()
        .0;
    let largest = difference(
        folder.tensor(&folder.reference.agreement),
        agreement.as_floats(),
    );
    assert!(
        largest > 10.0 * TOLERANCE,
        "keypoints half a pixel to the right: {largest}"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn images_of_any_size_have_keypoints_within_them() {
    let folder = Folder::open(&tiny());
    let image = folder.image(0);
    let (width, height) = (91usize, 77usize);
    let luma = image.luma();
    let part: Vec<f32> = luma
        .chunks_exact(image.width as usize)
        .take(height)
        .flat_map(|row| &row[..width])
        .copied()
        .collect();
    let allowed: Vec<bool> = (0..part.len()).map(|at| at % width < 60).collect();
    let found = folder
        .points
        .extract(&part, width, height, Some(&allowed))
        .unwrap();
    assert!(found.keypoints.len() > 20, "{}", found.keypoints.len());
    assert!(
        found
            .keypoints
            .iter()
            .all(|at| at.x < 60.0 && at.x > 4.0 && at.y > 4.0 && at.y < 73.0)
    );
    assert!(found.scores.is_sorted_by(|a, b| a >= b));
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn descriptors_of_another_kind_are_refused() {
    let folder = Folder::open(&tiny());
    let bytes = Descriptors::Bytes {
        dim: 128,
        values: vec![0; 128 * folder.expected(0).keypoints.len()],
    };
    let other = Features {
        descriptors: bytes,
        ..folder.expected(0)
    };
    let error = folder.glue.matches(&other, &other).unwrap_err();
    assert!(
        matches!(&error, FeatureError::Kinds(what) if what.contains("SuperPoint")),
        "{error}"
    );
}
