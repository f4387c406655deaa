use ostra_cloud::conflicts::{MaskedFrame, frame_conflict, voted_mask};
use ostra_cloud::fuse::Fused;
use ostra_masks::{LabelId, LabelMask};

use super::Rendered;
use crate::synthetic::SceneOptions;

/// The synthetic plant with organ labels; the masks of some frames are corrupted.
struct Plant {
    rendered: Rendered,
    truth: Vec<LabelMask>,
}

impl Plant {
    fn new() -> Self {
        let options = SceneOptions {
            views: 12,
            width: 360,
            height: 480,
            ..SceneOptions::default()
        };
        let rendered = Rendered::new(&options, Some(2));
        Self {
            truth: rendered.masks.clone(),
            rendered,
        }
    }

    /// Returns the frames by conflict between mask and vote, the highest first.
    fn ranked(&self, fused: &Fused) -> Vec<(usize, f32)> {
        let masks = &self.rendered.masks;
        let share =
            |frame| frame_conflict(&fused.votes, &fused.cloud.labels, frame, &masks[frame]).share();
        let mut ranked: Vec<(usize, f32)> = (0..masks.len())
            .map(|frame| (frame, share(frame)))
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        ranked
    }

    fn iou(&self, mask: &LabelMask, frame: usize, label: LabelId) -> f64 {
        let pairs = || {
            mask.ids
                .iter()
                .zip(&self.truth[frame].ids)
                .map(|(&a, &b)| (a == label, b == label))
        };
        pairs().filter(|(a, b)| *a && *b).count() as f64
            / pairs().filter(|(a, b)| *a || *b).count() as f64
    }
}

/// Frames whose masks are corrupted, in three ways.
const SPOILT: [usize; 5] = [1, 4, 5, 8, 10];

/// Removes the stems, relabels them as leaf, or shifts all leaves by nine pixels.
fn spoilt(mask: &LabelMask, way: usize, stem: LabelId, leaf: LabelId) -> LabelMask {
    let width = mask.width as usize;
    let ids = (0..mask.ids.len()).map(|at| match (way, mask.ids[at]) {
        (0, id) if id == stem => LabelId::NONE,
        (1, id) if id == stem => leaf,
        (2, id) => {
            let moved = if at % width >= 9 {
                mask.ids[at - 9]
            } else {
                LabelId::NONE
            };
            if moved == leaf || id == leaf {
                if moved == leaf { leaf } else { LabelId::NONE }
            } else {
                id
            }
        }
        (_, id) => id,
    });
    LabelMask {
        ids: ids.collect(),
        ..*mask
    }
}

#[test]
fn corrupted_masks_rank_first_and_the_vote_repairs_them() {
    let mut plant = Plant::new();
    let (stem, leaf) = (plant.rendered.label("stem"), plant.rendered.label("leaf"));
    let sound = plant.ranked(&plant.rendered.fused());
    assert!(sound[0].1 < 0.02, "true masks agree: {sound:?}");
    for (at, &frame) in SPOILT.iter().enumerate() {
        plant.rendered.masks[frame] = spoilt(&plant.truth[frame], at % 3, stem, leaf);
    }
    let fused = plant.rendered.fused();
    let ranked = plant.ranked(&fused);
    let mut first: Vec<usize> = ranked[..5].iter().map(|(frame, _)| *frame).collect();
    first.sort_unstable();
    assert_eq!(first, SPOILT, "{ranked:?}");
    assert!(ranked[4].1 > 2.0 * ranked[5].1, "clearly: {ranked:?}");
    for frame in SPOILT {
        let masked = MaskedFrame {
            number: frame,
            frame: &plant.rendered.frames[frame],
            depth: Some(&plant.rendered.views[frame].depth),
            mask: &plant.rendered.masks[frame],
        };
        let mask = voted_mask(&fused.cloud, &fused.votes, &masked, &[]).unwrap();
        for label in [stem, leaf, plant.rendered.label("panicle")] {
            let iou = plant.iou(&mask, frame, label);
            assert!(iou >= 0.97, "frame {frame}, label {label:?}: {iou}");
        }
    }
}

#[test]
fn single_label_is_repaired_on_a_frame_without_depth() {
    let mut plant = Plant::new();
    let (stem, leaf) = (plant.rendered.label("stem"), plant.rendered.label("leaf"));
    plant.rendered.masks[4] = spoilt(&plant.truth[4], 1, stem, leaf);
    // The panicle is missing too, but is not requested.
    let panicle = plant.rendered.label("panicle");
    plant.rendered.masks[4]
        .ids
        .iter_mut()
        .filter(|id| **id == panicle)
        .for_each(|id| *id = LabelId::NONE);
    let fused = plant.rendered.fused();
    let masked = MaskedFrame {
        number: 4,
        frame: &plant.rendered.frames[4],
        depth: None,
        mask: &plant.rendered.masks[4],
    };
    let mask = voted_mask(&fused.cloud, &fused.votes, &masked, &[stem]).unwrap();
    assert!(
        plant.iou(&mask, 4, stem) > 0.85,
        "{}",
        plant.iou(&mask, 4, stem)
    );
    assert!(!mask.ids.contains(&panicle));
    let mut other = fused.votes.clone();
    other = other.select(&[0, 1]);
    assert!(voted_mask(&fused.cloud, &other, &masked, &[]).is_err());
}
