//! Compares the network and its pre- and postprocessing with the reference on the same weights.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::super::GroundingDino;
use super::{image, network, tiny};
use ostra_core::job::Progress;
use ostra_frames::Image;

/// Maximum difference of a box (fractions of the image) or a score.
const TOLERANCE: f64 = 1e-3;
/// Maximum shift of a query in a full-size network, in places.
///
/// If the scores of two cells are equal up to rounding, either may become the earlier query. No
/// scores are that close in the network committed here.
const SWAPPED: usize = 1;

#[derive(Deserialize)]
struct Reference {
    network: String,
    frames: Vec<FrameReference>,
}

#[derive(Deserialize)]
struct FrameReference {
    #[serde(rename = "picture")]
    image: String,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    phrases: Vec<String>,
    logits: Place,
    boxes: Place,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
struct Place {
    start: usize,
    shape: Vec<usize>,
}

/// A folder that `tests/parity/grounding.py` wrote.
struct Folder {
    path: PathBuf,
    reference: Reference,
    values: Vec<f32>,
}

impl Folder {
    fn open(path: &Path) -> Self {
        let reference =
            serde_json::from_slice(&std::fs::read(path.join("reference.json")).unwrap()).unwrap();
        let bytes = std::fs::read(path.join("reference.bin")).unwrap();
        let values = bytes
            .chunks_exact(4)
            .map(|word| f32::from_le_bytes(word.try_into().unwrap()))
            .collect();
        Self {
            path: path.to_owned(),
            reference,
            values,
        }
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }
}

/// Returns the largest difference in each row, ascending; a row may be shifted by `beside` places.
fn by_rows(expected: &[f32], found: &[f32], width: usize, adjacent: usize) -> Vec<f64> {
    assert_eq!(expected.len(), found.len());
    let found: Vec<&[f32]> = found.chunks_exact(width).collect();
    let apart = |a: &[f32], b: &[f32]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| f64::from((a - b).abs()))
            .fold(0.0, f64::max)
    };
    let row = |(at, expected): (usize, &[f32])| {
        let near = &found[at.saturating_sub(adjacent)..found.len().min(at + adjacent + 1)];
        near.iter()
            .map(|found| apart(expected, found))
            .fold(f64::INFINITY, f64::min)
    };
    let mut rows: Vec<f64> = expected.chunks_exact(width).enumerate().map(row).collect();
    rows.sort_by(f64::total_cmp);
    rows
}

fn deviation(values: &[f32]) -> f64 {
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64;
    (values
        .iter()
        .map(|&value| (f64::from(value) - mean).powi(2))
        .sum::<f64>()
        / values.len() as f64)
        .sqrt()
}

/// Differences of an answer, per query.
struct Difference {
    boxes: Vec<f64>,
    scores: Vec<f64>,
    /// In standard deviations of the reference's logits.
    logits: Vec<f64>,
}

fn compare(
    folder: &Folder,
    case: &Case,
    dino: &GroundingDino,
    image: &Image,
    adjacent: usize,
) -> Difference {
    let answer = dino
        .detect(image, &case.phrases, &Progress::default())
        .unwrap();
    let (logits, tokens) = (folder.tensor(&case.logits), answer.caption.ids.len());
    let scores = |logits: &[f32]| {
        logits
            .iter()
            .map(|logit| 1.0 / (1.0 + (-logit).exp()))
            .collect::<Vec<_>>()
    };
    let spread = deviation(logits);
    Difference {
        boxes: by_rows(folder.tensor(&case.boxes), &answer.boxes, 4, adjacent),
        scores: by_rows(&scores(logits), &scores(&answer.logits), tokens, adjacent),
        logits: by_rows(logits, &answer.logits, tokens, adjacent)
            .iter()
            .map(|one| one / spread)
            .collect(),
    }
}

/// Uses the folder committed here, or the one that `OSTRA_PARITY_GROUNDING` names.
#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn boxes_and_scores_match_the_reference() {
    let named = std::env::var_os("OSTRA_PARITY_GROUNDING").map(PathBuf::from);
    let adjacent = if named.is_some() { SWAPPED } else { 0 };
    let folder = Folder::open(&named.unwrap_or_else(tiny));
    let dino = network(&folder.path, &folder.reference.network);
    for of in &folder.reference.frames {
        let image = image(&folder.path.join(&of.image));
        for case in &of.cases {
            let found = compare(&folder, case, &dino, &image, adjacent);
            let [boxes, scores, logits] =
                [&found.boxes, &found.scores, &found.logits].map(|rows| rows[rows.len() - 1]);
            let [of_boxes, of_logits] =
                [&case.boxes, &case.logits].map(|place| deviation(folder.tensor(place)));
            println!(
                "{} {:?}: {} boxes {boxes:.1e}, scores {scores:.1e}, logits {logits:.1e} deviations; deviation of boxes \
                 {of_boxes:.2}, of logits {of_logits:.2}",
                of.image,
                case.phrases,
                found.boxes.len()
            );
            assert!(
                boxes < TOLERANCE && scores < TOLERANCE && logits < TOLERANCE,
                "{}",
                of.image
            );
            assert!(
                of_boxes > 0.1 && of_logits > 0.05,
                "tensors that are all alike prove nothing"
            );
        }
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn swapped_channels_and_half_pixel_shifts_are_detected() {
    let folder = Folder::open(&tiny());
    let dino = network(&folder.path, &folder.reference.network);
    let of = &folder.reference.frames[0];
    let right = image(&folder.path.join(&of.image));
    let swapped = Image {
        pixels: right.pixels.iter().map(|&[r, g, b]| [b, g, r]).collect(),
        ..right.clone()
    };
    let mut shifted = right.clone();
    for (row, from) in shifted
        .pixels
        .chunks_exact_mut(300)
        .zip(right.pixels.chunks_exact(300))
    {
        for x in 0..299 {
            row[x] = std::array::from_fn(|channel| from[x][channel].midpoint(from[x + 1][channel]));
        }
    }
    for (fault, image) in [("blue for red", swapped), ("half a pixel", shifted)] {
        let found = compare(&folder, &of.cases[0], &dino, &image, 0);
        let [boxes, scores] = [&found.boxes, &found.scores].map(|rows| rows[rows.len() / 2]);
        println!("{fault}: median of boxes {boxes:.1e}, of scores {scores:.1e}");
        assert!(
            boxes > TOLERANCE && scores > TOLERANCE,
            "{fault}: {boxes} {scores}"
        );
    }
}
