use glam::{DVec2, DVec3};

use super::axis::Axis;
use super::body::{Body, BodyShape};
use super::medial::MedialCurve;
use super::section::parabola;
use ostra_masks::LabelId;

/// Distance from a rod's medial curve at which a ribbon has left the rod, in radii of the rod.
const LEFT: f64 = 2.2;
/// Maximum distance between a ribbon and the medial curve of its rod, in radii of the rod.
const TOUCHES: f64 = 4.0;
/// Distance at which a ribbon has certainly left a rod, in radii of the rod.
///
/// This holds even if the medial curve is only approximate because the ribbon hides the rod.
const SURELY_LEFT: f64 = 8.0;

/// Returns the angle in degrees between a ribbon and the rod it grows from, and that rod.
///
/// The angle is between the rod's axis where the ribbon leaves it and the chord of the first part
/// of the ribbon's midrib. That part is `reach` long, and at least as long as the rod's diameter.
/// The smaller of the two angles counts (0–90).
///
/// Returns `None` if the body is not a ribbon, no rod is near, or the ribbon is too short.
pub(super) fn insertion_angle<'a>(
    ribbon: &Body,
    rods: impl Iterator<Item = (LabelId, &'a Body)>,
    reach: f64,
) -> Option<(f64, (LabelId, &'a Body))> {
    let (BodyShape::Ribbon(_), Some(curve)) = (ribbon.shape, &ribbon.curve) else {
        return None;
    };
    let end_distance = |x: DVec3, rod: &Body| {
        rod.curve
            .as_ref()
            .map_or(f64::INFINITY, |c| c.nearest(x).distance)
    };
    let (tail, head) = (*curve.points.first()?, *curve.points.last()?);
    let radius = |rod: &Body| 0.5 * rod.diameter().unwrap_or(0.0);
    let distance = |rod: &Body| end_distance(tail, rod).min(end_distance(head, rod));
    let near: Vec<(LabelId, &Body)> = rods
        .filter(|(_, rod)| distance(rod) <= TOUCHES * radius(rod))
        .collect();
    let nearest = near
        .iter()
        .map(|(_, rod)| distance(rod))
        .fold(f64::INFINITY, f64::min);
    // Among rods at about the same distance the longest wins: a culm rather than the sheath around
    // it.
    let length = |rod: &Body| rod.curve.as_ref().map_or(0.0, MedialCurve::length);
    let as_near = near
        .into_iter()
        .filter(|(_, rod)| distance(rod) <= nearest + radius(rod));
    let (id, rod) = as_near.max_by(|(_, a), (_, b)| length(a).total_cmp(&length(b)))?;
    let middle = rod.curve.as_ref()?;
    let reach = reach.max(2.0 * radius(rod));
    let outward = if end_distance(tail, rod) <= end_distance(head, rod) {
        curve.clone()
    } else {
        curve.reversed()
    };
    let (from, root) = collar(&outward, middle, radius(rod), reach)?;
    if from + reach > outward.length() {
        return None;
    }
    let tip = outward.point_at(from + reach);
    let at = middle.nearest(root).at;
    // If a rod is seen from one side, the middle of the visible points is off its axis; the offset
    // grows with the hidden part.
    let rough = Axis {
        x: middle.point_at(at),
        along: middle.direction_about(at, reach),
    };
    let axis = rough.fitted(&rod.points, radius(rod), reach);
    let chord = midrib_chord(&ribbon.points, axis, root, tip, radius(rod)).unwrap_or(tip - root);
    let angle = chord.angle_between(axis.along).to_degrees();
    Some((angle.min(180.0 - angle), (id, rod)))
}

/// Half widths of the strip about the midrib, in radii of the rod.
///
/// The first strip with enough points is used.
const STRIPS: [f64; 3] = [0.5, 1.0, 2.0];
/// Minimum number of points of a strip.
const LEAST_POINTS: usize = 8;

/// Returns the chord of a sheet's midrib from the rod's surface at `root` to `tip`.
///
/// The sheet is bent about the rod where it leaves it, and the rod may hide part of it. The middle
/// of its points is then off the midrib. The chord is therefore that of a parabola through the
/// points near the half-plane from the rod's axis through the tip. Returns `None` if there are too
/// few such points, or none in the half next to the rod.
fn midrib_chord(
    sheet: &[DVec3],
    axis: Axis,
    root: DVec3,
    tip: DVec3,
    radius: f64,
) -> Option<DVec3> {
    let out = (tip - axis.x)
        .reject_from_normalized(axis.along)
        .try_normalize()?;
    let aside = axis.along.cross(out);
    let in_plane = |x: DVec3| DVec2::new((x - axis.x).dot(axis.along), (x - axis.x).dot(out));
    let begin = in_plane(root).max(DVec2::new(f64::NEG_INFINITY, radius));
    let chord = in_plane(tip) - begin;
    // Coordinates along the chord and across it, as shares of its length.
    let local = |x: DVec2| {
        DVec2::new(chord.dot(x - begin), chord.perp_dot(x - begin)) / chord.length_squared()
    };
    let strip = |width: f64| -> Vec<DVec2> {
        let near = sheet
            .iter()
            .filter(|&&x| (x - axis.x).dot(aside).abs() <= width * radius);
        let outside = near.map(|&x| in_plane(x)).filter(|x| x.y > 0.0).map(local);
        outside
            .filter(|x| (0.0..=1.0).contains(&x.x) && x.y.abs() <= 0.5)
            .collect()
    };
    let midrib = STRIPS
        .into_iter()
        .map(strip)
        .find(|strip| strip.len() >= LEAST_POINTS)?;
    midrib.iter().any(|x| x.x < 0.5).then_some(())?;
    let [_, slope, bend] = parabola(&midrib)?;
    let chord = chord + (slope + bend) * chord.perp();
    Some(chord.x * axis.along + chord.y * out)
}

/// Returns where a ribbon leaves a rod: the arc length and the point on the rod's surface.
///
/// The ribbon starts at its end on the rod. The middle of a ribbon that is wrapped about the rod
/// lies inside the rod, so the point is moved outwards.
fn collar(
    ribbon: &MedialCurve,
    axis: &MedialCurve,
    radius: f64,
    reach: f64,
) -> Option<(f64, DVec3)> {
    let distance = |x: DVec3| axis.nearest(x).distance;
    let beyond = |times: f64| {
        ribbon
            .points
            .iter()
            .position(|&x| distance(x) > times * radius)
    };
    let leaves = beyond(LEFT)?;
    let outside = |k: &usize| {
        let before = k
            .checked_sub(1)
            .map_or(0.0, |before| distance(ribbon.points[before]));
        distance(ribbon.points[*k]) > radius.max(before)
    };
    let at = (0..=leaves).rev().find(|k| !outside(k)).unwrap_or(0);
    let off_axis = |x: DVec3| x - axis.point_at(axis.nearest(x).at);
    let (from, next) = match knee(ribbon, beyond(TOUCHES), beyond(SURELY_LEFT), reach) {
        Some(knee) => (knee, ribbon.point_at(knee + 0.25 * reach)),
        None => (ribbon.length_to(at), ribbon.points[(at + 1).min(leaves)]),
    };
    let middle = ribbon.point_at(from);
    let out = off_axis(middle).length().max(radius);
    // The middle of a ribbon near the axis does not show to which side the ribbon leaves.
    let side = off_axis(next).normalize_or_zero();
    Some((from, middle - off_axis(middle) + out * side))
}

/// Returns the arc length of the sharpest turn of a ribbon that first follows a rod.
///
/// An example is a leaf with its sheath. The sheath hides the rod, so the rod's medial curve does
/// not show where the blade leaves it. The turn is measured within `reach` on both sides. `near`
/// and `far` are the first points that have left the rod and have certainly left it. Returns `None`
/// if the ribbon leaves the rod at once.
///
/// On synthetic plants the insertion angle is off by less than 0.5° for blades alone, where the
/// distance from the rod decides. It is off by 3° for leaves with a sheath, where the sharpest turn
/// decides.
fn knee(ribbon: &MedialCurve, near: Option<usize>, far: Option<usize>, reach: f64) -> Option<f64> {
    let along = ribbon.length_to(near?);
    if along < 2.0 * reach {
        return None;
    }
    let end = far
        .map_or(f64::INFINITY, |far| ribbon.length_to(far))
        .min(ribbon.length() - reach);
    let places = (0..)
        .map(|k| reach * (1.0 + f64::from(k) / 15.0))
        .take_while(|&at| at <= end);
    let turn = |at: f64| {
        let [before, here, after] = [at - reach, at, at + reach].map(|at| ribbon.point_at(at));
        (here - before).angle_between(after - here)
    };
    places.max_by(|&a, &b| turn(a).total_cmp(&turn(b)))
}
