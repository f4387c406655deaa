//! Compares logits and masks with the official implementation on the same random weights.
//!
//! `tests/parity/deaot.py` computes the reference.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::super::network::OBJECTS;
use super::super::{Deaot, DeaotOptions};
use super::{networks, tiny};
use crate::deaot::tracker::DeaotPass;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask};

/// Largest difference, in standard deviations of the logits.
const TOLERANCE: f64 = 1e-2;
/// Minimum share of pixels with the same label.
const ALIKE: f64 = 0.999;

#[derive(Deserialize)]
struct Reference {
    networks: [String; 4],
    frames: usize,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    /// Masks given, by image.
    #[serde(rename = "told")]
    reported: BTreeMap<usize, String>,
    /// Standard deviation of the logits.
    deviation: f64,
    /// Results from the second image on.
    frames: Vec<FrameReference>,
}

#[derive(Deserialize)]
struct FrameReference {
    /// Logits of the background and the objects of each group; not stored for every image.
    groups: Vec<Place>,
    mask: String,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
struct Place {
    start: usize,
    shape: [usize; 3],
}

/// A folder that `tests/parity/deaot.py` wrote.
struct Folder {
    path: PathBuf,
    reference: Reference,
    values: Vec<f32>,
}

/// Differences of a pass from the reference.
#[derive(Debug, Default)]
struct Difference {
    /// Largest difference of a logit, in standard deviations.
    logits: f64,
    /// Largest share of an image's pixels with a different label.
    labels: f64,
    /// Smallest and largest share of an image that an object covers.
    covers: Option<(f64, f64)>,
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

    fn image(&self, at: usize) -> Image {
        let image = image::open(self.path.join(format!("frame-{at}.png")))
            .unwrap()
            .to_rgb8();
        let pixels = image.pixels().map(|pixel| pixel.0).collect();
        Image {
            width: image.width(),
            height: image.height(),
            pixels,
        }
    }

    fn mask(&self, name: &str) -> LabelMask {
        let mask = image::open(self.path.join(name)).unwrap().to_luma8();
        let ids = mask
            .pixels()
            .map(|pixel| LabelId(pixel.0[0].into()))
            .collect();
        LabelMask {
            width: mask.width(),
            height: mask.height(),
            ids,
        }
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }

    /// Repeats a pass of the reference, with images changed by `seen`.
    fn pass(&self, deaot: &Deaot, case: &Case, seen: fn(Image) -> Image) -> Difference {
        let progress = Progress::default();
        let mut pass = deaot.pass(&progress);
        let mut difference = Difference::default();
        for at in 0..self.reference.frames {
            let image = seen(self.image(at));
            if let Some(expected) = at.checked_sub(1).map(|before| &case.frames[before]) {
                let propagated = pass.propagate(&image).unwrap();
                self.compare_logits(case, expected, &pass, &mut difference);
                let found = super::winner(&propagated);
                compare_masks(&self.mask(&expected.mask), &found, &mut difference);
            }
            if let Some(reported) = case.reported.get(&at) {
                pass.remember(&image, &self.mask(reported)).unwrap();
            }
        }
        difference
    }

    fn compare_logits(
        &self,
        case: &Case,
        expected: &FrameReference,
        pass: &DeaotPass<'_>,
        difference: &mut Difference,
    ) {
        let found = pass.last_logits();
        assert!(expected.groups.is_empty() || expected.groups.len() == found.len());
        for (place, found) in expected.groups.iter().zip(&found) {
            let [_, rows, columns] = place.shape;
            assert_eq!(found.shape(), [1, OBJECTS + 1, rows, columns]);
            let pairs = self.tensor(place).iter().zip(found.as_floats());
            let largest = pairs
                .map(|(&a, &b)| f64::from(a - b).abs())
                .fold(0.0, f64::max);
            difference.logits = difference.logits.max(largest / case.deviation);
        }
    }
}

fn compare_masks(expected: &LabelMask, found: &LabelMask, difference: &mut Difference) {
    let count = expected.ids.len() as f64;
    let others = expected
        .ids
        .iter()
        .zip(&found.ids)
        .filter(|(a, b)| a != b)
        .count();
    difference.labels = difference.labels.max(others as f64 / count);
    let last = expected.ids.iter().max().map_or(0, |label| label.0);
    for label in 1..=last {
        let share = expected.region(LabelId(label)).area() as f64 / count;
        let (least, most) = difference.covers.unwrap_or((1.0, 0.0));
        difference.covers = Some((share.min(least), share.max(most)));
    }
}

/// Opens the committed folder, or the one in `OSTRA_PARITY_DEAOT`.
fn folder() -> Folder {
    Folder::open(&std::env::var_os("OSTRA_PARITY_DEAOT").map_or_else(tiny, PathBuf::from))
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn logits_and_masks_match_the_reference() {
    let folder = folder();
    let deaot = networks(&folder.path, &folder.reference.networks);
    for case in &folder.reference.cases {
        let found = folder.pass(&deaot, case, |image| image);
        println!(
            "{}: {found:?}, deviation {:.2}, {} images",
            case.name,
            case.deviation,
            case.frames.len()
        );
        assert!(
            found.logits < TOLERANCE && 1.0 - found.labels >= ALIKE,
            "{}: {found:?}",
            case.name
        );
        let (least, most) = found.covers.unwrap();
        let is_fair = case.name != "three" || least >= 0.02 && most <= 0.6;
        assert!(is_fair, "an empty or full mask proves nothing");
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn swapped_channels_half_pixel_shifts_and_missing_memory_are_detected() {
    let folder = Folder::open(&tiny());
    let mut deaot = networks(&folder.path, &folder.reference.networks);
    let case = &folder.reference.cases[0];
    let swapped = folder.pass(&deaot, case, |mut image| {
        image.pixels.iter_mut().for_each(|pixel| pixel.reverse());
        image
    });
    assert!(
        swapped.logits > 10.0 * TOLERANCE,
        "blue for red: {swapped:?}"
    );
    let shifted = folder.pass(&deaot, case, |mut image| {
        for row in image.pixels.chunks_exact_mut(image.width as usize) {
            for x in 1..row.len() {
                row[x - 1] =
                    std::array::from_fn(|channel| row[x - 1][channel].midpoint(row[x][channel]));
            }
        }
        image
    });
    assert!(
        shifted.logits > 10.0 * TOLERANCE,
        "half a pixel to the left: {shifted:?}"
    );
    deaot.options = DeaotOptions {
        remembered_every: usize::MAX,
        ..deaot.options
    };
    let forgotten = folder.pass(&deaot, case, |image| image);
    println!(
        "faults: {:.2}, {:.2}, {:.2}",
        swapped.logits, shifted.logits, forgotten.logits
    );
    assert!(
        forgotten.logits > 10.0 * TOLERANCE,
        "only the first image remembered for long: {forgotten:?}"
    );
}
