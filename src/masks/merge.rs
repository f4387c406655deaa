use std::collections::{BTreeMap, BTreeSet};

use super::{LabelId, LabelMask, Region, squared_depth_in, squared_distance_to};

/// Maximum distance from an outline, in pixels; larger distances are clamped.
const MOST_PX: f32 = 24.0;
/// Minimum IoU at which two masks of a label are blended; below it they are not the same outline.
const SAME_OUTLINE: f64 = 0.3;
/// Lower bound of the confidence and nearness factors.
const LEAST: f32 = 1e-3;

/// Result of propagation from one keyframe on a frame.
#[derive(Debug, Clone)]
pub struct WalkedFrame {
    /// Propagated mask.
    pub mask: LabelMask,
    /// Confidence of every label that the propagation knows, 0–1.
    pub confidence: BTreeMap<LabelId, f32>,
}

/// Merges the masks of two propagations that met on a frame.
///
/// The merged outline lies between the two outlines, closer to the one with the higher confidence
/// and the nearer keyframe. Shapes are blended as signed distances (Raya, Udupa, "Shape-based
/// interpolation of multidimensional objects", IEEE Transactions on Medical Imaging, 1990). If the
/// two hardly overlap, one of them has drifted, and the one with the larger weight is taken, since
/// an outline in between would match neither.
///
/// `nearness` is that of the first, 0–1; it grows towards its keyframe.
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
        // A propagation that does not know the label has no vote: its keyframe may not have been
        // checked for it.
        let of = |frame: &WalkedFrame, near: f32| {
            let confidence = frame.confidence.get(&label).copied();
            (
                confidence.unwrap_or(0.0),
                confidence.map_or(0.0, |confidence| {
                    confidence.max(LEAST) * near.powi(2).max(LEAST)
                }),
            )
        };
        let ((confidence_a, wa), (confidence_b, wb)) =
            (of(first, nearness), of(second, 1.0 - nearness));
        let overlap = a.iou(&b);
        let has_drifted = !(a.is_empty() || b.is_empty()) && overlap < SAME_OUTLINE;
        let share = if has_drifted {
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
        confidence.insert(label, confidence_a.max(confidence_b) * agreed);
    }
    WalkedFrame { mask, confidence }
}

/// Returns the signed distance to the region's outline: positive inside, clamped to ±24 px.
fn signed_distances(region: &Region) -> Vec<f32> {
    let root = |squared: u32| (squared as f32).sqrt().min(MOST_PX);
    let (inside, outside) = (squared_depth_in(region), squared_distance_to(region));
    inside
        .into_iter()
        .zip(outside)
        .map(|(inside, outside)| root(inside) - root(outside))
        .collect()
}
