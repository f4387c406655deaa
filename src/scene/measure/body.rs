use glam::DVec3;
use nalgebra::{Matrix3, SymmetricEigen};

use super::hull::hull_volume;
use super::medial::MedialCurve;
use super::section::{Section, sections};
use super::table::Dimension::{self, Area, Length, Volume};
use crate::engine::job::{Progress, Stopped};

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
    /// Long and round: the median diameter.
    Rod { diameter: f64 },
    /// A long sheet: mean width, and the width that 95 % of the sections stay below.
    Ribbon { width: f64, width_max: f64 },
    /// Anything else.
    Lump,
}

/// A trait without its label: name, value, definition.
pub(super) type Trait = (&'static str, (f64, Dimension), &'static str);

impl Body {
    /// `spacing`: median distance of the points to their nearest neighbours; `reach`: of steps between neighbouring points.
    pub(super) fn new(
        (points, area): (Vec<DVec3>, f64),
        spacing: f64,
        reach: f64,
        progress: &Progress,
    ) -> Result<Self, Stopped> {
        let curve = MedialCurve::trace(&points, spacing, reach, progress)?;
        let shape = curve.as_ref().map_or(Shape::Lump, |curve| shape(&points, curve, spacing));
        Ok(Self { points, area, curve, shape })
    }

    pub(super) fn diameter(&self) -> Option<f64> {
        if let Shape::Rod { diameter } = self.shape { Some(diameter) } else { None }
    }

    /// The traits that need no other body.
    pub(super) fn traits(&self) -> Vec<Trait> {
        let mut traits = Vec::new();
        if let Some(curve) = &self.curve {
            let definition = "length of the middle line from end to end, across hidden parts";
            traits.push(("length", (curve.length(), Length), definition));
        }
        match self.shape {
            Shape::Rod { diameter } => traits.push(("diameter", (diameter, Length), "median over the cross-sections")),
            Shape::Ribbon { width, width_max } => {
                traits.push(("width", (width, Length), "width along the sheet, mean over the cross-sections"));
                traits.push(("width_max", (width_max, Length), "width that 95 % of the cross-sections stay below"));
            }
            Shape::Lump => {}
        }
        traits.extend(extent_traits(&self.points, self.area));
        traits
    }
}

/// Area, hull volume and the three sizes of a set of points.
pub(super) fn extent_traits(points: &[DVec3], area: f64) -> Vec<Trait> {
    let mut traits: Vec<Trait> = vec![
        ("area", (area, Area), "area of the surface that the points cover, one side of a thin sheet"),
        ("hull_volume", (hull_volume(points), Volume), "volume of the convex hull of the points"),
    ];
    for (name, size) in ["size_long", "size_middle", "size_short"].into_iter().zip(principal_sizes(points)) {
        traits.push((name, (size, Length), "extent along a principal axis of the points, longest first"));
    }
    traits
}

/// Extents along the principal axes, longest first.
fn principal_sizes(points: &[DVec3]) -> [f64; 3] {
    let mean = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let mut scatter = Matrix3::<f64>::zeros();
    for &x in points {
        let d = nalgebra::Vector3::from((x - mean).to_array());
        scatter += d * d.transpose();
    }
    let axes = SymmetricEigen::new(scatter).eigenvectors;
    let mut sizes = [0, 1, 2].map(|k| {
        let axis = DVec3::new(axes[(0, k)], axes[(1, k)], axes[(2, k)]);
        let span =
            points.iter().map(|&x| (x - mean).dot(axis)).fold((0.0_f64, 0.0_f64), |(l, h), v| (l.min(v), h.max(v)));
        span.1 - span.0
    });
    sizes.sort_by(|a, b| b.total_cmp(a));
    sizes
}

/// Share of the cross-sections that decide a shape.
const MOST: f64 = 0.6;

fn shape(points: &[DVec3], curve: &MedialCurve, spacing: f64) -> Shape {
    let length = curve.length();
    let mut distances: Vec<f64> = points.iter().map(|&x| curve.nearest(x).distance).collect();
    distances.sort_by(f64::total_cmp);
    let widest = 1.6 * distances[distances.len() * 95 / 100] + spacing;
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
    if most(round.len()) && length > 1.5 * round[round.len() / 2] {
        return Shape::Rod { diameter: round[round.len() / 2] };
    }
    let width = sheet.iter().sum::<f64>() / sheet.len().max(1) as f64;
    if most(sheet.len()) && length > 1.5 * width {
        return Shape::Ribbon { width, width_max: sheet[(sheet.len() * 95 / 100).min(sheet.len() - 1)] };
    }
    Shape::Lump
}
