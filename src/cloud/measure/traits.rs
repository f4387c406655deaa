//! Measures all traits of a cloud by label and instance.

use glam::DVec3;

use super::body::{Body, join_rods};
use super::extent::{extent_traits, surface_areas};
use super::ground::{Ground, GroundChoice};
use super::insertion::insertion_angle;
use super::point_sets::{components, median_spacing, thinned};
use super::trait_table::{Dimension, Trait, TraitRow};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::{LabelId, LabelTree};

/// Options of trait measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasureOptions {
    /// Tree depth of the measured labels (1 = top level).
    ///
    /// Deeper labels count as part of theirs. With `None`, every label is measured that has points
    /// itself or below it.
    pub level: Option<usize>,
    /// Maximum distance between connected points, in point spacings, 1.5–10.
    ///
    /// The point spacing is the median distance to the nearest neighbour.
    pub link: f64,
    /// Minimum number of points of an instance, 4–1 000 000.
    pub min_points: usize,
    /// Maximum gap across which rods are joined, as a multiple of their total length, 0–10.
    pub bridge: f64,
    /// Length of the blade over which insertion angles are measured, in world units, above 0.
    ///
    /// The default is 30 mm in a metric cloud.
    pub insertion_reach: f64,
    /// The plane above which heights are measured.
    pub ground: GroundChoice,
}

impl Default for MeasureOptions {
    fn default() -> Self {
        Self {
            level: None,
            link: 3.0,
            min_points: 50,
            bridge: 1.5,
            insertion_reach: 0.03,
            ground: GroundChoice::Fitted,
        }
    }
}

/// Number of points of a label above which they are thinned further.
const MOST_POINTS: usize = 200_000;

/// A label with its instances.
pub(super) struct MeasuredLabel {
    pub(super) id: LabelId,
    count: usize,
    /// Thinned points, without isolated specks.
    points: Vec<DVec3>,
    /// Number of thinned points in such specks.
    outliers: usize,
    /// Spacing of the thinned points.
    spacing: f64,
    /// Surface area covered by `points`.
    area: f64,
    pub(super) bodies: Vec<Body>,
}

/// Measures every label of a cloud.
///
/// Area, volumes, sizes and heights above the ground are measured for the label as a whole
/// (instance 0) and for each instance (1 = the one with the most points). The whole also has the
/// number of points and instances. An instance also has its length along the medial curve, the
/// diameter of a rod or the width of a sheet, and the angle at which a sheet leaves a rod. Rows are
/// ordered by label id, then by instance.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if an option is out of range or the cloud has no labelled
/// points. Returns [`SceneError::Stopped`] if the job is stopped.
pub fn measure(
    cloud: &LabelledCloud,
    options: &MeasureOptions,
    progress: &Progress,
) -> Result<Vec<TraitRow>, SceneError> {
    options.check()?;
    progress.stage("measure")?;
    let ids: Vec<LabelId> = cloud
        .tree
        .iter()
        .map(|label| label.id)
        .filter(|&id| wanted(&cloud.tree, id, options))
        .collect();
    let mut labels = Vec::new();
    for (k, &id) in ids.iter().enumerate() {
        progress.step(k, 2 * ids.len())?;
        let points = points_of(cloud, id);
        if !points.is_empty() {
            labels.push(MeasuredLabel::new(id, &points, options, progress)?);
        }
    }
    if labels.is_empty() {
        return Err(SceneError::Request(
            "the cloud has no labelled points to measure; fuse masks into it first".into(),
        ));
    }
    let ground = Ground::of(cloud, &options.ground, progress)?;
    let mut rows = Vec::new();
    for (k, label) in labels.iter().enumerate() {
        progress.step(ids.len() + k, ids.len() + labels.len())?;
        for (instance, mut traits) in label.traits().into_iter().enumerate() {
            let body = instance.checked_sub(1).map(|k| &label.bodies[k]);
            let points = body.map_or(&label.points, |body| &body.points);
            let outliers = if body.is_some() { 0 } else { label.outliers };
            let heights = ground.iter().flat_map(|ground| ground.traits(points));
            traits.extend(heights.map(|found| found.leaving_out(outliers)));
            traits.extend(
                body.and_then(|body| insertion(&cloud.tree, label.id, body, &labels, options)),
            );
            rows.extend(
                traits
                    .into_iter()
                    .map(|found| found.row(&cloud.tree, label.id, instance)),
            );
        }
    }
    Ok(rows)
}

