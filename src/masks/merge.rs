use std::collections::{BTreeMap, BTreeSet};

use super::{LabelId, LabelMask, Region, squared_depth_in, squared_distance_to};

/// Distances from an outline count up to this, in pixels.
const MOST_PX: f32 = 24.0;
/// Two masks of an object that share less (IoU) are not two sights of one outline, with others in between.
const SAME_OUTLINE: f64 = 0.3;
/// Least confidence and nearness that count.
const LEAST: f32 = 1e-3;

/// What a walk from an anchor, frame after frame, says of a frame.
#[derive(Debug, Clone)]
pub struct WalkedFrame {
    /// Its mask.
    pub mask: LabelMask,
    /// Of every label that the walk knows, how sure it is, 0–1.
    pub confidence: BTreeMap<LabelId, f32>,
}

/// One mask out of two walks that met on a frame: between their outlines, nearer to the one that is surer and whose
/// anchor is nearer (shapes as signed distances: Raya, Udupa, "Shape-based interpolation of multidimensional objects",
/// IEEE Transactions on Medical Imaging, 1990). Where the two hardly meet, one of them strayed and the one that counts more
/// stands, since between them lies nothing. `nearness` of the first, 0–1, grows towards its anchor.
#[must_use]
pub fn merged(first: &WalkedFrame, second: &WalkedFrame, nearness: f32) -> WalkedFrame {
    let labels: BTreeSet<LabelId> = first
        .confidence
        .keys()
        .chain(second.confidence.keys())
        .copied()
        .collect();
    let (width, height) = (first.mask.width, first.mask.height);
    let mut mask = LabelMask::empty(width, height);
    let mut best = vec![0.0f32; mask.ids.len()];
    let mut confidence = BTreeMap::new();
    for label in labels {
        let (a, b) = (first.mask.region(label), second.mask.region(label));
        // A walk that does not know the label says nothing of it: nobody may have looked for it in that anchor.
        let of = |frame: &WalkedFrame, near: f32| {
            let sure = frame.confidence.get(&label).copied();
            (
                sure.unwrap_or(0.0),
                sure.map_or(0.0, |sure| sure.max(LEAST) * near.powi(2).max(LEAST)),
            )
        };
        let ((sure_a, wa), (sure_b, wb)) = (of(first, nearness), of(second, 1.0 - nearness));
        let overlap = a.iou(&b);
        let strayed = !(a.is_empty() || b.is_empty()) && overlap < SAME_OUTLINE;
        let share = if strayed {
            f32::from(u8::from(wa >= wb))
        } else {
            wa / (wa + wb)
        };
        let (da, db) = rayon::join(|| signed_distances(&a), || signed_distances(&b));
        for (at, (da, db)) in da.iter().zip(&db).enumerate() {
            let distance = share * da + (1.0 - share) * db;
            if distance > best[at] {
                best[at] = distance;
                mask.ids[at] = label;
            }
        }
        let agreed = if wa * wb > 0.0 {
            0.5 + 0.5 * overlap as f32
        } else {
            1.0
        };
        confidence.insert(label, sure_a.max(sure_b) * agreed);
    }
    WalkedFrame { mask, confidence }
}

/// Distance from the region's outline: above 0 inside, below outside, within ±24 px.
fn signed_distances(region: &Region) -> Vec<f32> {
    let root = |squared: u32| (squared as f32).sqrt().min(MOST_PX);
    let (inside, outside) = (squared_depth_in(region), squared_distance_to(region));
    inside
        .into_iter()
        .zip(outside)
        .map(|(inside, outside)| root(inside) - root(outside))
        .collect()
}
