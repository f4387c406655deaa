//! Compares the networks and their pre- and postprocessing with the reference on the same weights.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec2;
use serde::Deserialize;

use super::super::decoder::MaskPrediction;
use super::super::{ImagePart, Sam, SamFrame};
use super::{networks, tiny, tiny_efficient, tiny_sam2};
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
    /// Further maps of the embedding, of Segment Anything 2.
    #[serde(default)]
    high_resolution: Vec<Place>,
    /// Image of the masks of all cases, for Segment Anything 2: bit k of a pixel is that of case k.
    masks: Option<String>,
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
    /// Whether another mask replaces the one for clear prompts, for Segment Anything 2.
    replaced: Option<bool>,
    low: Place,
    logits: Option<Place>,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
struct Place {
    start: usize,
    shape: Vec<usize>,
}

/// A folder that `tests/parity/sam.py`, `efficient_sam.py` or `sam2.py` wrote.
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
        } else if encoder.contains("sam2") {
            Dialect::Sam2
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

    /// Returns the masks of a case at the size of the image, row by row.
    fn mask(&self, of: &FrameReference, case: usize) -> Option<Vec<bool>> {
        let bits = image::open(self.path.join(of.masks.as_ref()?)).unwrap();
        let inside = |bits: &u8| bits >> case & 1 == 1;
        Some(bits.to_luma8().iter().map(inside).collect())
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }
}

/// Returns the largest difference of two tensors, in standard deviations of the first.
fn difference(expected: &[f32], found: &[f32]) -> f64 {
    assert_eq!(expected.len(), found.len());
    let largest = expected
        .iter()
        .zip(found)
        .map(|(&a, &b)| f64::from(a - b).abs())
        .fold(0.0, f64::max);
    largest / deviation(expected)
}

/// Returns the standard deviation of the values of a tensor.
fn deviation(values: &[f32]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / count;
    let square = |&value: &f32| (f64::from(value) - mean).powi(2);
    (values.iter().map(square).sum::<f64>() / count).sqrt()
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
    let places = std::iter::once(&of.embedding).chain(&of.high_resolution);
    assert_eq!(places.clone().count(), embedding.maps.len());
    let embedded = places
        .zip(&embedding.maps)
        .map(|(place, map)| difference(folder.tensor(place), &map.values))
        .fold(0.0, f64::max);
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
/// They are those committed here, unless `OSTRA_PARITY_SAM`, `OSTRA_PARITY_EFFICIENT_SAM` and
/// `OSTRA_PARITY_SAM2` name others.
fn folders() -> [Folder; 3] {
    [
        named("OSTRA_PARITY_SAM", tiny),
        named("OSTRA_PARITY_EFFICIENT_SAM", tiny_efficient),
        sam2_folder(),
    ]
}

fn sam2_folder() -> Folder {
    named("OSTRA_PARITY_SAM2", tiny_sam2)
}

fn named(variable: &str, committed: fn() -> PathBuf) -> Folder {
    Folder::open(&std::env::var_os(variable).map_or_else(committed, PathBuf::from))
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
fn sam2_masks_match_the_reference_at_the_size_of_the_image() {
    let folder = sam2_folder();
    let sam = folder.networks();
    let (mut kept, mut replaced) = (0, 0);
    for of in &folder.reference.frames {
        let image = folder.image(&of.image);
        let whole = ImagePart::whole(image.width, image.height);
        let embedding = sam.embed(&image, whole, &Progress::default()).unwrap();
        let frame = sam.frame(&embedding).unwrap();
        for (at, answer) in answers(&frame, &of.cases, 0.0).iter().enumerate() {
            let expected = folder.mask(of, at).unwrap();
            let (found, logits) = (frame.region(answer).inside, frame.enlarged(answer));
            assert_eq!(expected.len(), found.len());
            // The sign of a logit that is zero within the tolerance is not determined.
            let least = (TOLERANCE * deviation(&logits)) as f32;
            let clear = (0..found.len()).filter(|&at| logits[at].abs() > least);
            let wrong = clear.clone().filter(|&at| found[at] != expected[at]);
            let (wrong, clear) = (wrong.count(), clear.count());
            let differ = (0..found.len()).filter(|&at| found[at] != expected[at]);
            let what = format!("{}, case {at}", of.image);
            println!(
                "{what}: {} of {} pixels differ",
                differ.count(),
                found.len()
            );
            assert_eq!(wrong, 0, "{what}");
            assert!(clear > found.len() / 100 * 98, "{what}: {clear} compared");
        }
        let of_kind = |kind| move |case: &&Case| case.replaced == Some(kind);
        kept += of.cases.iter().filter(of_kind(false)).count();
        replaced += of.cases.iter().filter(of_kind(true)).count();
    }
    assert!(
        kept > 0 && replaced > 0,
        "the rule about unstable masks shows only where some are replaced and others are not"
    );
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn swapped_channels_and_half_pixel_shifts_are_detected() {
    for committed in [tiny(), tiny_efficient(), tiny_sam2()] {
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
