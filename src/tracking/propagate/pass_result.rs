use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use ostra_core::image::ImageSize;
use ostra_masks::{LabelId, LabelMask, RunMask};

/// A network's probability of each label in every pixel of a frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LabelProbabilities {
    /// The labels, ascending.
    pub labels: Vec<LabelId>,
    /// Size of the maps in pixels: the size of the image.
    pub width: usize,
    pub height: usize,
    /// Shape `[1 + labels][height][width]`: the background, then each label; they sum to 1.
    pub probabilities: Vec<f32>,
}

impl LabelProbabilities {
    /// Creates the maps from those of the background and of `labels` in any order.
    pub fn sorted(labels: &[LabelId], size: ImageSize, maps: Vec<f32>) -> Self {
        let ImageSize { width, height } = size;
        let area = size.area();
        let mut order: Vec<usize> = (0..labels.len()).collect();
        order.sort_by_key(|&at| labels[at]);
        let probabilities = if order.is_sorted() {
            maps
        } else {
            let places = std::iter::once(0).chain(order.iter().map(|at| at + 1));
            places
                .flat_map(|place| &maps[place * area..][..area])
                .copied()
                .collect()
        };
        Self {
            labels: order.iter().map(|&at| labels[at]).collect(),
            width,
            height,
            probabilities,
        }
    }

    /// Returns the probability of a label or of the background; 0 for an unknown label.
    fn at(&self, label: LabelId, pixel: usize) -> f32 {
        let area = self.width * self.height;
        match self.labels.binary_search(&label) {
            Ok(place) => self.probabilities[(1 + place) * area + pixel],
            Err(_) if label == LabelId::NONE => self.probabilities[pixel],
            Err(_) => 0.0,
        }
    }
}

/// Returns the map with the highest value per pixel, and that value; the first if equal.
pub(crate) fn most_probable(maps: &[f32], area: usize) -> Vec<(usize, f32)> {
    let blocks = (0..area).into_par_iter().step_by(BLOCK).map(|first| {
        let pixels = first..(first + BLOCK).min(area);
        pixels
            .map(|at| best(maps[at..].iter().step_by(area)))
            .collect::<Vec<_>>()
    });
    blocks.flatten_iter().collect()
}

fn best<'a>(probabilities: impl Iterator<Item = &'a f32>) -> (usize, f32) {
    probabilities
        .enumerate()
        .fold((0, f32::NEG_INFINITY), |best, (map, &p)| {
            if p > best.1 { (map, p) } else { best }
        })
}

/// Pixels per parallel task.
const BLOCK: usize = 1 << 14;

/// Result of one pass for a frame.
pub(crate) struct PassResult {
    /// The mask, at the engine's working size.
    pub mask: LabelMask,
    /// Confidence of each label, 0–1.
    ///
    /// May include the background ([`LabelId::NONE`]) and labels that the mask does not show.
    pub confidence: BTreeMap<LabelId, f32>,
    /// The labels that the pass tracks; it has no evidence about others.
    pub known: BTreeSet<LabelId>,
    /// Probabilities, if the engine provides them.
    pub probabilities: Option<LabelProbabilities>,
}

impl PassResult {
    /// Takes the most probable label of every pixel.
    ///
    /// The confidence of a label is the mean of its pixels' probabilities.
    pub fn most_probable(given: LabelProbabilities) -> Self {
        let best = most_probable(&given.probabilities, given.width * given.height);
        let id = |map: usize| {
            if map == 0 {
                LabelId::NONE
            } else {
                given.labels[map - 1]
            }
        };
        let mut sums = vec![(0.0f64, 0usize); 1 + given.labels.len()];
        for &(map, probability) in &best {
            sums[map].0 += f64::from(probability);
            sums[map].1 += 1;
        }
        let shown = sums.iter().enumerate().filter(|(_, (_, count))| *count > 0);
        let confidence = shown
            .map(|(map, &(sum, count))| (id(map), (sum / count as f64) as f32))
            .collect();
        let mask = LabelMask {
            width: given.width as u32,
            height: given.height as u32,
            ids: best.iter().map(|&(map, _)| id(map)).collect(),
        };
        Self {
            mask,
            confidence,
            known: given.labels.iter().copied().collect(),
            probabilities: Some(given),
        }
    }

    /// Merges the results of two passes for a frame.
    ///
    /// This one has weight `nearness`, `second` has the rest. Where the masks differ, the more
    /// probable label wins. This pass's label is assumed to have its mean probability everywhere,
    /// because only the second pass still has its probabilities. A pass has no vote on labels that
    /// it does not track.
    pub fn merged(&self, second: &Self, nearness: f32) -> Self {
        let pairs = self.mask.ids.par_iter().zip(&second.mask.ids).enumerate();
        let ids = pairs.map(|(at, (&a, &b))| {
            if a == b || !second.knows(a) && b == LabelId::NONE {
                return a;
            }
            if !self.knows(b) && a == LabelId::NONE {
                return b;
            }
            let there = |label: LabelId| {
                let given = second.probabilities.as_ref();
                given.map_or(0.0, |given| given.at(label, at))
            };
            let for_a = nearness * self.confidence_of(a) + (1.0 - nearness) * there(a);
            if for_a >= (1.0 - nearness) * there(b) {
                a
            } else {
                b
            }
        });
        let mask = LabelMask {
            ids: ids.collect(),
            ..self.mask
        };
        let agreed = RunMask::encode(&self.mask).ious(&RunMask::encode(&second.mask));
        let confidence = |label: LabelId| match (self.knows(label), second.knows(label)) {
            (true, true) => {
                let mean = nearness * self.confidence_of(label)
                    + (1.0 - nearness) * second.confidence_of(label);
                mean * (0.5 + 0.5 * agreed.get(&label).copied().unwrap_or(0.0) as f32)
            }
            (true, false) => self.confidence_of(label),
            (false, _) => second.confidence_of(label),
        };
        let shown = shown_labels(&mask).into_iter();
        Self {
            confidence: shown.map(|label| (label, confidence(label))).collect(),
            mask,
            known: self.known.union(&second.known).copied().collect(),
            probabilities: None,
        }
    }

    fn knows(&self, label: LabelId) -> bool {
        label == LabelId::NONE || self.known.contains(&label)
    }

    fn confidence_of(&self, label: LabelId) -> f32 {
        self.confidence.get(&label).copied().unwrap_or(0.0)
    }
}

/// A result of the forward pass, stored compactly for the backward pass.
pub(super) struct KeptResult {
    runs: RunMask,
    confidence: BTreeMap<LabelId, f32>,
    known: BTreeSet<LabelId>,
}

impl KeptResult {
    pub fn new(answer: PassResult) -> Self {
        Self {
            runs: RunMask::encode(&answer.mask),
            confidence: answer.confidence,
            known: answer.known,
        }
    }

    pub fn mask(&self) -> LabelMask {
        self.runs.decode()
    }

    pub fn unpacked(self) -> PassResult {
        PassResult {
            mask: self.runs.decode(),
            confidence: self.confidence,
            known: self.known,
            probabilities: None,
        }
    }
}

/// Returns the labels that a mask shows.
pub(crate) fn shown_labels(mask: &LabelMask) -> BTreeSet<LabelId> {
    let mut last = LabelId::NONE;
    let mut labels = BTreeSet::new();
    for &id in mask.ids.iter().filter(|&&id| id != LabelId::NONE) {
        if std::mem::replace(&mut last, id) != id {
            labels.insert(id);
        }
    }
    labels
}
