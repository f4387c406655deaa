use std::collections::{BTreeMap, BTreeSet};

use super::walk::WalkedFrame;
use crate::masks::{LabelId, LabelMask, Region, squared_depth_in, squared_distance_to};

/// Distances from an outline count up to this, in pixels of the working size.
const MOST_PX: f32 = 24.0;

/// One mask out of two walks that met on a frame: between their outlines, nearer to the one that is surer and whose
/// anchor is nearer (shapes as signed distances: Raya, Udupa, "Shape-based interpolation of multidimensional objects",
/// IEEE Transactions on Medical Imaging, 1990). `nearness` of the first, 0–1, grows towards its anchor.
pub(super) fn merged(first: &WalkedFrame, second: &WalkedFrame, nearness: f32) -> WalkedFrame {
    let labels: BTreeSet<LabelId> = first.confidence.keys().chain(second.confidence.keys()).copied().collect();
    let (width, height) = (first.mask.width, first.mask.height);
    let mut mask = LabelMask::empty(width, height);
    let mut best = vec![0.0f32; mask.ids.len()];
    let mut confidence = BTreeMap::new();
    for label in labels {
        let (a, b) = (first.mask.region(label), second.mask.region(label));
        // A walk that does not know the label says that its anchor does not show it, which holds near the anchor.
        let of = |frame: &WalkedFrame| frame.confidence.get(&label).copied();
        let weight = |own: Option<f32>, near: f32| own.unwrap_or(1.0).max(1e-3) * near.powi(2);
        let (wa, wb) = (weight(of(first), nearness), weight(of(second), 1.0 - nearness));
        let share = wa / (wa + wb).max(1e-9);
        let (da, db) = (signed_distances(&a), signed_distances(&b));
        for (at, (da, db)) in da.iter().zip(&db).enumerate() {
            let distance = share * da + (1.0 - share) * db;
            if distance > best[at] {
                best[at] = distance;
                mask.ids[at] = label;
            }
        }
        let sure = of(first).unwrap_or(0.0).max(of(second).unwrap_or(0.0));
        confidence.insert(label, sure * (0.5 + 0.5 * a.iou(&b) as f32));
    }
    WalkedFrame { mask, confidence }
}

/// Distance from the region's outline: above 0 inside, below outside, within ±24 px.
fn signed_distances(region: &Region) -> Vec<f32> {
    let root = |squared: u32| (squared as f32).sqrt().min(MOST_PX);
    let (inside, outside) = (squared_depth_in(region), squared_distance_to(region));
    inside.into_iter().zip(outside).map(|(inside, outside)| root(inside) - root(outside)).collect()
}
