use std::collections::BTreeMap;

use super::options::CarryOptions;
use super::pixel_box::PixelBox;
use super::refine::{belonging, passing};
use super::tolerance::Tolerance;
use super::viewpoint::Viewpoint;
use super::vote::Votes;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask};

/// The mask of a target and how sure each label in it is, 0–1. `depths` are its own with what anchors show in its holes.
pub fn decide(
    votes: &Votes,
    (target, depths): (&Viewpoint, &[f32]),
    image: &Image,
    options: &CarryOptions,
    progress: &Progress,
) -> Result<(LabelMask, BTreeMap<LabelId, f32>), Stopped> {
    let mut mask = LabelMask::empty(image.width, image.height);
    let mut best = vec![0.0f32; mask.ids.len()];
    let boxes: BTreeMap<LabelId, PixelBox> = (votes.boxes().into_iter())
        .map(|(label, around)| {
            (
                label,
                around.grown(options.margin_px, votes.width, votes.height),
            )
        })
        .collect();
    let Some(all) = boxes.values().copied().reduce(|a, b| a.union(&b)) else {
        return Ok((mask, BTreeMap::new()));
    };
    let passing = passing(
        image,
        depths,
        all,
        &Tolerance::most(target, options),
        options,
    );
    for (label, within) in boxes {
        progress.check()?;
        let part = passing.part(
            within.left - all.left,
            within.top - all.top,
            within.width(),
            within.height(),
        );
        let belonging = belonging(&votes.of(label, within), part, options);
        lay_over(&belonging, label, within, &mut mask, &mut best);
    }
    let confidence = confidence(&mask, &best);
    Ok((mask, confidence))
}

/// Gives the label the pixels that belong to it more than to the labels before.
fn lay_over(
    belonging: &[f32],
    label: LabelId,
    within: PixelBox,
    mask: &mut LabelMask,
    best: &mut [f32],
) {
    let full = mask.width as usize;
    for (y, row) in (within.top..within.bottom).zip(belonging.chunks_exact(within.width())) {
        for (at, &share) in (y * full + within.left..).zip(row) {
            if share > best[at] {
                (mask.ids[at], best[at]) = (label, share);
            }
        }
    }
}

/// Per label the mean of how far its pixels belong to it.
fn confidence(mask: &LabelMask, best: &[f32]) -> BTreeMap<LabelId, f32> {
    let mut sums: BTreeMap<LabelId, (f64, f64)> = BTreeMap::new();
    for (ids, shares) in mask
        .ids
        .iter()
        .zip(best)
        .filter(|&(&id, _)| id != LabelId::NONE)
    {
        let (sum, count) = sums.entry(*ids).or_default();
        *sum += f64::from(*shares);
        *count += 1.0;
    }
    sums.into_iter()
        .map(|(id, (sum, count))| (id, (sum / count).clamp(0.0, 1.0) as f32))
        .collect()
}
