use glam::DVec3;

use super::body::{Body, Shape};
use super::medial::MedialCurve;

/// One end of a rod.
#[derive(Debug, Clone, Copy)]
struct End {
    rod: usize,
    /// Whether it is the curve's first point.
    start: bool,
    x: DVec3,
    /// Unit.
    outward: DVec3,
    diameter: f64,
    length: f64,
}

impl End {
    fn is_short(&self) -> bool {
        self.length < 6.0 * self.diameter
    }
}

/// Joins rods that continue one another across a gap, as the pieces of a culm do that its sheaths hide. A gap may be
/// `longest` times as long as both pieces together. Short rods that taper off, as grains in a row do, are whole. Other
/// bodies stay as they are; order is kept, a joined rod stands where its first piece stood.
pub(super) fn join_rods(mut bodies: Vec<Body>, longest: f64) -> Vec<Body> {
    while let Some((a, b)) = best_pair(&bodies, longest) {
        let (first, second) = (a.rod.min(b.rod), a.rod.max(b.rod));
        let other = bodies.remove(second);
        let own = &mut bodies[first];
        let (near, far) = if a.rod == first { (a, b) } else { (b, a) };
        own.curve = joined(own.curve.take(), other.curve, near.start, far.start);
        let (mine, theirs) = (near.length, far.length);
        if let (Shape::Rod(breadths), Shape::Rod(others)) = (own.shape, other.shape) {
            own.shape = Shape::Rod(breadths.joined(mine, others, theirs));
        }
        own.area += other.area;
        own.points.extend(other.points);
    }
    bodies
}

fn ends(bodies: &[Body]) -> Vec<End> {
    let mut ends = Vec::new();
    for (rod, body) in bodies.iter().enumerate() {
        let (Some(curve), Some(diameter)) = (&body.curve, body.diameter()) else {
            continue;
        };
        let length = curve.length();
        for (start, from) in [(true, curve.clone()), (false, curve.reversed())] {
            // Over several diameters: the very end of a rod's middle line may lean.
            let span = length.min((6.0 * diameter).max(length / 6.0));
            let (x, outward) = (from.points[0], -from.direction_about(0.0, span));
            ends.push(End {
                rod,
                start,
                x,
                outward,
                diameter,
                length,
            });
        }
    }
    ends
}

/// The fitting pair of ends with the shortest gap.
fn best_pair(bodies: &[Body], longest: f64) -> Option<(End, End)> {
    let ends = ends(bodies);
    let pairs = ends
        .iter()
        .enumerate()
        .flat_map(|(k, a)| ends[k + 1..].iter().map(move |b| (*a, *b)));
    let fitting = pairs.filter(|(a, b)| a.rod != b.rod && continues(a, b, longest));
    // A long piece says by itself where it goes on; two short ones may be things of their own, such as grains.
    let is_sure = |end: &End| !end.is_short();
    let cut_off = |end: &End| is_cut_off(&bodies[end.rod], end);
    let parts = fitting.filter(|(a, b)| is_sure(a) || is_sure(b) || (cut_off(a) && cut_off(b)));
    parts.min_by(|(a, b), (c, d)| a.x.distance(b.x).total_cmp(&c.x.distance(d.x)))
}

/// A rod is cut off where it keeps this share of its breadth to the end. A spheroid keeps about half, a tube all.
const KEPT: f64 = 0.75;
/// Fewer points at an end do not tell its breadth.
const LEAST_POINTS: usize = 8;

/// Whether a rod keeps its breadth to an end, as it does where something hides the rest: the points of the last third of
/// a diameter lie about as far from the middle line as those of the next diameters. So does one with too few points.
fn is_cut_off(body: &Body, end: &End) -> bool {
    let Some(curve) = &body.curve else {
        return false;
    };
    let breadth = |depths: std::ops::Range<f64>| {
        let in_slab =
            |x: &&DVec3| depths.contains(&((end.x - **x).dot(end.outward) / end.diameter));
        let near = body
            .points
            .iter()
            .filter(|x| x.distance(end.x) < 2.5 * end.diameter)
            .filter(in_slab);
        let mut distances: Vec<f64> = near.map(|&x| curve.nearest(x).distance).collect();
        distances.sort_by(f64::total_cmp);
        (distances.len() >= LEAST_POINTS).then(|| distances[distances.len() / 2])
    };
    let (last, next) = (
        breadth(f64::NEG_INFINITY..1.0 / 3.0),
        breadth(1.0 / 3.0..2.0),
    );
    last.zip(next)
        .is_none_or(|(last, next)| last >= KEPT * next)
}

fn continues(a: &End, b: &End, longest: f64) -> bool {
    let gap = b.x - a.x;
    // The middle line of a piece of a few diameters may lean; a long one beside it says where to go.
    let unsure = [(a, b), (b, a)].map(|(own, other)| own.is_short() && !other.is_short());
    let aside = |unsure: bool| {
        0.75 * a.diameter.max(b.diameter) + if unsure { 0.6 } else { 0.15 } * gap.length()
    };
    let alike = if unsure[0] || unsure[1] { 0.75 } else { 0.94 };
    gap.length() <= longest * (a.length + b.length)
        && a.outward.dot(-b.outward) > alike
        && gap.dot(a.outward) > -a.diameter
        && gap.reject_from_normalized(a.outward).length() < aside(unsure[0])
        && gap.reject_from_normalized(b.outward).length() < aside(unsure[1])
        && a.diameter < 1.6 * b.diameter
        && b.diameter < 1.6 * a.diameter
}

/// One curve through both, `near` and `far` saying which of their ends meet (true = the first point).
fn joined(
    own: Option<MedialCurve>,
    other: Option<MedialCurve>,
    near: bool,
    far: bool,
) -> Option<MedialCurve> {
    let own = if near { own?.reversed() } else { own? };
    let other = if far { other? } else { other?.reversed() };
    Some(MedialCurve {
        points: [own.points, other.points].concat(),
    })
}
