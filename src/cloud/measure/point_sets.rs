//! Point sets: neighbour grid, spacing, components, and the closest points of two sets.

use glam::{DVec3, IVec3};
use rustc_hash::FxHashMap;

use ostra_core::statistics::{trimmed_range, upper_median};

/// Points in cubic cells, for neighbour searches within about one cell side.
pub(super) struct PointGrid<'a> {
    points: &'a [DVec3],
    cell: f64,
    cells: FxHashMap<IVec3, Vec<u32>>,
}

impl<'a> PointGrid<'a> {
    /// Creates a grid of cells of side `cell` (above 0).
    pub(super) fn new(points: &'a [DVec3], cell: f64) -> Self {
        let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
        for (k, &x) in points.iter().enumerate() {
            cells.entry(cell_of(x, cell)).or_default().push(k as u32);
        }
        Self {
            points,
            cell,
            cells,
        }
    }

    /// Returns the points within `radius` of `x`, which includes `x` itself if it is one of them.
    ///
    /// `radius` is at most the side of a cell. The order is by cell, then by index.
    pub(super) fn within(&self, x: DVec3, radius: f64) -> impl Iterator<Item = usize> + '_ {
        let centre = cell_of(x, self.cell);
        (0..27)
            .filter_map(move |k| {
                self.cells
                    .get(&(centre + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1)))
            })
            .flatten()
            .map(|&k| k as usize)
            .filter(move |&k| self.points[k].distance_squared(x) <= radius * radius)
    }
}

fn cell_of(x: DVec3, cell: f64) -> IVec3 {
    (x / cell).floor().as_ivec3()
}

/// Returns the median distance from a point to its nearest neighbour.
///
/// At most 1000 of the points are sampled. The result is 0 for fewer than two distinct points.
pub(super) fn median_spacing(points: &[DVec3]) -> f64 {
    let Some(extent) = core_extent(points) else {
        return 0.0;
    };
    let step = points.len().div_ceil(1000);
    let sample = || points.iter().step_by(step);
    let mut cell = 2.0 * extent / (points.len() as f64).sqrt();
    for _ in 0..12 {
        let grid = PointGrid::new(points, cell);
        let mut nearest: Vec<f64> = sample()
            .filter_map(|&x| {
                let others = grid
                    .within(x, cell)
                    .map(|k| points[k].distance(x))
                    .filter(|&d| d > 0.0);
                others.min_by(f64::total_cmp)
            })
            .collect();
        if 2 * nearest.len() > sample().count() {
            return upper_median(&mut nearest).unwrap_or(0.0);
        }
        cell *= 2.0;
    }
    0.0
}

/// Returns the largest extent of the middle 96 % of the coordinates, or `None` if it is 0.
pub(super) fn core_extent(points: &[DVec3]) -> Option<f64> {
    let extent_along = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|x| x[axis]).collect();
        let margin = values.len() / 50;
        trimmed_range(&mut values, margin).map(|[low, high]| high - low)
    };
    (0..3)
        .filter_map(extent_along)
        .max_by(f64::total_cmp)
        .filter(|&extent| extent > 0.0)
}

/// Returns the points, in order, without those too close to an earlier kept one.
///
/// The minimum distance is `least` (above 0).
pub(super) fn thinned(points: &[DVec3], least: f64) -> Vec<DVec3> {
    let mut kept: Vec<DVec3> = Vec::new();
    let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
    for &x in points {
        let centre = cell_of(x, least);
        let near = |k: i32| centre + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1);
        let crowded = |&k: &u32| kept[k as usize].distance_squared(x) < least * least;
        if !(0..27)
            .filter_map(|k| cells.get(&near(k)))
            .flatten()
            .any(crowded)
        {
            cells.entry(centre).or_default().push(kept.len() as u32);
            kept.push(x);
        }
    }
    kept
}

/// Returns the connected components over steps of at most `reach`, the largest first.
pub(super) fn components(points: &[DVec3], reach: f64) -> Vec<Vec<usize>> {
    let grid = PointGrid::new(points, reach);
    let mut group_of = vec![usize::MAX; points.len()];
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for seed in 0..points.len() {
        if group_of[seed] != usize::MAX {
            continue;
        }
        let mut group = vec![seed];
        group_of[seed] = groups.len();
        let mut next = 0;
        while let Some(&k) = group.get(next) {
            for near in grid.within(points[k], reach) {
                if group_of[near] == usize::MAX {
                    group_of[near] = groups.len();
                    group.push(near);
                }
            }
            next += 1;
        }
        groups.push(group);
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    groups
}

/// The closest points of two sets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Meeting {
    /// Point of the first set.
    pub(super) a: DVec3,
    /// Point of the second set.
    pub(super) b: DVec3,
}

/// Maximum number of sampled points of each set for the exhaustive comparison.
const COMPARED: usize = 2000;
/// Maximum number of refinement steps.
const STEPS: usize = 20;

impl Meeting {
    /// Finds the closest points of two sets, or returns `None` if a set is empty.
    ///
    /// The search starts from the closest pair of uniform samples. It then alternately takes the
    /// point of each set that is nearest to the other set's point, so the result may be a local
    /// minimum.
    pub(super) fn of(a: &[DVec3], b: &[DVec3]) -> Option<Self> {
        let [few_a, few_b] = [sample(a), sample(b)];
        let pairs = few_a.iter().map(|&x| {
            Some(Self {
                a: x,
                b: nearest(&few_b, x)?,
            })
        });
        let mut meeting = pairs
            .flatten()
            .min_by(|one, other| one.gap().total_cmp(&other.gap()))?;
        for _ in 0..STEPS {
            let on_a = nearest(a, meeting.b)?;
            let next = Self {
                a: on_a,
                b: nearest(b, on_a)?,
            };
            if next.gap() >= meeting.gap() {
                break;
            }
            meeting = next;
        }
        Some(meeting)
    }

    /// Returns the distance between the two points.
    pub(super) fn gap(&self) -> f64 {
        self.a.distance(self.b)
    }
}

fn sample(points: &[DVec3]) -> Vec<DVec3> {
    points
        .iter()
        .copied()
        .step_by(points.len().div_ceil(COMPARED).max(1))
        .collect()
}

fn nearest(points: &[DVec3], x: DVec3) -> Option<DVec3> {
    points
        .iter()
        .copied()
        .min_by(|a, b| a.distance_squared(x).total_cmp(&b.distance_squared(x)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn closest_points_of_two_lines_are_found() {
        let line = |from: DVec3, step: DVec3| {
            (0..30_000)
                .map(move |k| from + f64::from(k) * step)
                .collect::<Vec<_>>()
        };
        let a = line(DVec3::new(-1.0, 0.0, 0.0), 1e-4 * DVec3::X);
        let b = line(DVec3::new(0.5, -2.0, 0.01), 1e-4 * DVec3::Y);
        let meeting = Meeting::of(&a, &b).unwrap();
        assert!((meeting.gap() - 0.01).abs() < 1e-9, "{meeting:?}");
        assert!(
            meeting.a.distance(DVec3::new(0.5, 0.0, 0.0)) < 1e-9,
            "{meeting:?}"
        );
        assert_eq!(Meeting::of(&a, &[]), None);
    }
}
