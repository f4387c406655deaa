use std::collections::BTreeSet;
use std::sync::Arc;

use super::options::CarryOptions;
use super::viewpoint::Viewpoint;
use crate::frames::DepthMap;
use crate::masks::{LabelId, LabelMask};

/// A frame whose mask is held fixed, ready to be asked.
#[derive(Debug)]
pub struct Anchor {
    /// With holes of the depth filled from other frames.
    pub view: Viewpoint,
    /// The frame's own depth, with holes.
    pub own: Arc<DepthMap>,
    pub mask: Arc<LabelMask>,
    /// Labels of the mask, in order.
    pub labels: Vec<LabelId>,
    /// Weight of each pixel's label, 0–1.
    pub trust: Vec<f32>,
}

/// The labels in a mask, in order, without 0.
pub fn labels_of(mask: &LabelMask) -> Vec<LabelId> {
    let runs = mask.ids.chunk_by(|a, b| a == b).map(|run| run[0]);
    runs.filter(|&id| id != LabelId::NONE).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Weights that grow from the border of labels inwards and outwards: there mask, picture and depth are a few pixels apart.
pub fn trust(mask: &LabelMask, options: &CarryOptions) -> Vec<f32> {
    let (width, border) = (mask.width as usize, options.border_px);
    let mut distance = vec![border; mask.ids.len()];
    for at in 0..mask.ids.len() {
        let ends_row = (at + 1) % width.max(1) == 0;
        for next in [(!ends_row).then_some(at + 1), Some(at + width)].into_iter().flatten() {
            if mask.ids.get(next).is_some_and(|&id| id != mask.ids[at]) {
                (distance[at], distance[next]) = (0, 0);
            }
        }
    }
    for at in 0..distance.len() {
        let left = if at % width == 0 { border } else { distance[at - 1] };
        let above = if at < width { border } else { distance[at - width] };
        distance[at] = distance[at].min(left.min(above).saturating_add(1));
    }
    for at in (0..distance.len()).rev() {
        let right = if (at + 1) % width == 0 { border } else { distance[at + 1] };
        let below = if at + width >= distance.len() { border } else { distance[at + width] };
        distance[at] = distance[at].min(right.min(below).saturating_add(1));
    }
    let weight = |d: u8| options.border_weight + (1.0 - options.border_weight) * f32::from(d) / f32::from(border.max(1));
    distance.into_iter().map(|d| if border == 0 { 1.0 } else { weight(d) }).collect()
}
