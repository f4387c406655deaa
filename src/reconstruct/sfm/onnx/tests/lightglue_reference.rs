//! LightGlue compared with the reference's results on the same weights.

use std::path::{Path, PathBuf};

use glam::DVec2;
use serde::Deserialize;

use super::super::{LightGlue, LightGlueFeatures, LightGlueOptions};
use super::superglue::Place;
use crate::sfm::{Descriptors, FeatureMatcher, Features};
use ostra_compute::nn::{Catalogue, Network, Runtime};

/// Largest difference of a score.
const TOLERANCE: f32 = 1e-3;

#[derive(Deserialize)]
struct LightGlueReference {
    glue: String,
    pairs: Vec<PairReference>,
}

#[derive(Deserialize)]
struct PairReference {
    images: [ImageReference; 2],
    /// For each keypoint of the first image its partner, or -1.
    matches: Vec<i64>,
    scores: Place,
}

#[derive(Deserialize)]
struct ImageReference {
    size: [u32; 2],
    /// Positions are in pixels from the centre of the first pixel.
    keypoints: Place,
    descriptors: Place,
}

/// A folder written by `tests/parity/lightglue.py`, and its network.
struct LightGlueFolder {
    reference: LightGlueReference,
    values: Vec<f32>,
    glue: LightGlue,
}

impl LightGlueFolder {
    fn open(path: &Path) -> Self {
        let reference = std::fs::read(path.join("reference.json")).unwrap();
        let reference: LightGlueReference = serde_json::from_slice(&reference).unwrap();
        let bytes = std::fs::read(path.join("reference.bin")).unwrap();
        let words = bytes.as_chunks::<4>().0.iter();
        let catalogue = Catalogue::bundled().unwrap();
        let entry = catalogue.entry("aliked-lightglue").unwrap();
        let interface = entry.files()[0].signature.as_ref();
        let file = path.join(&reference.glue);
        let network = Network::load(&Runtime::find().unwrap(), &file, interface).unwrap();
        let options = LightGlueOptions::default();
        Self {
            values: words.map(|word| f32::from_le_bytes(*word)).collect(),
            glue: LightGlue::of_network(network, LightGlueFeatures::Aliked, options).unwrap(),
            reference,
        }
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }

    fn features(&self, image: &ImageReference) -> Features {
        let keypoints = self.tensor(&image.keypoints).as_chunks::<2>().0.iter();
        let place = |&[x, y]: &[f32; 2]| DVec2::new(x.into(), y.into()) + 0.5;
        Features {
            width: image.size[0],
            height: image.size[1],
            keypoints: keypoints.map(place).collect(),
            scales_px: Vec::new(),
            orientations: Vec::new(),
            scores: Vec::new(),
            descriptors: Descriptors::Floats {
                dim: image.descriptors.shape[1],
                values: self.tensor(&image.descriptors).to_vec(),
            },
        }
    }

    fn pair(&self, pair: &PairReference) -> [Features; 2] {
        [0, 1].map(|at| self.features(&pair.images[at]))
    }

    /// Returns the largest difference of a score from the reference.
    fn difference(&self, pair: &PairReference, [first, second]: [&Features; 2]) -> f32 {
        let given = self.glue.partners([first, second], usize::MAX).unwrap();
        let [_, scores] = given.expect("keypoints");
        let expected = self.tensor(&pair.scores);
        assert_eq!(scores.as_floats().len(), expected.len());
        let both = expected.iter().zip(scores.as_floats());
        both.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }
}

fn tiny() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/parity/lightglue-tiny")
}

/// Returns the committed folder, or the one that `OSTRA_PARITY_LIGHTGLUE` names.
fn folder() -> LightGlueFolder {
    let named = std::env::var_os("OSTRA_PARITY_LIGHTGLUE");
    LightGlueFolder::open(&named.map_or_else(tiny, PathBuf::from))
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn lightglue_matches_and_scores_equal_the_reference() {
    let folder = folder();
    assert!(folder.reference.pairs.len() >= 3);
    for (number, pair) in folder.reference.pairs.iter().enumerate() {
        let [first, second] = &folder.pair(pair);
        let expected: Vec<(u32, u32)> = (0u32..)
            .zip(&pair.matches)
            .filter_map(|(at, &other)| Some((at, u32::try_from(other).ok()?)))
            .collect();
        let found = folder.glue.matches(first, second).unwrap();
        let largest = folder.difference(pair, [first, second]);
        println!(
            "pair {number}: {} matches, scores {largest:.1e}",
            found.len()
        );
        assert!(expected.len() >= 9 && expected.len() < first.keypoints.len());
        assert_eq!(found, expected, "pair {number}");
        assert!(largest < TOLERANCE, "pair {number}: {largest}");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn lightglue_depends_on_the_longer_side_and_on_the_order_of_axes() {
    let folder = LightGlueFolder::open(&tiny());
    for pair in &folder.reference.pairs {
        let [first, second] = &folder.pair(pair);
        let shorter = first.width.min(first.height);
        let scaled = Features {
            width: shorter,
            height: shorter,
            ..first.clone()
        };
        let mut swapped = first.clone();
        swapped
            .keypoints
            .iter_mut()
            .for_each(|at| *at = DVec2::new(at.y, at.x));
        let mut moved = first.clone();
        let every_second = moved.keypoints.iter_mut().step_by(2);
        every_second.for_each(|at| at.x += 0.5);
        for (fault, wrong) in [
            ("positions scaled by the shorter side", &scaled),
            ("rows for columns", &swapped),
            ("every second keypoint half a pixel to the right", &moved),
        ] {
            let largest = folder.difference(pair, [wrong, second]);
            assert!(largest > 2.0 * TOLERANCE, "{fault}: {largest}");
        }
        // Attention sees differences of positions only, so no convention of the origin can be wrong.
        let mut shifted = first.clone();
        shifted.keypoints.iter_mut().for_each(|at| *at += 0.5);
        let largest = folder.difference(pair, [&shifted, second]);
        assert!(largest < TOLERANCE, "all half a pixel down: {largest}");
    }
}
