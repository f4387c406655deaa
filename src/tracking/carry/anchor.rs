use std::collections::BTreeSet;
use std::sync::Arc;

use super::options::CarryOptions;
use super::viewpoint::Viewpoint;
use ostra_frames::DepthMap;
use ostra_masks::{LabelId, LabelMask};

/// A frame whose mask is held fixed, ready to be asked.
#[derive(Debug)]
pub struct Anchor {
    /// With holes of the depth filled from other frames.
    pub view: Viewpoint,
    pub mask: Arc<LabelMask>,
    /// Labels of the mask, in order.
    pub labels: Vec<LabelId>,
    /// How far each pixel's label is to be trusted, 0–1.
    pub trust: Vec<f32>,
}

impl Anchor {
    /// `filled` is the depth of `own` with holes filled.
    pub fn new(
        own: Viewpoint,
        filled: DepthMap,
        mask: Arc<LabelMask>,
        options: &CarryOptions,
    ) -> Self {
        let mut trust = border_trust(&mask, options);
        for (at, trust) in trust.iter_mut().enumerate() {
            let filled = if own.depth.depths[at] > 0.0 {
                1.0
            } else {
                options.filled_weight
            };
            *trust *= filled * facing(&own, at).max(options.grazing_weight);
        }
        Self {
            view: Viewpoint {
                depth: Arc::new(filled),
                ..own
            },
            labels: labels_of(&mask),
            mask,
            trust,
        }
    }

    /// Whether its showing `seen` somewhere says anything of `label` there. An anchor without the label speaks against it
    /// only where it shows another one: nobody may have looked for the label there.
    pub fn bears_on(&self, label: LabelId, seen: LabelId) -> bool {
        seen != LabelId::NONE || label == LabelId::NONE || self.labels.binary_search(&label).is_ok()
    }
}

/// The labels in a mask, in order, without 0.
pub fn labels_of(mask: &LabelMask) -> Vec<LabelId> {
    let runs = mask.ids.chunk_by(|a, b| a == b).map(|run| run[0]);
    runs.filter(|&id| id != LabelId::NONE)
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect()
}

/// Weights that grow from the border of labels inwards and outwards: there mask, picture and depth are a few pixels apart.
fn border_trust(mask: &LabelMask, options: &CarryOptions) -> Vec<f32> {
    let border = options.border_px;
    let weight = |d: u8| {
        options.border_weight
            + (1.0 - options.border_weight) * f32::from(d) / f32::from(border.max(1))
    };
    let weights: [f32; 256] =
        std::array::from_fn(|d| if border == 0 { 1.0 } else { weight(d as u8) });
    border_distance(mask, border)
        .into_iter()
        .map(|d| weights[usize::from(d)])
        .collect()
}

/// Steps to the nearest pixel that has a neighbour of another label, up to `most`.
fn border_distance(mask: &LabelMask, most: u8) -> Vec<u8> {
    let width = mask.width as usize;
    let mut distance = vec![most; mask.ids.len()];
    for at in 0..mask.ids.len() {
        let right = ((at + 1) % width != 0).then_some(at + 1);
        let below = (at + width < mask.ids.len()).then_some(at + width);
        for next in [right, below]
            .into_iter()
            .flatten()
            .filter(|&next| mask.ids[next] != mask.ids[at])
        {
            (distance[at], distance[next]) = (0, 0);
        }
    }
    for at in 0..distance.len() {
        let left = if at % width == 0 {
            most
        } else {
            distance[at - 1]
        };
        let above = if at < width {
            most
        } else {
            distance[at - width]
        };
        distance[at] = distance[at].min(left.min(above).saturating_add(1));
    }
    for at in (0..distance.len()).rev() {
        let right = if (at + 1) % width == 0 {
            most
        } else {
            distance[at + 1]
        };
        let below = if at + width >= distance.len() {
            most
        } else {
            distance[at + width]
        };
        distance[at] = distance[at].min(right.min(below).saturating_add(1));
    }
    distance
}

/// Cosine of the angle between a surface and the view of it, from the slope of the depth; 1 where no slope is known.
fn facing(view: &Viewpoint, at: usize) -> f32 {
    let (width, height) = (view.width(), view.height());
    let depth = &view.depth.depths;
    let (x, y, here) = (at % width, at / width, depth[at]);
    if x == 0 || y == 0 || x + 1 >= width || y + 1 >= height || here <= 0.0 {
        return 1.0;
    }
    let slope = |a: f32, b: f32| {
        if a > 0.0 && b > 0.0 {
            0.5 * (b - a) / here
        } else {
            0.0
        }
    };
    let focal = view.stand.camera.focal_px.as_vec2();
    let across = focal.x * slope(depth[at - 1], depth[at + 1]);
    let down = focal.y * slope(depth[at - width], depth[at + width]);
    (1.0 + across * across + down * down).sqrt().recip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_are_trusted_less() {
        let mut mask = LabelMask::empty(9, 5);
        mask.ids
            .iter_mut()
            .enumerate()
            .filter(|(at, _)| at % 9 < 4)
            .for_each(|(_, id)| *id = LabelId(7));
        let row: Vec<u8> = border_distance(&mask, 3)[18..27].to_vec();
        assert_eq!(row, [3, 2, 1, 0, 0, 1, 2, 3, 3]);
        let trust = border_trust(
            &mask,
            &CarryOptions {
                border_weight: 0.25,
                border_px: 3,
                ..CarryOptions::default()
            },
        );
        assert_eq!((trust[18], trust[21], trust[20]), (1.0, 0.25, 0.5));
        assert!(
            border_trust(
                &mask,
                &CarryOptions {
                    border_px: 0,
                    ..CarryOptions::default()
                }
            )
            .iter()
            .all(|&t| t == 1.0)
        );
        assert_eq!(labels_of(&mask), [LabelId(7)]);
    }
}
