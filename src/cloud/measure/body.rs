use glam::DVec3;

use super::extent::extent_traits;
use super::medial::MedialCurve;
use super::section::{Section, sections};
use super::table::Trait;
use super::unit::Dimension::Length;
use ostra_core::job::{Progress, Stopped};

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
    pub(super) fn joined(self, own_length: f64, other: Self, other_length: f64) -> Self {
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
    if most(round.len()) && length > 1.5 * Breadths::of(&round).median {
        return Shape::Rod(Breadths::of(&round));
    }
    // By the largest width: along its diagonal, a square is twice as long as it is broad on average.
    if most(sheet.len()) && length > 1.5 * Breadths::of(&sheet).most {
        return Shape::Ribbon(Breadths::of(&sheet));
    }
    Shape::Lump
}
