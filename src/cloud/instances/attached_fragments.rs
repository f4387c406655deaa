use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::cluster::NeighbourGrid;
use crate::points::spacing;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// Minimum number of points of a fragment; smaller ones are noise.
const LEAST_POINTS: usize = 10;
/// Maximum share of a fragment's points that touch labelled ones.
///
/// An attached fragment touches its object at a neck; a fragment that lies along the object is its
/// rim.
const MOST_TOUCHING: f64 = 0.5;
/// Minimum share of one label among the labelled points that a fragment touches.
const LEAST_OF_ONE: f64 = 0.9;
/// Maximum size of a fragment as a share of the points of its label.
///
/// A larger fragment is an object of its own.
const MOST_OF_LABEL: f64 = 0.1;

/// A fragment: connected unlabelled points that are attached to a single label.
///
/// Typical fragments are tips and spans that masks missed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachedFragment {
    /// Label that the fragment is attached to.
    pub label: LabelId,
    /// Indices of the points, in ascending order.
    pub points: Vec<u32>,
}

/// Finds unlabelled fragments that are free in space except for a neck to points of one label.
///
/// `radius` is the maximum distance between neighbours, in spacings of the labelled points, 1.5–20.
/// The spacing is the median distance to the nearest neighbour. A fragment is left out if it
/// touches other labels more than marginally, lies along an object or is large compared with it.
/// Fragments are sorted by their first point, and do not depend on the order of the search.
///
/// Such fragments are tips and spans that masks missed. Fusion does not attach them by itself.
/// Labels of points follow from the masks, so the masks have to change, in a visible step that can
/// be undone.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the radius is out of range. Returns [`SceneError::Stopped`]
/// if the job is stopped.
pub fn attached_fragments(
    cloud: &LabelledCloud,
    radius: f64,
    progress: &Progress,
) -> Result<Vec<AttachedFragment>, SceneError> {
    if !(1.5..=20.0).contains(&radius) {
        return Err(SceneError::Request(format!(
            "the radius in spacings is {radius}; choose 1.5 to 20"
        )));
    }
    progress.stage("loose fragments")?;
    let labelled: Vec<u32> = (0..cloud.len() as u32)
        .filter(|&k| cloud.labels[k as usize] != LabelId::NONE)
        .collect();
    let places: Vec<Vec3> = labelled
        .iter()
        .map(|&k| cloud.positions[k as usize])
        .collect();
    let Some(spacing) = spacing(&places) else {
        return Ok(Vec::new());
    };
    let mut sizes: BTreeMap<LabelId, usize> = BTreeMap::new();
    labelled
        .iter()
        .for_each(|&k| *sizes.entry(cloud.labels[k as usize]).or_default() += 1);
    let cells = NeighbourGrid::new(&cloud.positions, radius * spacing);
    Free {
        cells: &cells,
        labels: &cloud.labels,
    }
    .pieces(&labelled, &sizes, progress)
}

/// The unlabelled points of a cloud.
struct Free<'a> {
    cells: &'a NeighbourGrid<'a>,
    labels: &'a [LabelId],
}

/// State of an unlabelled point during the search.
#[derive(Clone, Copy, PartialEq, Eq)]
enum PointState {
    Nothing,
    /// The point belongs to a fragment that was visited.
    Piece,
    /// The point belongs to a component that is too large to be a fragment.
    Large,
}

impl Free<'_> {
    fn pieces(
        &self,
        labelled: &[u32],
        sizes: &BTreeMap<LabelId, usize>,
        progress: &Progress,
    ) -> Result<Vec<AttachedFragment>, SceneError> {
        let most = sizes.values().map(|&size| allowed(size)).max().unwrap_or(0);
        let mut known = vec![PointState::Nothing; self.labels.len()];
        let mut pieces = Vec::new();
        let touching = self.touching(labelled, progress)?;
        for (done, &start) in touching.iter().enumerate() {
            progress.step(done, touching.len())?;
            if known[start as usize] != PointState::Nothing {
                continue;
            }
            let Some(points) = self.flood(start, most, &mut known, progress)? else {
                continue;
            };
            if let Some(label) = self.hangs_on(&points)
                && points.len() <= allowed(sizes[&label])
            {
                pieces.push(AttachedFragment { label, points });
            }
        }
        pieces.sort_by_key(|piece| piece.points[0]);
        Ok(pieces)
    }

    /// Returns the unlabelled points that touch labelled ones, in ascending order.
    fn touching(&self, labelled: &[u32], progress: &Progress) -> Result<Vec<u32>, SceneError> {
        let touched = |chunk: &[u32]| {
            progress.check()?;
            let around = chunk
                .iter()
                .flat_map(|&k| self.cells.neighbours(k as usize));
            let mut free: Vec<u32> = around
                .filter(|&k| !self.is_labelled(k))
                .map(|k| k as u32)
                .collect();
            free.sort_unstable();
            free.dedup();
            Ok(free)
        };
        let found: Vec<Vec<u32>> = labelled
            .par_chunks(4096)
            .map(touched)
            .collect::<Result<_, SceneError>>()?;
        let mut touching = found.concat();
        touching.sort_unstable();
        touching.dedup();
        Ok(touching)
    }

    fn is_labelled(&self, point: usize) -> bool {
        self.labels[point] != LabelId::NONE
    }

    /// Returns the connected unlabelled points around `start`.
    ///
    /// Returns `None` if there are more than `most`.
    fn flood(
        &self,
        start: u32,
        most: usize,
        known: &mut [PointState],
        progress: &Progress,
    ) -> Result<Option<Vec<u32>>, SceneError> {
        let mut points = vec![start];
        known[start as usize] = PointState::Piece;
        let (mut next, mut is_large) = (0, false);
        while let Some(&at) = points.get(next).filter(|_| !is_large) {
            if next.is_multiple_of(4096) {
                progress.check()?;
            }
            next += 1;
            for other in self
                .cells
                .neighbours(at as usize)
                .filter(|&k| !self.is_labelled(k))
            {
                is_large |= known[other] == PointState::Large;
                if known[other] == PointState::Nothing {
                    known[other] = PointState::Piece;
                    points.push(other as u32);
                }
            }
            is_large |= points.len() > most;
        }
        if is_large {
            points
                .iter()
                .for_each(|&point| known[point as usize] = PointState::Large);
            return Ok(None);
        }
        points.sort_unstable();
        Ok(Some(points))
    }

    /// Returns the label that a fragment is attached to by a neck, if there is exactly one.
    fn hangs_on(&self, points: &[u32]) -> Option<LabelId> {
        let mut touched: BTreeMap<LabelId, usize> = BTreeMap::new();
        let mut touching = 0;
        for &point in points {
            let labelled = self
                .cells
                .neighbours(point as usize)
                .filter(|&k| self.is_labelled(k));
            let touches = labelled
                .map(|k| *touched.entry(self.labels[k]).or_default() += 1)
                .count();
            touching += usize::from(touches > 0);
        }
        let all: usize = touched.values().sum();
        let (&label, &most) = touched.iter().max_by_key(|&(_, &count)| count)?;
        let is_neck = touching as f64 <= MOST_TOUCHING * points.len() as f64;
        let is_one = most as f64 >= LEAST_OF_ONE * all as f64;
        (is_neck && is_one && points.len() >= LEAST_POINTS).then_some(label)
    }
}

