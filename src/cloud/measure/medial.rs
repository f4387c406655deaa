use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::point_sets::{PointGrid, components};
use ostra_core::job::{Progress, Stopped};

/// The medial curve of a long body: a polyline from end to end.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MedialCurve {
    pub(super) points: Vec<DVec3>,
}

/// The closest position on a [`MedialCurve`] to a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Nearest {
    pub(super) distance: f64,
    /// Arc length from the first point.
    pub(super) at: f64,
}

impl MedialCurve {
    /// Traces the curve through the level sets of the geodesic distance from one end.
    ///
    /// The curve passes through the centroids of the level sets (Verroust, Lazarus, "Extracting
    /// skeletal curves from 3D scattered data", The Visual Computer 2000) and is extended to the
    /// outermost points. If the body branches, the curve follows the longest path. `spacing` is
    /// that of the points; `reach` is the maximum length of steps within the body. Returns `None`
    /// if the body is too small for a medial curve.
    ///
    /// # Errors
    ///
    /// Returns [`Stopped`] if the job is stopped.
    pub(super) fn trace(
        points: &[DVec3],
        spacing: f64,
        reach: f64,
        progress: &Progress,
    ) -> Result<Option<Self>, Stopped> {
        let grid = PointGrid::new(points, reach);
        let Some(first) = farthest(&geodesic(points, &grid, reach, 0, progress)?.0) else {
            return Ok(None);
        };
        let (distances, parents) = geodesic(points, &grid, reach, first, progress)?;
        Ok(Self::through_levels(
            points, &distances, &parents, spacing, reach,
        ))
    }

    fn through_levels(
        points: &[DVec3],
        distances: &[f64],
        parents: &[Option<usize>],
        spacing: f64,
        reach: f64,
    ) -> Option<Self> {
        let last = farthest(distances)?;
        let total = distances[last];
        let levels = (total / (total / 60.0).max(3.0 * spacing)).floor() as usize;
        if levels < 3 {
            return None;
        }
        let level = |k: usize| ((distances[k] / total * levels as f64) as usize).min(levels - 1);
        let mut members = vec![Vec::new(); levels];
        (0..points.len())
            .filter(|&k| distances[k].is_finite())
            .for_each(|k| members[level(k)].push(k));
        let mut on_way = vec![None; levels];
        std::iter::successors(Some(last), |&k| parents[k]).for_each(|k| on_way[level(k)] = Some(k));
        let slices: Vec<Vec<DVec3>> = members
            .iter()
            .zip(on_way)
            .filter_map(|(group, way)| part_about(points, group, way?, reach))
            .collect();
        let rough = Self::through(slices.iter().map(Vec::as_slice))?;
        // Level sets lean towards the end that they are counted from; slices across the rough curve
        // do not.
        Self::through(
            rough
                .slices(&slices.concat(), slices.len())
                .iter()
                .map(Vec::as_slice),
        )
    }