impl MeasureOptions {
    pub(super) fn check(&self) -> Result<(), SceneError> {
        let ranges = [
            ("link", self.link, 1.5, 10.0),
            (
                "smallest instance in points",
                self.min_points as f64,
                4.0,
                1e6,
            ),
            ("bridge", self.bridge, 0.0, 10.0),
            (
                "length for insertion angles",
                self.insertion_reach,
                f64::MIN_POSITIVE,
                f64::MAX,
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

fn wanted(tree: &LabelTree, id: LabelId, options: &MeasureOptions) -> bool {
    let depth = tree.depth(id);
    let is_leaf = || !tree.iter().any(|label| label.parent == Some(id));
    options
        .level
        .is_none_or(|level| depth == level.max(1) || (depth < level && is_leaf()))
}

/// Returns the points labelled `id` or a descendant of it in the tree.
///
/// Non-finite points are excluded.
pub(super) fn points_of(cloud: &LabelledCloud, id: LabelId) -> Vec<DVec3> {
    let mut counts = vec![false; usize::from(u16::MAX) + 1];
    for label in cloud
        .tree
        .iter()
        .filter(|label| cloud.tree.path(label.id).contains(&id))
    {
        counts[usize::from(label.id.0)] = true;
    }
    let labelled = cloud.positions.iter().zip(&cloud.labels);
    labelled
        .filter(|(x, label)| counts[usize::from(label.0)] && x.is_finite())
        .map(|(x, _)| x.as_dvec3())
        .collect()
}

/// Returns whether one label is the other or an ancestor of it.
fn related(tree: &LabelTree, a: LabelId, b: LabelId) -> bool {
    tree.path(a).contains(&b) || tree.path(b).contains(&a)
}

/// Returns the angle at which a body leaves a rod of an unrelated label.
fn insertion(
    tree: &LabelTree,
    id: LabelId,
    body: &Body,
    labels: &[MeasuredLabel],
    options: &MeasureOptions,
) -> Option<Trait> {
    let others = labels.iter().filter(|other| !related(tree, other.id, id));
    let rods = others.flat_map(|label| label.rods().map(move |rod| (label.id, rod)));
    let (angle, (of, rod)) = insertion_angle(body, rods, options.insertion_reach)?;
    let name = tree.get(of).map_or("", |label| label.name.as_str());
    let definition = format!(
        "angle between the axis of the rod that the sheet leaves ({name}) and the chord of its midrib's first part, 0 to 90"
    );
    let points = body.points.len() + rod.points.len();
    Some(Trait::new(
        "insertion_angle",
        angle,
        Dimension::Angle,
        definition,
        points,
    ))
}

impl MeasuredLabel {
    pub(super) fn new(
        id: LabelId,
        all: &[DVec3],
        options: &MeasureOptions,
        progress: &Progress,
    ) -> Result<Self, Stopped> {
        let mut least = median_spacing(all);
        let mut points = if least > 0.0 {
            thinned(all, least)
        } else {
            all.to_vec()
        };
        while points.len() > MOST_POINTS && least > 0.0 {
            progress.check()?;
            least *= (points.len() as f64 / MOST_POINTS as f64).sqrt().max(1.1);
            points = thinned(&points, least);
        }
        let spacing = median_spacing(&points);
        let areas = surface_areas(&points, spacing, progress)?;
        let reach = options.link * spacing;
        let pieces = if spacing > 0.0 {
            components(&points, reach)
        } else {
            Vec::new()
        };
        let mut bodies = Vec::new();
        for group in pieces
            .iter()
            .filter(|group| group.len() >= options.min_points)
        {
            progress.check()?;
            let of_group = group.iter().map(|&k| points[k]).collect();
            let area = group.iter().map(|&k| areas[k]).sum();
            bodies.push(Body::new(of_group, area, spacing, reach, progress)?);
        }
        let (kept, bodies) = (
            bulk(&pieces, points.len()),
            join_rods(bodies, options.bridge),
        );
        let (outliers, area) = (
            points.len() - kept.len(),
            kept.iter().map(|&k| areas[k]).sum(),
        );
        let points = kept.iter().map(|&k| points[k]).collect();
        Ok(Self {
            id,
            count: all.len(),
            points,
            outliers,
            spacing,
            area,
            bodies,
        })
    }

    fn rods(&self) -> impl Iterator<Item = &Body> {
        self.bodies.iter().filter(|body| body.diameter().is_some())
    }

    /// Returns the traits of the whole label, then those of each instance.
    ///
    /// Traits that depend on other labels are not included.
    fn traits(&self) -> Vec<Vec<Trait>> {
        let count = |name, value: usize, definition, points| {
            Trait::new(name, value as f64, Dimension::Count, definition, points)
        };
        let all = self.count;
        let mut whole = vec![
            count(
                "points",
                all,
                "number of points with the label or one below it",
                all,
            ),
            count(
                "instances",
                self.bodies.len(),
                "number of connected groups of points",
                self.points.len() + self.outliers,
            ),
        ];
        let extent = extent_traits(&self.points, self.area, self.spacing);
        whole.extend(
            extent
                .into_iter()
                .map(|found| found.leaving_out(self.outliers)),
        );
        std::iter::once(whole)
            .chain(self.bodies.iter().map(|body| body.traits(self.spacing)))
            .collect()
    }
}

/// Size of a speck, as a share of the points of the largest component.
const SPECK: f64 = 0.01;
/// Share of the points above which specks are kept, because the object consists of small parts.
const MAX_OUTLIER_SHARE: f64 = 0.05;

/// Returns the indices of all points except those in isolated specks, in ascending order.
///
/// `pieces` are connected components, the largest first. `points` is the total number of points.
fn bulk(pieces: &[Vec<usize>], points: usize) -> Vec<usize> {
    let largest = pieces.first().map_or(0, Vec::len);
    let is_speck = |piece: &&Vec<usize>| (piece.len() as f64) < SPECK * largest as f64;
    let outliers: usize = pieces.iter().filter(is_speck).map(Vec::len).sum();
    if outliers == 0 || outliers as f64 > MAX_OUTLIER_SHARE * points as f64 {
        return (0..points).collect();
    }
    let mut kept: Vec<usize> = pieces
        .iter()
        .filter(|piece| !is_speck(piece))
        .flatten()
        .copied()
        .collect();
    kept.sort_unstable();
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the number of points kept of components with the given sizes.
    fn kept(sizes: &[usize]) -> usize {
        let mut next = 0..;
        let pieces: Vec<Vec<usize>> = sizes
            .iter()
            .map(|&size| next.by_ref().take(size).collect())
            .collect();
        bulk(&pieces, sizes.iter().sum()).len()
    }

    #[test]
    fn specks_are_left_out_unless_they_make_up_the_object() {
        assert_eq!(kept(&[1000, 500, 9, 1]), 1500);
        assert_eq!(kept(&[1000, 10]), 1010, "1 % is no speck");
        assert_eq!(kept(&[3; 300]), 900, "grains");
        assert_eq!(
            kept(&[vec![1000], vec![9; 50]].concat()),
            1450,
            "a third of the thing"
        );
        assert_eq!(kept(&[]), 0);
    }
}
