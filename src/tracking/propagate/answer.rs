use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask, MaskError, RunMask};

/// A network that carries masks from one picture to the next, in one direction; made anew for each walk through the frames.
pub(crate) trait Propagator {
    /// Takes the labels of `mask` on `image` as given: the first picture of the walk, a later anchor, or one on which labels
    /// appear for the first time. Labels that `mask` does not show keep what was remembered of them.
    fn remember(&mut self, image: &Image, mask: &LabelMask) -> Result<(), MaskError>;

    /// The next picture of the walk.
    fn propagate(&mut self, image: &Image) -> Result<Propagated, MaskError>;
}

/// Where a network sees the labels in a picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Propagated {
    /// The labels, ascending.
    pub labels: Vec<LabelId>,
    /// Size of the maps, px: the picture's own size.
    pub width: usize,
    pub height: usize,
    /// `[1 + labels][height][width]`, row by row: the probability of nothing, then of each label; they sum to 1.
    pub probabilities: Vec<f32>,
}

/// What one walk says of a frame.
pub(super) struct Answer {
    pub mask: LabelMask,
    /// Of nothing and of each label that the mask shows, the mean probability where it shows it.
    pub confidence: BTreeMap<LabelId, f32>,
    /// The labels that the walk knows: of others it says nothing.
    pub known: BTreeSet<LabelId>,
}

/// Pixels that a thread takes at once.
const BLOCK: usize = 1 << 14;

impl Answer {
    /// The most probable label of every pixel; of equals the first.
    pub fn new(given: &Propagated) -> Self {
        let area = given.width * given.height;
        let blocks = (0..area).into_par_iter().step_by(BLOCK).map(|first| {
            let pixels = first..(first + BLOCK).min(area);
            pixels
                .map(|at| best(given.probabilities[at..].iter().step_by(area)))
                .collect::<Vec<_>>()
        });
        let best: Vec<(usize, f32)> = blocks.flatten_iter().collect();
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
        let ids = best.iter().map(|&(map, _)| id(map)).collect();
        let mask = LabelMask {
            width: given.width as u32,
            height: given.height as u32,
            ids,
        };
        Self {
            mask,
            confidence,
            known: given.labels.iter().copied().collect(),
        }
    }

    /// Of the labels that the mask shows.
    pub fn confidences(&self) -> BTreeMap<LabelId, f32> {
        self.confidence
            .iter()
            .filter(|(label, _)| **label != LabelId::NONE)
            .map(|(&label, &sure)| (label, sure))
            .collect()
    }
}

fn best<'a>(probabilities: impl Iterator<Item = &'a f32>) -> (usize, f32) {
    probabilities
        .enumerate()
        .fold((0, f32::NEG_INFINITY), |best, (map, &p)| {
            if p > best.1 { (map, p) } else { best }
        })
}

/// One answer out of those of two walks that met on a frame, `first` counting `nearness` of 1 and `second` the rest. Where
/// they differ, the label that is the more probable counts; the first walk's is taken to be as probable everywhere as it is
/// on average. What a walk does not know it says nothing of.
pub(super) fn merged(first: &Answer, second: &Answer, given: &Propagated, nearness: f32) -> Answer {
    let area = given.width * given.height;
    let known = first.known.union(&second.known).copied().collect();
    let pairs = first.mask.ids.par_iter().zip(&second.mask.ids).enumerate();
    let ids = pairs.map(|(at, (&a, &b))| {
        if a == b || !second.knows(a) && b == LabelId::NONE {
            return a;
        }
        if !first.knows(b) && a == LabelId::NONE {
            return b;
        }
        let there = |label: LabelId| match given.labels.binary_search(&label) {
            Ok(place) => given.probabilities[(1 + place) * area + at],
            Err(_) if label == LabelId::NONE => given.probabilities[at],
            Err(_) => 0.0,
        };
        let for_a = nearness * first.sure(a) + (1.0 - nearness) * there(a);
        if for_a >= (1.0 - nearness) * there(b) {
            a
        } else {
            b
        }
    });
    let mask = LabelMask {
        ids: ids.collect(),
        ..first.mask
    };
    let agreed = RunMask::encode(&first.mask).ious(&RunMask::encode(&second.mask));
    let shown = labels(&mask);
    let confidence: BTreeMap<LabelId, f32> = shown
        .into_iter()
        .map(|label| {
            let sure = match (first.knows(label), second.knows(label)) {
                (true, true) => {
                    let mean = nearness * first.sure(label) + (1.0 - nearness) * second.sure(label);
                    mean * (0.5 + 0.5 * agreed.get(&label).copied().unwrap_or(0.0) as f32)
                }
                (true, false) => first.sure(label),
                (false, _) => second.sure(label),
            };
            (label, sure)
        })
        .collect();
    Answer {
        mask,
        confidence,
        known,
    }
}

impl Answer {
    fn knows(&self, label: LabelId) -> bool {
        label == LabelId::NONE || self.known.contains(&label)
    }

    fn sure(&self, label: LabelId) -> f32 {
        self.confidence.get(&label).copied().unwrap_or(0.0)
    }
}

/// The labels that a mask shows.
pub(super) fn labels(mask: &LabelMask) -> BTreeSet<LabelId> {
    let mut last = LabelId::NONE;
    let mut labels = BTreeSet::new();
    for &id in mask.ids.iter().filter(|&&id| id != LabelId::NONE) {
        if std::mem::replace(&mut last, id) != id {
            labels.insert(id);
        }
    }
    labels
}
