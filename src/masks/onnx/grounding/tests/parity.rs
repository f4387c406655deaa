//! The network and what is done around it, beside the reference's answers on the same weights.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::super::{Answer, GroundingDino};
use super::{network, picture, tiny};
use crate::engine::job::Progress;
use crate::frames::Image;

/// Largest difference of a box (shares of the picture) or a score.
const TOLERANCE: f64 = 1e-3;
/// Share of queries that must be within it: of cells whose scores are alike to rounding, either may become the earlier
/// query, and a query is told its number. None are alike in the network committed here.
const WITHIN: f64 = 0.97;

#[derive(Deserialize)]
struct Reference {
    network: String,
    frames: Vec<FrameReference>,
}

#[derive(Deserialize)]
struct FrameReference {
    picture: String,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    phrases: Vec<String>,
    logits: Place,
    boxes: Place,
}

/// Where a tensor lies in `reference.bin`.
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
        let reference = serde_json::from_slice(&std::fs::read(path.join("reference.json")).unwrap()).unwrap();
        let bytes = std::fs::read(path.join("reference.bin")).unwrap();
        let values = bytes.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect();
        Self { path: path.to_owned(), reference, values }
    }

    fn tensor(&self, place: &Place) -> &[f32] {
        &self.values[place.start..][..place.shape.iter().product()]
    }
}

/// What differs between two answers.
struct Difference {
    /// Largest of each query's box and scores, in increasing order.
    of_queries: Vec<f64>,
    /// Largest of each query's logits in standard deviations of the reference's, in increasing order.
    of_logits: Vec<f64>,
}

/// Largest difference in each row, in increasing order.
fn by_rows(a: &[f32], b: &[f32], width: usize) -> Vec<f64> {
    assert_eq!(a.len(), b.len());
    let row = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max);
    a.chunks_exact(width).zip(b.chunks_exact(width)).map(row).collect()
}

fn deviation(values: &[f32]) -> f64 {
    let mean = values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64;
    (values.iter().map(|&value| (f64::from(value) - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

impl Difference {
    fn of(folder: &Folder, case: &Case, answer: &Answer) -> Self {
        let (logits, boxes) = (folder.tensor(&case.logits), folder.tensor(&case.boxes));
        let tokens = answer.caption.ids.len();
        let sorted = |mut rows: Vec<f64>| {
            rows.sort_by(f64::total_cmp);
            rows
        };
        let scores = |logits: &[f32]| logits.iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect::<Vec<_>>();
        let of_scores = by_rows(&scores(logits), &scores(&answer.logits), tokens);
        let of_boxes = by_rows(boxes, &answer.boxes, 4);
        let of_queries = sorted(of_scores.into_iter().zip(of_boxes).map(|(a, b)| a.max(b)).collect());
        let spread = deviation(logits);
        let of_logits = sorted(by_rows(logits, &answer.logits, tokens).iter().map(|one| one / spread).collect());
        Self { of_queries, of_logits }
    }

    /// The largest among the `share` of queries that differ least.
    fn within(rows: &[f64], share: f64) -> f64 {
        rows[(rows.len() as f64 * share).ceil() as usize - 1]
    }
}

fn compare(folder: &Folder, case: &Case, dino: &GroundingDino, image: &Image) -> Difference {
    let answer = dino.look(image, &case.phrases, &Progress::default()).unwrap();
    Difference::of(folder, case, &answer)
}

/// The folder committed here, or the one that `OSTRA_PARITY_GROUNDING` names.
#[test]
fn every_box_and_score_is_that_of_the_reference() {
    let named = std::env::var_os("OSTRA_PARITY_GROUNDING").map(PathBuf::from);
    let share = if named.is_some() { WITHIN } else { 1.0 };
    let folder = Folder::open(&named.unwrap_or_else(tiny));
    let Some(dino) = network(&folder.path, &folder.reference.network) else { return };
    for of in &folder.reference.frames {
        let image = picture(&folder.path.join(&of.picture));
        for case in &of.cases {
            let Difference { of_queries, of_logits } = compare(&folder, case, &dino, &image);
            let [usual, most] = [0.5, share].map(|share| Difference::within(&of_queries, share));
            let [usual_logit, most_logit] = [0.5, share].map(|share| Difference::within(&of_logits, share));
            let (count, beside) = (of_queries.len(), of_queries.iter().filter(|one| **one >= TOLERANCE).count());
            println!(
                "{} {:?}: boxes and scores median {usual:.1e}, {share:.2} within {most:.1e}, {beside} of {count} \
                 queries beside; logits median {usual_logit:.1e}, within {most_logit:.1e} deviations ({:.2})",
                of.picture,
                case.phrases,
                deviation(folder.tensor(&case.logits))
            );
            assert!(most < TOLERANCE, "{} {:?}: {most}", of.picture, case.phrases);
            assert!(deviation(folder.tensor(&case.boxes)) > 0.1, "boxes that are all alike prove nothing");
            assert!(deviation(folder.tensor(&case.logits)) > 0.1, "logits that are all alike prove nothing");
        }
    }
}

#[test]
fn blue_for_red_and_half_a_pixel_are_noticed() {
    let folder = Folder::open(&tiny());
    let Some(dino) = network(&folder.path, &folder.reference.network) else { return };
    let of = &folder.reference.frames[0];
    let right = picture(&folder.path.join(&of.picture));
    let swapped = Image { pixels: right.pixels.iter().map(|&[r, g, b]| [b, g, r]).collect(), ..right.clone() };
    let mut shifted = right.clone();
    for (row, from) in shifted.pixels.chunks_exact_mut(300).zip(right.pixels.chunks_exact(300)) {
        for x in 0..299 {
            row[x] = std::array::from_fn(|channel| from[x][channel].midpoint(from[x + 1][channel]));
        }
    }
    for (fault, image) in [("blue for red", swapped), ("half a pixel", shifted)] {
        let found = compare(&folder, &of.cases[0], &dino, &image);
        let median = Difference::within(&found.of_queries, 0.5);
        println!("{fault}: median {median:.1e}");
        assert!(median > TOLERANCE, "{fault}: {median}");
    }
}
