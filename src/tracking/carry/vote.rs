use std::collections::BTreeMap;
use std::sync::Arc;

use super::anchor::Anchor;
use super::pixel_box::PixelBox;
use super::sightings::Sightings;
use ostra_masks::LabelId;

/// What the chosen anchors say of one target.
#[derive(Debug)]
pub struct Votes {
    pub width: usize,
    pub height: usize,
    pub of_anchors: Vec<(Arc<Anchor>, Sightings)>,
}

impl Votes {
    /// For each label that some pixel was given, the box around those pixels.
    pub fn boxes(&self) -> BTreeMap<LabelId, PixelBox> {
        let mut boxes: BTreeMap<LabelId, PixelBox> = BTreeMap::new();
        for (_, sightings) in &self.of_anchors {
            for at in 0..self.width * self.height {
                let Some((label, _)) = sightings
                    .at(at)
                    .filter(|&(label, _)| label != LabelId::NONE)
                else {
                    continue;
                };
                let pixel = PixelBox::pixel(at % self.width, at / self.width);
                boxes
                    .entry(label)
                    .and_modify(|around| *around = around.union(&pixel))
                    .or_insert(pixel);
            }
        }
        boxes
    }

    /// The weights for `shown` being at a pixel, and all, by those that bear on `label` there.
    pub fn at(&self, pixel: usize, label: LabelId, shown: LabelId) -> [f32; 2] {
        let mut sums = [0.0; 2];
        for (anchor, sightings) in &self.of_anchors {
            if let Some((seen, by)) = sightings
                .at(pixel)
                .filter(|&(seen, _)| anchor.bears_on(label, seen))
            {
                sums[0] += if seen == shown { by } else { 0.0 };
                sums[1] += by;
            }
        }
        sums
    }

    /// For each pixel of a box the weights for `label` less those against it, and their sum.
    pub fn of(&self, label: LabelId, within: PixelBox) -> Vec<[f32; 2]> {
        let mut votes = vec![[0.0; 2]; within.width() * within.height()];
        for (anchor, sightings) in &self.of_anchors {
            for (y, row) in (within.top..within.bottom).zip(votes.chunks_exact_mut(within.width()))
            {
                for (x, [balance, weight]) in (within.left..within.right).zip(row) {
                    let Some((seen, by)) = sightings.at(y * self.width + x) else {
                        continue;
                    };
                    if anchor.bears_on(label, seen) {
                        *balance += if seen == label { by } else { -by };
                        *weight += by;
                    }
                }
            }
        }
        votes
    }
}
