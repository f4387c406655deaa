use std::collections::BTreeMap;

use rayon::prelude::*;

use super::answer::Answer;
use super::seam::Propagated;
use ostra_masks::{LabelId, LabelMask, RunMask};

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
    let shown = super::course::labels(&mask);
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
