//! The shape of a piece, and rods joined across gaps.

use glam::DVec3;

use super::extent::extent_traits;
use super::medial::MedialCurve;
use super::section::{Section, sections};
use super::trait_table::Dimension::Length;
use super::trait_table::Trait;
use ostra_core::job::{Progress, Stopped};
use ostra_core::statistics::{nth_smallest, upper_median};

/// One instance of a label: points that hang together.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) points: Vec<DVec3>,
    pub(super) area: f64,
    pub(super) curve: Option<MedialCurve>,
    pub(super) shape: Shape,
}

/// What kind of thing a body is, as most of its cross-sections say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Shape {
    /// Long and round.
    Rod(Breadths),
    /// A long sheet.
    Ribbon(Breadths),
    /// Anything else.
    Lump,
}

/// How broad the cross-sections of a body are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Breadths {
    pub(super) median: f64,
    pub(super) mean: f64,
    /// What 95 % of the sections stay below.
    pub(super) most: f64,
}

impl Breadths {
    /// Of at least one section, in rising order.
    fn of(sorted: &[f64]) -> Self {
        let count = sorted.len();
        let at = |share: usize| sorted[(count * share / 100).min(count - 1)];
        Self {
            median: at(50),
            mean: sorted.iter().sum::<f64>() / count as f64,
            most: at(95),
        }
    }

    /// Of a body joined from two, by their lengths.
    fn joined(self, own_length: f64, other: Self, other_length: f64) -> Self {
        let mixed =
            |a: f64, b: f64| (own_length * a + other_length * b) / (own_length + other_length);
        Self {
            median: mixed(self.median, other.median),
            mean: mixed(self.mean, other.mean),
            most: self.most.max(other.most),
        }
    }
}

impl Body {
    /// `spacing`: median distance of the points to their nearest neighbours; `reach`: of steps between neighbouring points.
    pub(super) fn new(
        (points, area): (Vec<DVec3>, f64),
        spacing: f64,
        reach: f64,
        progress: &Progress,
    ) -> Result<Self, Stopped> {
        let curve = MedialCurve::trace(&points, spacing, reach, progress)?;
        let shape = curve
            .as_ref()
            .map_or(Shape::Lump, |curve| shape(&points, curve, spacing));
        Ok(Self {
            points,
            area,
            curve,
            shape,
        })
    }

    pub(super) fn diameter(&self) -> Option<f64> {
        if let Shape::Rod(breadths) = self.shape {
            Some(breadths.median)
        } else {
            None
        }
    }

    /// Of the middle line; 0 without one.
    pub(super) fn length(&self) -> f64 {
        self.curve.as_ref().map_or(0.0, MedialCurve::length)
    }

    /// Median diameter of a rod or width of a sheet, 0 of anything else.
    pub(super) fn breadth(&self) -> f64 {
        match self.shape {
            Shape::Rod(breadths) | Shape::Ribbon(breadths) => breadths.median,
            Shape::Lump => 0.0,
        }
    }

    /// The traits that need no other body; `spacing`: of the points.
    pub(super) fn traits(&self, spacing: f64) -> Vec<Trait> {
        let found = |name, value, definition| {
            Trait::new(name, (value, Length), definition, self.points.len())
        };
        let mut traits = Vec::new();
        if let Some(curve) = &self.curve {
            let definition = "length of the middle line from end to end, across hidden parts";
            traits.push(found("length", curve.length(), definition));
        }
        match self.shape {
            Shape::Rod(Breadths { median, mean, most }) => traits.extend([
                found("diameter", median, "median over the cross-sections"),
                found("diameter_mean", mean, "mean over the cross-sections"),
                found(
                    "diameter_max",
                    most,
                    "diameter that 95 % of the cross-sections stay below",
                ),
            ]),
            Shape::Ribbon(Breadths { mean, most, .. }) => traits.extend([
                found(
                    "width",
                    mean,
                    "width along the sheet, mean over the cross-sections",
                ),
                found(
                    "width_max",
                    most,
                    "width that 95 % of the cross-sections stay below",
                ),
            ]),
            Shape::Lump => {}
        }
        traits.extend(extent_traits(&self.points, self.area, spacing));
        traits
    }
}

/// Share of the cross-sections that decide a shape.
const MOST: f64 = 0.6;

fn shape(points: &[DVec3], curve: &MedialCurve, spacing: f64) -> Shape {
    let length = curve.length();
    let mut distances: Vec<f64> = points.iter().map(|&x| curve.nearest(x).distance).collect();
    let place = distances.len() * 95 / 100;
    let widest = 1.6 * nth_smallest(&mut distances, place).unwrap_or(0.0) + spacing;
    let sections = sections(points, curve, (4.0 * spacing).max(length / 80.0), widest);
    let (mut round, mut sheet) = (Vec::new(), Vec::new());
    for section in &sections {
        match section {
            Section::Round(diameter) => round.push(*diameter),
            Section::Sheet(width) => sheet.push(*width),
            Section::Other => {}
        }
    }
    round.sort_by(f64::total_cmp);
    sheet.sort_by(f64::total_cmp);
    let most = |count: usize| count as f64 >= MOST * sections.len() as f64 && count >= 3;
    if most(round.len()) && length > 1.5 * Breadths::of(&round).median {
        return Shape::Rod(Breadths::of(&round));
    }
    // By the largest width: along its diagonal, a square is twice as long as it is broad on average.
    if most(sheet.len()) && length > 1.5 * Breadths::of(&sheet).most {
        return Shape::Ribbon(Breadths::of(&sheet));
    }
    Shape::Lump
}

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
        upper_median(&mut distances).filter(|_| distances.len() >= LEAST_POINTS)
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
