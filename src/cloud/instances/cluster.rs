//! Instance segmentation by density clustering, and splitting masks by instance.

use std::cmp::{Ordering, Reverse};
use std::collections::{BTreeMap, VecDeque};

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::SceneError;
use crate::fuse::Votes;
use crate::points::spacing;
use ostra_core::job::Progress;
use ostra_core::union_find::DisjointSets;
use ostra_masks::{LabelId, LabelMask, Region};

/// Options of instance segmentation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct InstanceOptions {
    /// Maximum distance between neighbours, in point spacings, 1.5–20.
    ///
    /// The point spacing is the median distance to the nearest neighbour.
    pub radius: f64,
    /// Number of neighbours that a point needs to link others, 1–100.
    ///
    /// Isolated noise points between two objects have few neighbours.
    pub min_neighbours: usize,
    /// Minimum number of points of an instance, 1–1 000 000.
    pub min_points: usize,
}

impl Default for InstanceOptions {
    fn default() -> Self {
        Self {
            radius: 3.0,
            min_neighbours: 5,
            min_points: 50,
        }
    }
}

impl InstanceOptions {
    /// Checks that every option is in range.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] with the first option that is out of range.
    pub fn check(&self) -> Result<(), SceneError> {
        let ranges = [
            ("radius in spacings", self.radius, 1.5, 20.0),
            (
                "smallest number of neighbours",
                self.min_neighbours as f64,
                1.0,
                100.0,
            ),
            (
                "smallest instance in points",
                self.min_points as f64,
                1.0,
                1e6,
            ),
        ];
        match ranges
            .into_iter()
            .find(|(_, value, low, high)| !(low..=high).contains(&value))
        {
            Some((what, value, low, high)) => Err(SceneError::Request(format!(
                "the {what} is {value}; choose {low} to {high}"
            ))),
            None => Ok(()),
        }
    }
}

/// Points between two progress updates.
const CHUNK: usize = 16_384;

/// The instance that each point belongs to.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Instances {
    /// Instance number per point, from 1; 0 is none.
    pub of_points: Vec<u32>,
    /// Number of points per instance; the first entry is that of instance 1.
    pub sizes: Vec<usize>,
}

/// Groups connected points into instances with DBSCAN.
///
/// The method is that of Ester, Kriegel, Sander, Xu: *A density-based algorithm for discovering
/// clusters in large spatial databases with noise*, KDD 1996. The radius is in multiples of the
/// point spacing, because clouds have no common unit. Points with few neighbours belong to the
/// nearest group but do not link others.
///
/// The largest instance comes first. Instances of equal size are ordered by their first point in x,
/// y, z order. The result does not depend on the order of the points.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if an option is out of range. Returns [`SceneError::Stopped`] if
/// the job is stopped.
pub fn find_instances(
    points: &[Vec3],
    options: &InstanceOptions,
    progress: &Progress,
) -> Result<Instances, SceneError> {
    options.check()?;
    progress.stage("instances")?;
    let none = || Instances {
        of_points: vec![0; points.len()],
        sizes: Vec::new(),
    };
    let Some(spacing) = spacing(points) else {
        return Ok(none());
    };
    let cells = Cells::new(points, options.radius * spacing);
    let is_core = cores(&cells, points, options.min_neighbours, progress)?;
    let mut sets = linked(&cells, &is_core, progress)?;
    let roots: Vec<Option<u32>> = (0..points.len())
        .map(|k| is_core[k].then(|| sets.root(k as u32)))
        .collect();
    let joined = joined(&cells, points, &roots, progress)?;
    Ok(numbered(points, &joined, options.min_points))
}

/// Returns whether each point has at least `least` neighbours.
fn cores(
    cells: &Cells<'_>,
    points: &[Vec3],
    least: usize,
    progress: &Progress,
) -> Result<Vec<bool>, SceneError> {
    let is_core =
        |k: usize| points[k].is_finite() && cells.neighbours(k).take(least).count() >= least;
    in_chunks(points.len(), is_core, progress)
}

/// Returns the sets of linked core points.
fn linked(
    cells: &Cells<'_>,
    is_core: &[bool],
    progress: &Progress,
) -> Result<DisjointSets, SceneError> {
    let mut sets = DisjointSets::new(is_core.len());
    for k in (0..is_core.len()).filter(|&k| is_core[k]) {
        if k.is_multiple_of(CHUNK) {
            progress.step(k, is_core.len())?;
        }
        for other in cells
            .neighbours(k)
            .filter(|&other| other < k && is_core[other])
        {
            sets.unite(k as u32, other as u32);
        }
    }
    Ok(sets)
}

/// Returns the root of each point's set.
///
/// Points that are not core points take the root of the nearest core point within the radius.
fn joined(
    cells: &Cells<'_>,
    points: &[Vec3],
    roots: &[Option<u32>],
    progress: &Progress,
) -> Result<Vec<Option<u32>>, SceneError> {
    let root = |k: usize| {
        if roots[k].is_some() || !points[k].is_finite() {
            return roots[k];
        }
        let cores = cells.neighbours(k).filter(|&other| roots[other].is_some());
        let distance = |other: usize| points[other].distance_squared(points[k]);
        let nearest = cores.min_by(|&a, &b| {
            distance(a)
                .total_cmp(&distance(b))
                .then_with(|| by_place(points[a], points[b]))
        });
        nearest.and_then(|core| roots[core])
    };
    in_chunks(points.len(), root, progress)
}

