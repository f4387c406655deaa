//! The shape of a connected component, and rods joined across gaps.

use glam::DVec3;

use super::extent::extent_traits;
use super::medial::MedialCurve;
use super::section::{CrossSection, sections};
use super::trait_table::Dimension::Length;
use super::trait_table::Trait;
use ostra_core::job::{Progress, Stopped};
use ostra_core::statistics::{nth_smallest, upper_median};

/// One instance of a label: a connected set of points.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) points: Vec<DVec3>,
    pub(super) area: f64,
    pub(super) curve: Option<MedialCurve>,
    pub(super) shape: BodyShape,
}

/// Shape class of a body, by the majority of its cross-sections.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum BodyShape {
    /// Long and round.
    Rod(Breadths),
    /// A long sheet.
    Ribbon(Breadths),
    /// Anything else.
    Lump,
}

/// Breadths of the cross-sections of a body, in world units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Breadths {
    pub(super) median: f64,
    pub(super) mean: f64,
    /// The 95th percentile.
    pub(super) most: f64,
}

impl Breadths {
    /// Computes the breadths of at least one section, given in ascending order.
    fn of(sorted: &[f64]) -> Self {
        let count = sorted.len();
        let at = |share: usize| sorted[(count * share / 100).min(count - 1)];
        Self {
            median: at(50),
            mean: sorted.iter().sum::<f64>() / count as f64,
            most: at(95),
        }
    }

    /// Returns the breadths of two joined bodies, weighted by their lengths.
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
    /// Creates a body and classifies its shape.
    ///
    /// `spacing` is the median distance of the points to their nearest neighbours. `reach` is the
    /// maximum distance between linked points.
    pub(super) fn new(
        points: Vec<DVec3>,
        area: f64,
        spacing: f64,
        reach: f64,
        progress: &Progress,
    ) -> Result<Self, Stopped> {
        let curve = MedialCurve::trace(&points, spacing, reach, progress)?;
        let shape = curve
            .as_ref()
            .map_or(BodyShape::Lump, |curve| shape(&points, curve, spacing));
        Ok(Self {
            points,
            area,
            curve,
            shape,
        })
    }

    pub(super) fn diameter(&self) -> Option<f64> {
        if let BodyShape::Rod(breadths) = self.shape {
            Some(breadths.median)
        } else {
            None
        }
    }

    /// Returns the length of the medial curve, or 0 without one.
    pub(super) fn length(&self) -> f64 {
        self.curve.as_ref().map_or(0.0, MedialCurve::length)
    }

    /// Returns the median diameter of a rod or the median width of a sheet, otherwise 0.
    pub(super) fn breadth(&self) -> f64 {
        match self.shape {
            BodyShape::Rod(breadths) | BodyShape::Ribbon(breadths) => breadths.median,
            BodyShape::Lump => 0.0,
        }
    }