/// Returns the maximum size of a fragment attached to a label of `size` points.
fn allowed(size: usize) -> usize {
    (MOST_OF_LABEL * size as f64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEM: LabelId = LabelId(1);
    const LEAF: LabelId = LabelId(2);

    /// Returns a strip along x, three points wide and with unit spacing, with the given label.
    fn strip(columns: std::ops::Range<i32>, y: f32, label: LabelId) -> Vec<(Vec3, LabelId)> {
        columns
            .flat_map(|x| [0.0, 1.0, 2.0].map(|z| (Vec3::new(x as f32, y, z), label)))
            .collect()
    }

    fn found(parts: &[Vec<(Vec3, LabelId)>]) -> Vec<AttachedFragment> {
        let (positions, labels): (Vec<Vec3>, Vec<LabelId>) = parts.concat().into_iter().unzip();
        let mut cloud = LabelledCloud::from_positions(positions);
        cloud.labels = labels;
        attached_fragments(&cloud, 1.5, &Progress::default()).unwrap()
    }

    #[test]
    fn tip_and_span_attach_to_their_leaf() {
        let tip = found(&[
            strip(0..100, 0.0, LEAF),
            strip(100..108, 0.0, LabelId::NONE),
        ]);
        assert_eq!(
            tip,
            [AttachedFragment {
                label: LEAF,
                points: (300..324).collect()
            }]
        );
        let between = found(&[
            strip(0..60, 0.0, LEAF),
            strip(60..68, 0.0, LabelId::NONE),
            strip(68..120, 0.0, LEAF),
        ]);
        assert_eq!(between.len(), 1, "a span between two of a leaf");
    }

    #[test]
    fn rims_large_parts_noise_and_detached_parts_are_not_attached() {
        let leaf = strip(0..100, 0.0, LEAF);
        let free = LabelId::NONE;
        assert!(
            found(&[leaf.clone(), strip(10..18, 1.0, free)]).is_empty(),
            "a rim"
        );
        assert!(
            found(&[leaf.clone(), strip(100..140, 0.0, free)]).is_empty(),
            "a thing of its own"
        );
        assert!(
            found(&[leaf.clone(), strip(100..103, 0.0, free)]).is_empty(),
            "noise"
        );
        assert!(
            found(&[leaf.clone(), strip(103..111, 0.0, free)]).is_empty(),
            "it hangs on nothing"
        );
        let wall = strip(108..400, 0.0, free);
        assert!(
            found(&[leaf, strip(100..108, 0.0, free), wall]).is_empty(),
            "it hangs on the wall, too"
        );
    }

    #[test]
    fn fragment_touching_two_labels_is_not_assigned() {
        let both = found(&[
            strip(0..100, 0.0, LEAF),
            strip(100..108, 0.0, LabelId::NONE),
            strip(108..208, 0.0, STEM),
        ]);
        assert!(both.is_empty(), "{both:?}");
    }

    #[test]
    fn radius_out_of_range_is_an_error_and_no_labels_give_no_fragments() {
        let cloud = LabelledCloud::from_positions(vec![Vec3::ZERO, Vec3::X]);
        assert!(
            attached_fragments(&cloud, 0.5, &Progress::default())
                .unwrap_err()
                .to_string()
                .contains("radius")
        );
        assert!(
            attached_fragments(&cloud, 3.0, &Progress::default())
                .unwrap()
                .is_empty()
        );
    }
}
