use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::seam::Propagated;
use ostra_masks::{LabelId, LabelMask};

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
