use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::options::ConstrainOptions;
use crate::carry::Testimony;
use ostra_cloud::doubt::Sighted;
use ostra_masks::{LabelId, LabelMask};

/// What geometry is sure of in each pixel of a tracker's mask; `None` where it abstains, as it does of objects that moved.
pub fn judge(testimony: &Testimony, tracked: &LabelMask, options: &ConstrainOptions) -> Sighted {
    let verdict = |(at, &held): (usize, &LabelId)| {
        testimony.verdict(at, held, options.sure_share, options.least_weight)
    };
    let labels: Vec<Option<LabelId>> = tracked.ids.par_iter().enumerate().map(verdict).collect();
    let mut sighted = Sighted {
        width: tracked.width,
        height: tracked.height,
        labels,
    };
    let moved = moved(testimony, tracked, &sighted, options);
    if !moved.is_empty() {
        for (verdict, held) in sighted.labels.iter_mut().zip(&tracked.ids) {
            *verdict = verdict.filter(|label| !moved.contains(label) && !moved.contains(held));
        }
    }
    sighted
}

/// Labels that the tracker sees where nothing was when the anchors were taken, more than geometry finds them in place.
fn moved(
    testimony: &Testimony,
    tracked: &LabelMask,
    sighted: &Sighted,
    options: &ConstrainOptions,
) -> BTreeSet<LabelId> {
    let mut counts: BTreeMap<LabelId, [usize; 2]> = BTreeMap::new();
    for (at, (&held, verdict)) in tracked.ids.iter().zip(&sighted.labels).enumerate() {
        if let Some(label) = verdict.filter(|&label| label != LabelId::NONE) {
            counts.entry(label).or_default()[1] += 1;
        }
        if held != LabelId::NONE && testimony.is_new(at) {
            counts.entry(held).or_default()[0] += 1;
        }
    }
    let has_moved =
        |&(_, [new, in_place]): &(LabelId, [usize; 2])| new >= options.least_area && new > in_place;
    counts
        .into_iter()
        .filter(has_moved)
        .map(|(label, _)| label)
        .collect()
}
