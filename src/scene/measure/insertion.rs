use glam::DVec3;

use super::body::{Body, Shape};
use super::medial::MedialCurve;
use crate::masks::LabelId;

/// How far from a rod's middle line a ribbon has left it, in the rod's radii.
const LEFT: f64 = 2.2;
/// A ribbon belongs to a rod when it comes this near its middle line, in the rod's radii.
const TOUCHES: f64 = 4.0;

/// Angle in degrees between a ribbon and the rod that it grows from: between the rod's middle line where the ribbon
/// leaves it and the chord of the ribbon's next `reach`, the smaller of the two (0–90), and which rod that is. `None` when
/// the body is no ribbon, none of the rods is near, or it ends sooner.
pub(super) fn insertion_angle<'a>(
    ribbon: &Body,
    rods: impl Iterator<Item = (LabelId, &'a Body)>,
    reach: f64,
) -> Option<(f64, (LabelId, &'a Body))> {
    let (Shape::Ribbon(_), Some(curve)) = (ribbon.shape, &ribbon.curve) else { return None };
    let end_distance = |x: DVec3, rod: &Body| rod.curve.as_ref().map_or(f64::INFINITY, |c| c.nearest(x).distance);
    let (tail, head) = (*curve.points.first()?, *curve.points.last()?);
    let radius = |rod: &Body| 0.5 * rod.diameter().unwrap_or(0.0);
    let distance = |rod: &Body| end_distance(tail, rod).min(end_distance(head, rod));
    let near: Vec<(LabelId, &Body)> = rods.filter(|(_, rod)| distance(rod) <= TOUCHES * radius(rod)).collect();
    let nearest = near.iter().map(|(_, rod)| distance(rod)).fold(f64::INFINITY, f64::min);
    // Of those that are about as near, the longest: a culm, not the sheath around it.
    let length = |rod: &Body| rod.curve.as_ref().map_or(0.0, MedialCurve::length);
    let as_near = near.into_iter().filter(|(_, rod)| distance(rod) <= nearest + radius(rod));
    let (id, rod) = as_near.max_by(|(_, a), (_, b)| length(a).total_cmp(&length(b)))?;
    let axis = rod.curve.as_ref()?;
    let outward = if end_distance(tail, rod) <= end_distance(head, rod) { curve.clone() } else { curve.reversed() };
    let (from, root) = collar(&outward, axis, radius(rod))?;
    if from + reach > outward.length() {
        return None;
    }
    let chord = outward.point_at(from + reach) - root;
    let along = axis.direction_about(axis.nearest(root).at, reach);
    let angle = chord.angle_between(along).to_degrees();
    Some((angle.min(180.0 - angle), (id, rod)))
}

/// Where a ribbon, from its end on the rod outwards, leaves a rod: the arc length there, and the place on the rod's surface.
/// The middle of a ribbon that is wrapped about the rod lies inside the rod, so that it is pushed out.
fn collar(ribbon: &MedialCurve, axis: &MedialCurve, radius: f64) -> Option<(f64, DVec3)> {
    let distance = |x: DVec3| axis.nearest(x).distance;
    let leaves = ribbon.points.iter().position(|&x| distance(x) > LEFT * radius)?;
    let outside = |k: &usize| {
        let before = k.checked_sub(1).map_or(0.0, |before| distance(ribbon.points[before]));
        distance(ribbon.points[*k]) > radius.max(before)
    };
    let at = (0..=leaves).rev().find(|k| !outside(k)).unwrap_or(0);
    let off_axis = |x: DVec3| x - axis.point_at(axis.nearest(x).at);
    let middle = ribbon.points[at];
    let out = off_axis(middle).length().max(radius);
    // A ribbon's middle that lies near the axis does not tell the side to which it leaves.
    let side = off_axis(ribbon.points[(at + 1).min(leaves)]).normalize_or_zero();
    Some((ribbon.length_to(at), middle - off_axis(middle) + out * side))
}
