//! Compares the tracker with the official code on the same weights.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::super::fit::Fit;
use super::super::{XMem, XMemOptions};
use super::{networks, tiny};
use crate::propagate::LabelProbabilities;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask};

/// Largest difference of a network output, in standard deviations of the reference tensor.
const OF_TENSOR: f64 = 1e-3;
/// Largest difference of a probability.
const OF_PROBABILITY: f32 = 1e-2;
/// Minimum share of pixels with the same label.
const EQUAL: f64 = 0.999;

#[derive(Deserialize)]
struct Reference {
    networks: [String; 3],
    width: u32,
    height: u32,
    side: u32,
    #[serde(rename = "pictures")]
    images: String,
    tensors: BTreeMap<String, Place>,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    limits: Limits,
    /// Frames whose masks are given.
    given: Vec<usize>,
    given_masks: String,
    masks: String,
    probabilities: Vec<Known>,
}

/// Limits, under the names of the official code.
#[derive(Deserialize)]
struct Limits {
    mem_every: usize,
    max_mid_term_frames: usize,
    min_mid_term_frames: usize,
    num_prototypes: usize,
    max_long_term_elements: usize,
    top_k: usize,
}

#[derive(Deserialize)]
struct Known {
    frame: usize,
    tensor: Place,
}

/// Position of a tensor in `reference.bin`.
#[derive(Deserialize)]
struct Place {
    start: usize,
    shape: Vec<usize>,
}

/// A folder that `tests/parity/xmem.py` wrote.
struct Folder {
    path: PathBuf,
    reference: Reference,
    values: Vec<f32>,
}

/// Differences from the reference over all frames of a case.
#[derive(Debug)]
struct Differences {
    /// Largest difference of a probability.
    probability: f32,
    /// Smallest share of equal pixels in a frame.
    equal: f64,
    /// Smallest and largest share of an image that a label covers.
    covers: (f64, f64),
    /// Elements of working and long-term memory at the end, by group.
    sizes: Vec<(usize, usize)>,
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

    /// Loads the networks with the limits of a case.
    fn networks(&self, case: &Case) -> XMem {
        let mut xmem = networks(&self.path, &self.reference.networks);
        xmem.options = XMemOptions {
            short_side: Some(self.reference.side),
            remember_every: case.limits.mem_every,
            most_frames: case.limits.max_mid_term_frames,
            least_frames: case.limits.min_mid_term_frames,
            prototypes: case.limits.num_prototypes,
            most_prototypes: case.limits.max_long_term_elements,
            matches: case.limits.top_k,
        };
        xmem
    }

    fn images(&self) -> Vec<Image> {
        let (width, height) = (self.reference.width, self.reference.height);
        let strip = image::open(self.path.join(&self.reference.images))
            .unwrap()
            .to_rgb8();
        let pixels: Vec<[u8; 3]> = strip.pixels().map(|pixel| pixel.0).collect();
        let images = pixels.chunks_exact((width * height) as usize);
        images
            .map(|pixels| Image {
                width,
                height,
                pixels: pixels.to_vec(),
            })
            .collect()
    }

    fn masks(&self, name: &str) -> Vec<LabelMask> {
        let (width, height) = (self.reference.width, self.reference.height);
        let strip = image::open(self.path.join(name)).unwrap().to_luma8();
        let ids: Vec<LabelId> = strip
            .pixels()
            .map(|pixel| LabelId(u16::from(pixel.0[0])))
            .collect();
        let masks = ids.chunks_exact((width * height) as usize);
        masks
            .map(|ids| LabelMask {
                width,
                height,
                ids: ids.to_vec(),
            })
            .collect()
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }

    /// Tracks a case through images.
    fn follow(&self, xmem: &XMem, case: &Case, images: &[Image]) -> Differences {
        let progress = Progress::default();
        let mut pass = xmem.pass(&progress);
        let (given, expected) = (self.masks(&case.given_masks), self.masks(&case.masks));
        let mut found = Differences {
            probability: 0.0,
            equal: 1.0,
            covers: (1.0, 0.0),
            sizes: Vec::new(),
        };
        for (at, image) in images.iter().enumerate() {
            if let Some(reported) = case.given.iter().position(|&frame| frame == at) {
                pass.remember(image, &given[reported]).unwrap();
                continue;
            }
            let answer = pass.propagate(image).unwrap();
            let equal = found.compare(&labels(&answer), &expected[at].ids, answer.labels.len());
            print!("frame {at}: {equal:.5} of the pixels are equal");
            if let Some(known) = case.probabilities.iter().find(|known| known.frame == at) {
                let expected = self.tensor(&known.tensor);
                assert_eq!(answer.probabilities.len(), expected.len());
                let pairs = expected.iter().zip(&answer.probabilities);
                let largest = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                print!(
                    ", probabilities differ by {largest:.1e}, their deviation is {:.3}",
                    deviation(expected)
                );
                found.probability = found.probability.max(largest);
            }
            println!();
        }
        found.sizes = pass.sizes();
        found
    }
}

impl Differences {
    /// Compares the labels of a frame; returns the share of equal pixels.
    fn compare(&mut self, found: &[LabelId], expected: &[LabelId], count: usize) -> f64 {
        let total = expected.len() as f64;
        let equal = found.iter().zip(expected).filter(|(a, b)| a == b).count() as f64 / total;
        self.equal = self.equal.min(equal);
        for label in 1..=count {
            let share = expected
                .iter()
                .filter(|id| usize::from(id.0) == label)
                .count() as f64
                / total;
            self.covers = (self.covers.0.min(share), self.covers.1.max(share));
        }
        equal
    }