    /// Returns the traits that need no other body; `spacing` is that of the points.
    pub(super) fn traits(&self, spacing: f64) -> Vec<Trait> {
        let found = |name, value, definition| {
            Trait::new(name, value, Length, definition, self.points.len())
        };
        let mut traits = Vec::new();
        if let Some(curve) = &self.curve {
            let definition = "length of the middle line from end to end, across hidden parts";
            traits.push(found("length", curve.length(), definition));
        }
        match self.shape {
            BodyShape::Rod(Breadths { median, mean, most }) => traits.extend([
                found("diameter", median, "median over the cross-sections"),
                found("diameter_mean", mean, "mean over the cross-sections"),
                found(
                    "diameter_max",
                    most,
                    "diameter that 95 % of the cross-sections stay below",
                ),
            ]),
            BodyShape::Ribbon(Breadths { mean, most, .. }) => traits.extend([
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
            BodyShape::Lump => {}
        }
        traits.extend(extent_traits(&self.points, self.area, spacing));
        traits
    }
}

/// Share of the cross-sections that decides the shape.
const MOST: f64 = 0.6;

fn shape(points: &[DVec3], curve: &MedialCurve, spacing: f64) -> BodyShape {
    let length = curve.length();
    let mut distances: Vec<f64> = points.iter().map(|&x| curve.nearest(x).distance).collect();
    let place = distances.len() * 95 / 100;
    let widest = 1.6 * nth_smallest(&mut distances, place).unwrap_or(0.0) + spacing;
    let sections = sections(points, curve, (4.0 * spacing).max(length / 80.0), widest);
    let (mut round, mut sheet) = (Vec::new(), Vec::new());
    for section in &sections {
        match section {
            CrossSection::Round(diameter) => round.push(*diameter),
            CrossSection::Sheet(width) => sheet.push(*width),
            CrossSection::Other => {}
        }
    }
    round.sort_by(f64::total_cmp);
    sheet.sort_by(f64::total_cmp);
    let most = |count: usize| count as f64 >= MOST * sections.len() as f64 && count >= 3;
    if most(round.len()) && length > 1.5 * Breadths::of(&round).median {
        return BodyShape::Rod(Breadths::of(&round));
    }
    // The largest width counts: along its diagonal, a square is on average twice as long as it is
    // broad.
    if most(sheet.len()) && length > 1.5 * Breadths::of(&sheet).most {
        return BodyShape::Ribbon(Breadths::of(&sheet));
    }
    BodyShape::Lump
}

/// One end of a rod.
#[derive(Debug, Clone, Copy)]
struct RodEnd {
    rod: usize,
    /// Whether this is the first point of the curve.
    start: bool,
    x: DVec3,
    /// Unit vector.
    outward: DVec3,
    diameter: f64,
    length: f64,
}

impl RodEnd {
    fn is_short(&self) -> bool {
        self.length < 6.0 * self.diameter
    }
}

/// Joins rods that continue each other across a gap, such as parts of a culm hidden by its sheaths.
///
/// A gap may be `longest` times as long as both parts together. Short rods with tapering ends, such
/// as grains in a row, are complete and are not joined. Other bodies are unchanged. The order is
/// kept; a joined rod takes the place of its first part.
pub(super) fn join_rods(mut bodies: Vec<Body>, longest: f64) -> Vec<Body> {
    while let Some((a, b)) = best_pair(&bodies, longest) {
        let (first, second) = (a.rod.min(b.rod), a.rod.max(b.rod));
        let other = bodies.remove(second);
        let own = &mut bodies[first];
        let (near, far) = if a.rod == first { (a, b) } else { (b, a) };
        own.curve = joined(own.curve.take(), other.curve, near.start, far.start);
        let (mine, theirs) = (near.length, far.length);
        if let (BodyShape::Rod(breadths), BodyShape::Rod(others)) = (own.shape, other.shape) {
            own.shape = BodyShape::Rod(breadths.joined(mine, others, theirs));
        }
        own.area += other.area;
        own.points.extend(other.points);
    }
    bodies
}

fn ends(bodies: &[Body]) -> Vec<RodEnd> {
    let mut ends = Vec::new();
    for (rod, body) in bodies.iter().enumerate() {
        let (Some(curve), Some(diameter)) = (&body.curve, body.diameter()) else {
            continue;
        };
        let length = curve.length();
        for (start, from) in [(true, curve.clone()), (false, curve.reversed())] {
            // Several diameters are used, because the very end of a medial curve may lean.
            let span = length.min((6.0 * diameter).max(length / 6.0));
            let (x, outward) = (from.points[0], -from.direction_about(0.0, span));
            ends.push(RodEnd {
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

/// Returns the compatible pair of ends with the shortest gap.
fn best_pair(bodies: &[Body], longest: f64) -> Option<(RodEnd, RodEnd)> {
    let ends = ends(bodies);
    let pairs = ends
        .iter()
        .enumerate()
        .flat_map(|(k, a)| ends[k + 1..].iter().map(move |b| (*a, *b)));
    let fitting = pairs.filter(|(a, b)| a.rod != b.rod && continues(a, b, longest));
    // A long rod shows reliably where it continues; two short ones may be separate objects, such as
    // grains.
    let is_confident = |end: &RodEnd| !end.is_short();
    let cut_off = |end: &RodEnd| is_cut_off(&bodies[end.rod], end);
    let parts =
        fitting.filter(|(a, b)| is_confident(a) || is_confident(b) || (cut_off(a) && cut_off(b)));
    parts.min_by(|(a, b), (c, d)| a.x.distance(b.x).total_cmp(&c.x.distance(d.x)))
}

/// Minimum share of its breadth that a rod keeps up to an end that is cut off.
///
/// A spheroid keeps about half, a tube all.
const KEPT: f64 = 0.75;
/// Minimum number of points at an end that determine its breadth.
const LEAST_POINTS: usize = 8;

/// Returns whether a rod keeps its breadth up to an end, as it does if the rest is hidden.
///
/// The points of the last third of a diameter are then about as far from the medial curve as those
/// of the next diameters. Returns true if there are too few points.
fn is_cut_off(body: &Body, end: &RodEnd) -> bool {
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

fn continues(a: &RodEnd, b: &RodEnd, longest: f64) -> bool {
    let gap = b.x - a.x;
    // The medial curve of a rod of a few diameters may lean; a long rod gives the direction
    // instead.
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

/// Concatenates two curves into one.
///
/// `near` and `far` select the ends that meet, where true is the first point.
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
