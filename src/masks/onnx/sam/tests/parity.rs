//! Compares the networks and their pre- and postprocessing with the reference on the same weights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use serde::Deserialize;

use super::super::decoder::MaskPrediction;
use super::super::{ImagePart, Sam, SamFrame};
use super::{networks, tiny, tiny_efficient};
use crate::{AnswerSize, Click, PxBox};
use ostra_compute::nn::Dialect;
use ostra_core::job::Progress;
use ostra_frames::Image;

/// Maximum difference, in standard deviations of the reference's tensor.
const TOLERANCE: f64 = 1e-3;

#[derive(Deserialize)]
struct Reference {
    encoder: String,
    decoder: String,
    frames: Vec<FrameReference>,
}

#[derive(Deserialize)]
struct FrameReference {
    #[serde(rename = "picture")]
    image: String,
    embedding: Place,
    cases: Vec<Case>,
}

/// One prompt. Positions are in pixels, relative to the centre of the first pixel.
#[derive(Deserialize)]
struct Case {
    clicks: Vec<(f64, f64, u8)>,
    boxes: Vec<[f64; 4]>,
    /// Case whose answer is refined.
    after: Option<usize>,
    iou: f64,
    covers: f64,
    low: Place,
    logits: Option<Place>,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
struct Place {
    start: usize,
    shape: Vec<usize>,
}

/// A folder that `tests/parity/sam.py` or `efficient_sam.py` wrote.
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

    fn networks(&self) -> Sam {
        let Reference {
            encoder, decoder, ..
        } = &self.reference;
        let dialect = if encoder.contains("efficient") {
            Dialect::EfficientSam
        } else {
            Dialect::Sam
        };
        networks(dialect, &self.path, encoder, decoder)
    }

    fn image(&self, name: &str) -> Image {
        let image = image::open(self.path.join(name)).unwrap().to_rgb8();
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
}

/// Returns the largest difference of two tensors, in standard deviations of the first.
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

/// Runs the cases of the reference on a frame, with clicks shifted by `shift_px`.
fn answers(frame: &SamFrame, cases: &[Case], shift_px: f64) -> Vec<Arc<MaskPrediction>> {
    let mut given: Vec<Arc<MaskPrediction>> = Vec::new();
    for case in cases {
        let click = |&(x, y, include): &(f64, f64, u8)| Click {
            at_px: DVec2::new(x + 0.5 + shift_px, y + 0.5),
            include: include == 1,
        };
        let clicks: Vec<Click> = case.clicks.iter().map(click).collect();
        let part = |&[x0, y0, x1, y1]: &[f64; 4]| PxBox {
            min_px: DVec2::new(x0 + shift_px, y0),
            max_px: DVec2::new(x1 + 1.0 + shift_px, y1 + 1.0),
        };
        let within = case.boxes.first().map(part);
        let before = case.after.map(|at| Arc::clone(&given[at]));
        given.push(
            frame
                .ask(
                    &clicks,
                    within.as_ref(),
                    before.as_ref(),
                    AnswerSize::Automatic,
                )
                .unwrap(),
        );
    }
    given
}

/// Returns the largest difference of the embedding, and of all results of a frame's cases.
fn compare(
    folder: &Folder,
    of: &FrameReference,
    sam: &Sam,
    image: &Image,
    shift_px: f64,
) -> (f64, f64) {
    let embedding = sam
        .embed(
            image,
            ImagePart::whole(image.width, image.height),
            &Progress::default(),
        )
        .unwrap();
    let frame = sam.frame(&embedding).unwrap();
    let embedded = difference(folder.tensor(&of.embedding), &embedding.maps[0].values);
    let mut answered = 0.0f64;
    for (case, answer) in of.cases.iter().zip(answers(&frame, &of.cases, shift_px)) {
        answered = answered.max(difference(folder.tensor(&case.low), &answer.logits));
        answered = answered.max((case.iou - f64::from(answer.score)).abs() / case.iou.abs());
        if let Some(place) = &case.logits {
            answered = answered.max(difference(folder.tensor(place), &frame.enlarged(&answer)));
        }
    }
    (embedded, answered)
}

/// Opens the reference folders.
///
/// They are those committed here, unless `OSTRA_PARITY_SAM` and `OSTRA_PARITY_EFFICIENT_SAM` name
/// others.
fn folders() -> [Folder; 2] {
    let named = |variable: &str, committed: fn() -> PathBuf| {
        Folder::open(&std::env::var_os(variable).map_or_else(committed, PathBuf::from))
    };
    [
        named("OSTRA_PARITY_SAM", tiny),
        named("OSTRA_PARITY_EFFICIENT_SAM", tiny_efficient),
    ]
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn all_tensors_match_the_reference() {
    for folder in folders() {
        let sam = folder.networks();
        for of in &folder.reference.frames {
            let (embedded, answered) = compare(&folder, of, &sam, &folder.image(&of.image), 0.0);
            let covers: Vec<f64> = of.cases.iter().map(|case| case.covers).collect();
            let what = format!("{}, {}", folder.reference.encoder, of.image);
            println!(
                "{what}: embedding {embedded:.1e}, answers {answered:.1e}; masks cover {covers:.2?}"
            );
            assert!(
                embedded < TOLERANCE && answered < TOLERANCE,
                "{what}: {embedded} {answered}"
            );
            assert!(
                covers.iter().all(|share| (0.02..=0.6).contains(share)),
                "an empty or full mask proves nothing"
            );
        }
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn swapped_channels_and_half_pixel_shifts_are_detected() {
    for committed in [tiny(), tiny_efficient()] {
        let folder = Folder::open(&committed);
        let sam = folder.networks();
        let of = &folder.reference.frames[0];
        let right = folder.image(&of.image);
        let swapped = Image {
            pixels: right.pixels.iter().map(|&[r, g, b]| [b, g, r]).collect(),
            ..right.clone()
        };
        let (embedded, _) = compare(&folder, of, &sam, &swapped, 0.0);
        assert!(embedded > 10.0 * TOLERANCE, "blue for red: {embedded}");
        let mut shifted = right.clone();
        for (row, from) in shifted
            .pixels
            .chunks_exact_mut(300)
            .zip(right.pixels.chunks_exact(300))
        {
            for x in 0..299 {
                row[x] =
                    std::array::from_fn(|channel| from[x][channel].midpoint(from[x + 1][channel]));
            }
        }
        let (embedded, _) = compare(&folder, of, &sam, &shifted, 0.0);
        assert!(
            embedded > 10.0 * TOLERANCE,
            "the image half a pixel to the left: {embedded}"
        );
        let (_, answered) = compare(&folder, of, &sam, &right, 0.5);
        assert!(
            answered > 10.0 * TOLERANCE,
            "clicks half a pixel to the right: {answered}"
        );
    }
}
