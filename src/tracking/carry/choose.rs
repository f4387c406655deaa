use std::collections::BTreeMap;

use glam::Vec3;

use super::viewpoint::{Passage, Stand, Viewpoint};
use ostra_masks::LabelId;

/// Points of a frame looked for in another one, along each side.
const GRID: usize = 16;

/// The anchors to ask about a target, as places in `anchors`: for every label the `most` that see most of the target,
/// from the nearest and from the most similar direction.
pub fn anchors_for(target: &Viewpoint, anchors: &[(Stand, &[LabelId])], most: usize) -> Vec<usize> {
    let points = target.grid(GRID);
    let overlap: Vec<f32> = anchors
        .iter()
        .map(|(stand, _)| overlap(&target.stand, &points, stand))
        .collect();
    let mut of_label: BTreeMap<LabelId, Vec<usize>> = BTreeMap::new();
    for place in (0..anchors.len()).filter(|&place| overlap[place] > 0.0) {
        for &label in anchors[place].1 {
            of_label.entry(label).or_default().push(place);
        }
    }
    let mut chosen: Vec<usize> = Vec::new();
    for mut places in of_label.into_values() {
        places.sort_by(|&a, &b| overlap[b].total_cmp(&overlap[a]).then(a.cmp(&b)));
        chosen.extend(places.iter().take(most));
    }
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}

/// Of all frames up to `most` that see the same surfaces as `view`, from the most similar direction to the most
/// different: a hole is often seen well from far aside.
pub fn fillers_for(
    view: &Viewpoint,
    frames: impl Iterator<Item = (usize, Stand)>,
    most: usize,
) -> Vec<usize> {
    let points = view.grid(GRID);
    let mut seen: Vec<(f32, usize)> = frames
        .map(|(frame, stand)| (overlap(&view.stand, &points, &stand), frame))
        .filter(|&(o, _)| o > 0.3)
        .collect();
    seen.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let count = most.min(seen.len());
    (0..count).map(|i| seen[i * seen.len() / count].1).collect()
}

/// Share of a frame's points that lie in another one's picture, weighted by how alike the directions of view are and by
/// nearness.
fn overlap(from: &Stand, points: &[Vec3], to: &Stand) -> f32 {
    let passage = Passage::new(from, to);
    let weight = |&point: &Vec3| {
        let moved = passage.transform(point);
        passage.pixel(moved)?;
        let alike = passage.turn(point).normalize().dot(moved.normalize());
        Some(alike.max(0.0) * (point.z / moved.z).min(1.0))
    };
    points.iter().filter_map(weight).sum::<f32>() / points.len().max(1) as f32
}
