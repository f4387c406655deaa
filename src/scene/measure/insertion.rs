use glam::DVec3;

use super::body::{Body, Shape};
use super::medial::MedialCurve;

/// How far from a rod's middle line a ribbon has left it, in the rod's radii.
const LEFT: f64 = 2.2;
/// A ribbon belongs to a rod when it comes this near its middle line, in the rod's radii.
const TOUCHES: f64 = 4.0;

/// Angle in degrees between a ribbon and the rod that it grows from: between the rod's middle line where the ribbon
/// leaves it and the chord of the ribbon's next `reach`, the smaller of the two (0–90). `None` when the body is no
/// ribbon, none of the rods is near, or it ends sooner.
pub(super) fn insertion_angle<'a>(ribbon: &Body, rods: impl Iterator<Item = &'a Body>, reach: f64) -> Option<f64> {
    let (Shape::Ribbon { .. }, Some(curve)) = (ribbon.shape, &ribbon.curve) else { return None };
    let end_distance = |x: DVec3, rod: &Body| rod.curve.as_ref().map_or(f64::INFINITY, |c| c.nearest(x).distance);
    let (tail, head) = (*curve.points.first()?, *curve.points.last()?);
    let radius = |rod: &Body| 0.5 * rod.diameter().unwrap_or(0.0);
    let distance = |rod: &Body| end_distance(tail, rod).min(end_distance(head, rod));
    let near: Vec<&Body> = rods.filter(|rod| distance(rod) <= TOUCHES * radius(rod)).collect();
    let nearest = near.iter().map(|rod| distance(rod)).fold(f64::INFINITY, f64::min);
    // Of those that are about as near, the longest: a culm, not the sheath around it.
    let length = |rod: &Body| rod.curve.as_ref().map_or(0.0, MedialCurve::length);
    let as_near = near.into_iter().filter(|rod| distance(rod) <= nearest + radius(rod));
    let rod = as_near.max_by(|a, b| length(a).total_cmp(&length(b)))?;
    let axis = rod.curve.as_ref()?;
    let outward = if end_distance(tail, rod) <= end_distance(head, rod) { curve.clone() } else { curve.reversed() };
    let leaves = outward.points.iter().position(|&x| axis.nearest(x).distance > LEFT * radius(rod))?;
    let root = outward.points[leaves.saturating_sub(1)];
    let from = outward.nearest(root).at;
    if from + reach > outward.length() {
        return None;
    }
    let chord = outward.point_at(from + reach) - root;
    let along = axis.direction_about(axis.nearest(root).at, reach);
    let angle = chord.angle_between(along).to_degrees();
    Some(angle.min(180.0 - angle))
}