    /// Returns the curve through the centroids of consecutive slices.
    ///
    /// The curve is extended to the outermost points.
    fn through<'a>(slices: impl Iterator<Item = &'a [DVec3]>) -> Option<Self> {
        let slices: Vec<&[DVec3]> = slices.filter(|slice| !slice.is_empty()).collect();
        let centroids: Vec<DVec3> = slices
            .iter()
            .map(|slice| slice.iter().sum::<DVec3>() / slice.len() as f64)
            .collect();
        let mut curve = Self {
            points: smoothed(&smoothed(&centroids)),
        };
        curve.lengthen(slices.iter().take(2).copied().flatten());
        curve.points.reverse();
        curve.lengthen(slices.iter().rev().take(2).copied().flatten());
        curve.points.reverse();
        (curve.points.len() >= 3).then_some(curve)
    }

    /// Sorts the points into `count` slices of equal length along the curve.
    fn slices(&self, points: &[DVec3], count: usize) -> Vec<Vec<DVec3>> {
        let length = self.length().max(f64::MIN_POSITIVE);
        let mut slices = vec![Vec::new(); count];
        for &x in points {
            let share = self.nearest(x).at / length;
            slices[((share * count as f64) as usize).min(count - 1)].push(x);
        }
        slices
    }

    pub(super) fn length(&self) -> f64 {
        self.points
            .windows(2)
            .map(|pair| pair[0].distance(pair[1]))
            .sum()
    }

    /// Returns the arc length from the first point to point `index`.
    pub(super) fn length_to(&self, index: usize) -> f64 {
        self.points[..=index]
            .windows(2)
            .map(|pair| pair[0].distance(pair[1]))
            .sum()
    }

    /// Returns the position on the curve that is closest to `x`.
    pub(super) fn nearest(&self, x: DVec3) -> Nearest {
        let mut best = Nearest {
            distance: f64::INFINITY,
            at: 0.0,
        };
        let mut walked = 0.0;
        for pair in self.points.windows(2) {
            let along = pair[1] - pair[0];
            let share = ((x - pair[0]).dot(along) / along.length_squared().max(f64::MIN_POSITIVE))
                .clamp(0.0, 1.0);
            let distance = (pair[0] + share * along).distance(x);
            if distance < best.distance {
                best = Nearest {
                    distance,
                    at: walked + share * along.length(),
                };
            }
            walked += along.length();
        }
        best
    }

    /// Returns the point at arc length `at`, clamped to the ends.
    pub(super) fn point_at(&self, at: f64) -> DVec3 {
        let mut left = at.max(0.0);
        for pair in self.points.windows(2) {
            let step = pair[0].distance(pair[1]);
            if left <= step {
                return pair[0].lerp(pair[1], left / step.max(f64::MIN_POSITIVE));
            }
            left -= step;
        }
        self.points[self.points.len() - 1]
    }

    /// Returns the unit direction of the chord of length `span` about arc length `at`.
    pub(super) fn direction_about(&self, at: f64, span: f64) -> DVec3 {
        let low = (at - 0.5 * span).clamp(0.0, (self.length() - span).max(0.0));
        (self.point_at(low + span) - self.point_at(low)).normalize_or(DVec3::Z)
    }

    /// Returns positions about `step` apart, each with the unit direction of the curve there.
    pub(super) fn stations(&self, step: f64) -> Vec<(DVec3, DVec3)> {
        let mut stations = Vec::new();
        let mut ahead = 0.5 * step;
        for pair in self.points.windows(2) {
            let (length, direction) = (
                pair[0].distance(pair[1]),
                (pair[1] - pair[0]).normalize_or_zero(),
            );
            while ahead < length {
                stations.push((pair[0] + ahead * direction, direction));
                ahead += step;
            }
            ahead -= length;
        }
        stations
    }

    /// Returns the outward unit direction at the first point.
    ///
    /// The direction is measured over the first sixth of the curve.
    pub(super) fn start_direction(&self) -> DVec3 {
        let inner = (self.points.len() / 6).max(2).min(self.points.len() - 1);
        (self.points[0] - self.points[inner]).normalize_or(DVec3::Z)
    }

    pub(super) fn reversed(&self) -> Self {
        Self {
            points: self.points.iter().rev().copied().collect(),
        }
    }

    /// Inserts a point before the first one, extending the curve to the outermost point of `body`.
    fn lengthen<'a>(&mut self, body: impl Iterator<Item = &'a DVec3>) {
        if self.points.len() < 3 {
            return;
        }
        let (tip, outward) = (self.points[0], self.start_direction());
        let beyond = body.map(|&x| (x - tip).dot(outward)).fold(0.0, f64::max);
        self.points.insert(0, tip + beyond * outward);
    }
}

/// Returns the shortest path lengths from `from`, and the predecessor of each point.
///
/// Paths consist of steps of at most `reach`.
fn geodesic(
    points: &[DVec3],
    grid: &PointGrid<'_>,
    reach: f64,
    from: usize,
    progress: &Progress,
) -> Result<(Vec<f64>, Vec<Option<usize>>), Stopped> {
    if points.is_empty() {
        return Ok((Vec::new(), Vec::new()));
    }
    let mut distances = vec![f64::INFINITY; points.len()];
    let mut parents = vec![None; points.len()];
    let mut queue = BinaryHeap::from([Reverse((0_u64, from))]);
    distances[from] = 0.0;
    // The bits of non-negative floats sort in the order of the floats.
    while let Some(Reverse((bits, k))) = queue.pop() {
        progress.check()?;
        let so_far = f64::from_bits(bits);
        if so_far > distances[k] {
            continue;
        }
        for near in grid.within(points[k], reach) {
            let distance = so_far + points[k].distance(points[near]);
            if distance < distances[near] {
                distances[near] = distance;
                parents[near] = Some(k);
                queue.push(Reverse((distance.to_bits(), near)));
            }
        }
    }
    Ok((distances, parents))
}

fn farthest(distances: &[f64]) -> Option<usize> {
    let finite = (0..distances.len()).filter(|&k| distances[k].is_finite());
    finite.max_by(|&a, &b| distances[a].total_cmp(&distances[b]))
}

/// Returns the connected component of `group` that contains its member `anchor`.
fn part_about(points: &[DVec3], group: &[usize], anchor: usize, reach: f64) -> Option<Vec<DVec3>> {
    let members: Vec<DVec3> = group.iter().map(|&k| points[k]).collect();
    let place = group.iter().position(|&k| k == anchor)?;
    let part = components(&members, reach)
        .into_iter()
        .find(|part| part.contains(&place))?;
    Some(part.iter().map(|&k| members[k]).collect())
}

/// Moves each inner point halfway to the mean of its neighbours.
fn smoothed(points: &[DVec3]) -> Vec<DVec3> {
    let mut out = points.to_vec();
    for (k, triple) in points.windows(3).enumerate() {
        out[k + 1] = 0.25 * triple[0] + 0.5 * triple[1] + 0.25 * triple[2];
    }
    out
}