    fn is_same(&self) -> bool {
        self.probability < OF_PROBABILITY && self.equal >= EQUAL
    }
}

fn labels(answer: &LabelProbabilities) -> Vec<LabelId> {
    let area = answer.width * answer.height;
    let best = |at: usize| {
        let maps = 0..=answer.labels.len();
        let probability = |map: usize| answer.probabilities[map * area + at];
        maps.max_by(|&a, &b| probability(a).total_cmp(&probability(b)).then(b.cmp(&a)))
            .unwrap()
    };
    (0..area)
        .map(|at| {
            best(at)
                .checked_sub(1)
                .map_or(LabelId::NONE, |label| answer.labels[label])
        })
        .collect()
}

fn deviation(values: &[f32]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / count;
    (values
        .iter()
        .map(|&value| (f64::from(value) - mean).powi(2))
        .sum::<f64>()
        / count)
        .sqrt()
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

/// Opens the committed folder, or the one in `OSTRA_PARITY_XMEM`.
fn folder() -> Folder {
    Folder::open(&std::env::var_os("OSTRA_PARITY_XMEM").map_or_else(tiny, PathBuf::from))
}

/// Returns the largest difference of the key encoder's outputs for an image.
fn encoded(folder: &Folder, xmem: &XMem, image: &Image) -> f64 {
    let fit = Fit::new(image.width, image.height, xmem.options.short_side);
    let seen = xmem.networks.see(image, fit, &Progress::default()).unwrap();
    let mut largest = 0.0f64;
    for (name, place) in &folder.reference.tensors {
        let expected = folder.tensor(place);
        let cells = seen.cells.len();
        let planes = |rows: &[f32], width: usize| -> Vec<f32> {
            (0..rows.len())
                .map(|at| rows[at % cells * width + at / cells])
                .collect()
        };
        let found = match name.as_str() {
            "key" => planes(&seen.cells.keys, seen.cells.widths.key),
            "selection" => planes(&seen.cells.selections, seen.cells.widths.key),
            "shrinkage" => seen.cells.shrinkages.clone(),
            name => seen.feature(name).as_floats().to_vec(),
        };
        let apart = difference(expected, &found);
        println!(
            "{name}: {apart:.1e} of its deviation {:.3}",
            deviation(expected)
        );
        largest = largest.max(apart);
    }
    largest
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn tracking_matches_the_official_code() {
    let folder = folder();
    let images = folder.images();
    for case in &folder.reference.cases {
        let xmem = folder.networks(case);
        assert!(encoded(&folder, &xmem, &images[0]) < OF_TENSOR);
        let found = folder.follow(&xmem, case, &images);
        println!("{}: {found:?}", case.name);
        assert!(found.is_same(), "{}: {found:?}", case.name);
        assert!(
            found.covers.0 >= 0.02 && found.covers.1 <= 0.6,
            "an empty or full mask proves nothing"
        );
        if case.name == "consolidated" {
            let (_, long_term) = found.sizes[0];
            assert_eq!(
                long_term, case.limits.max_long_term_elements,
                "memory is full, so some was forgotten"
            );
        }
    }
}

#[test]
#[ignore = "needs ONNX Runtime, named in ORT_DYLIB_PATH: add --include-ignored"]
fn faults_are_detected() {
    let folder = Folder::open(&tiny());
    let case = &folder.reference.cases[0];
    let mut xmem = folder.networks(case);
    let right = folder.images();
    let changed = |change: &dyn Fn(&Image, usize) -> [u8; 3]| -> Vec<Image> {
        let image = |of: &Image| Image {
            pixels: (0..of.pixels.len()).map(|at| change(of, at)).collect(),
            ..*of
        };
        right.iter().map(image).collect()
    };
    let swapped = changed(&|image, at| {
        let [r, g, b] = image.pixels[at];
        [b, g, r]
    });
    assert!(encoded(&folder, &xmem, &swapped[0]) > 10.0 * OF_TENSOR);
    assert!(
        !folder.follow(&xmem, case, &swapped).is_same(),
        "blue for red"
    );
    let shifted = changed(&|image, at| {
        let next = image.pixels[(at + 1).min(image.pixels.len() - 1)];
        std::array::from_fn(|channel| image.pixels[at][channel].midpoint(next[channel]))
    });
    assert!(encoded(&folder, &xmem, &shifted[0]) > 10.0 * OF_TENSOR);
    assert!(
        !folder.follow(&xmem, case, &shifted).is_same(),
        "half a pixel to the left"
    );
    let options = xmem.options;
    let faults = [
        (
            "nothing but the first frame is remembered",
            XMemOptions {
                remember_every: 1000,
                ..options
            },
        ),
        (
            "nothing is consolidated",
            XMemOptions {
                most_frames: 1000,
                ..options
            },
        ),
        (
            "nothing is kept for long",
            XMemOptions {
                most_prototypes: 0,
                ..options
            },
        ),
        (
            "matches are too few",
            XMemOptions {
                matches: 5,
                ..options
            },
        ),
    ];
    for (fault, options) in faults {
        xmem.options = options;
        let found = folder.follow(&xmem, case, &right);
        assert!(!found.is_same(), "{fault}: {found:?}");
    }
}