fn in_chunks<T: Send>(
    count: usize,
    of: impl Fn(usize) -> T + Sync,
    progress: &Progress,
) -> Result<Vec<T>, SceneError> {
    let chunk = |chunk: usize| {
        progress.check()?;
        Ok((chunk * CHUNK..((chunk + 1) * CHUNK).min(count))
            .map(&of)
            .collect())
    };
    let chunks: Vec<Vec<T>> = (0..count.div_ceil(CHUNK))
        .into_par_iter()
        .map(chunk)
        .collect::<Result<_, SceneError>>()?;
    Ok(chunks.into_iter().flatten().collect())
}

/// Numbers the sets with enough points by decreasing size, then by position.
fn numbered(points: &[Vec3], roots: &[Option<u32>], least: usize) -> Instances {
    let mut sets: BTreeMap<u32, (usize, Vec3)> = BTreeMap::new();
    for (root, &x) in roots
        .iter()
        .zip(points)
        .filter_map(|(root, x)| Some(((*root)?, x)))
    {
        let (size, first) = sets.entry(root).or_insert((0, x));
        *size += 1;
        if by_place(x, *first) == Ordering::Less {
            *first = x;
        }
    }
    let mut sets: Vec<(u32, usize, Vec3)> = sets
        .into_iter()
        .map(|(root, (size, first))| (root, size, first))
        .filter(|&(_, size, _)| size >= least)
        .collect();
    sets.sort_by(|a, b| {
        Reverse(a.1)
            .cmp(&Reverse(b.1))
            .then_with(|| by_place(a.2, b.2))
    });
    let number: BTreeMap<u32, u32> = (1..)
        .zip(&sets)
        .map(|(number, &(root, ..))| (root, number))
        .collect();
    let of_point = |root: &Option<u32>| {
        root.and_then(|root| number.get(&root).copied())
            .unwrap_or(0)
    };
    Instances {
        of_points: roots.iter().map(of_point).collect(),
        sizes: sets.iter().map(|set| set.1).collect(),
    }
}

fn by_place(a: Vec3, b: Vec3) -> Ordering {
    a.x.total_cmp(&b.x)
        .then(a.y.total_cmp(&b.y))
        .then(a.z.total_cmp(&b.z))
}

/// Points in cubic cells whose edge length is the neighbour radius.
pub(super) struct Cells<'a> {
    points: &'a [Vec3],
    radius: f64,
    cells: FxHashMap<IVec3, Vec<u32>>,
}

impl<'a> Cells<'a> {
    /// Sorts points into cells. Non-finite points are excluded.
    pub(super) fn new(points: &'a [Vec3], radius: f64) -> Self {
        let mut cells: FxHashMap<IVec3, Vec<u32>> = FxHashMap::default();
        for (k, x) in points.iter().enumerate().filter(|(_, x)| x.is_finite()) {
            cells.entry(cell_of(*x, radius)).or_default().push(k as u32);
        }
        Self {
            points,
            radius,
            cells,
        }
    }

    /// Returns the other points within the radius of point `of`.
    pub(super) fn neighbours(&self, of: usize) -> impl Iterator<Item = usize> + '_ {
        let x = self.points[of];
        let centre = cell_of(x, self.radius);
        let squared = self.radius * self.radius;
        (0..27)
            .map(move |k| centre + IVec3::new(k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1))
            .filter_map(|cell| self.cells.get(&cell))
            .flatten()
            .map(|&k| k as usize)
            .filter(move |&k| k != of && f64::from(self.points[k].distance_squared(x)) <= squared)
    }
}

fn cell_of(x: Vec3, side: f64) -> IVec3 {
    let cell: DVec3 = (x.as_dvec3() / side).floor();
    cell.as_ivec3()
}

/// Returns the mask with pixels of `inside` relabelled by the points they see, if any changes.
///
/// A pixel takes the choice of the nearest pixel that sees a point, along a path through pixels of
/// `inside`. `choice` has one entry per point of `votes`; `None` is no choice. Returns `None` if no
/// pixel changes.
///
/// Instances are written to the masks, which then vote again, instead of only to the cloud. Labels
/// of points always follow from the masks, so a later vote does not undo the split.
#[must_use]
pub fn split_mask(
    votes: &Votes,
    choice: &[Option<LabelId>],
    frame: usize,
    mask: &LabelMask,
    mut inside: Region,
) -> Option<LabelMask> {
    let mut split = mask.clone();
    let mut open = VecDeque::new();
    for (point, x, y) in votes.observations(frame) {
        let Some(chosen) = choice[point].filter(|_| x < mask.width && y < mask.height) else {
            continue;
        };
        let at = y as usize * mask.width as usize + x as usize;
        if std::mem::take(&mut inside.inside[at]) {
            split.ids[at] = chosen;
            open.push_back(at);
        }
    }
    if open.is_empty() {
        return None;
    }
    while let Some(at) = open.pop_front() {
        for next in adjacent(at, mask.width as usize, mask.ids.len())
            .into_iter()
            .flatten()
        {
            if std::mem::take(&mut inside.inside[next]) {
                split.ids[next] = split.ids[at];
                open.push_back(next);
            }
        }
    }
    Some(split)
}

/// Returns the pixels that share a side with pixel `at`.
fn adjacent(at: usize, width: usize, count: usize) -> [Option<usize>; 4] {
    let column = at % width;
    [
        at.checked_sub(width),
        (column > 0).then(|| at - 1),
        (column + 1 < width).then_some(at + 1),
        (at + width < count).then_some(at + width),
    ]
}
