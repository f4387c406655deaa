//! Selection steps, and the selector that runs them.

use std::sync::Arc;

use glam::{DVec2, Mat4, Vec3};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::eye::{Eye, seen_in};
use super::grow::{Likeness, pieces};
use crate::points::Neighbours;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_frames::Frame;
use ostra_masks::{LabelId, LabelTree, fill_polygons, stroke};

/// One step of a selection; a list of steps can be saved and run again.
///
/// Commands store the steps rather than the indices of the selected points, so that a recipe
/// replayed on a cloud with other points makes the same selection there.
#[expect(
    clippy::large_enum_variant,
    reason = "a selection holds a handful of steps"
)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SelectStep {
    /// Adds the points visible in a region of the view, or removes them.
    Seen(SeenRegion),
    /// Adds all points of a label.
    Label(LabelId),
    /// Keeps only the points of a label.
    Only(LabelId),
    /// Adds similar points around the selection.
    Grow(Likeness),
    /// Keeps only the n-th largest connected component, counted from 0.
    Piece(usize),
}

/// A lasso, box or brush stroke over the view from a viewpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SeenRegion {
    /// The viewpoint.
    pub eye: Eye,
    /// Corners of the lasso or points of the stroke, in pixels of the view.
    #[schemars(with = "Vec<[f64; 2]>")]
    pub points_px: Vec<DVec2>,
    /// Radius of the brush in pixels; 0 means that the points are the corners of a lasso.
    #[serde(default)]
    pub radius_px: f64,
    /// Whether the points are removed from the selection.
    #[serde(default)]
    pub remove: bool,
    /// Labels that are hidden, each with all its descendants.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub hidden: Vec<LabelId>,
    /// The only label that is shown, with all its descendants; `None` shows all labels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub isolated: Option<LabelId>,
    /// If set, only points whose label won less than this share of the votes are shown, 0–1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "doubtful_below")]
    pub uncertain_below: Option<f32>,
    /// Transform from world space to the cube from −1 to 1 that bounds the visible points.
    ///
    /// With `None`, all of world space is visible.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<[f32; 16]>")]
    pub cube_from_world: Option<Mat4>,
}

/// A cloud that is prepared for selections.
#[derive(Debug)]
pub struct Selector {
    cloud: Arc<LabelledCloud>,
    neighbours: Neighbours,
    spacing: f32,
}

/// Selected points of a cloud.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Selection {
    /// Indices of the points, in ascending order.
    pub points: Vec<u32>,
    /// Number of connected components of the points.
    pub pieces: usize,
}

impl Selector {
    /// Creates a selector and builds its neighbour index.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] if the cloud has fewer than two distinct points.
    pub fn new(cloud: Arc<LabelledCloud>) -> Result<Self, SceneError> {
        let neighbours = Neighbours::new(&cloud.positions);
        let made = neighbours.and_then(|near| Some((near.spacing(&cloud.positions)?, near)));
        let (spacing, neighbours) = made.ok_or_else(|| {
            SceneError::Request("the cloud has too few points to choose from; fuse first".into())
        })?;
        Ok(Self {
            cloud,
            neighbours,
            spacing: spacing as f32,
        })
    }

    /// Returns the cloud.
    #[must_use]
    pub fn cloud(&self) -> &Arc<LabelledCloud> {
        &self.cloud
    }

    /// Returns the typical distance between neighbouring points, in world units.
    #[must_use]
    pub fn spacing(&self) -> f32 {
        self.spacing
    }

    /// Returns the index of the point nearest to a position, and its distance.
    #[must_use]
    pub fn nearest(&self, to: Vec3) -> (usize, f32) {
        self.neighbours.nearest(to)
    }

    /// Runs the steps in order, starting with an empty selection.
    ///
    /// `frames` are those that steps refer to as viewpoints. `tree` determines the descendants of
    /// hidden labels. The same steps give the same points for any number of threads.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] if a viewpoint or component does not exist or a number is
    /// out of range. Returns [`SceneError::Mask`] if a lasso is not made of numbers. Returns
    /// [`SceneError::Stopped`] if the job is stopped.
    pub fn select(
        &self,
        frames: &[Frame],
        tree: &LabelTree,
        steps: &[SelectStep],
        progress: &Progress,
    ) -> Result<Selection, SceneError> {
        let mut inside = vec![false; self.cloud.len()];
        for (done, step) in steps.iter().enumerate() {
            progress.step(done, steps.len())?;
            self.take(step, frames, tree, &mut inside, progress)?;
        }
        let points = indices(&inside);
        let pieces = pieces(&self.cloud.positions, self.spacing, &points).len();
        Ok(Selection { points, pieces })
    }

    fn take(
        &self,
        step: &SelectStep,
        frames: &[Frame],
        tree: &LabelTree,
        inside: &mut [bool],
        progress: &Progress,
    ) -> Result<(), SceneError> {
        let of = |label: LabelId| self.cloud.labels.iter().map(move |&own| own == label);
        match step {
            SelectStep::Seen(region) => {
                let seen = self.seen(region, frames, tree)?;
                seen.into_iter()
                    .for_each(|point| inside[point as usize] = !region.remove);
            }
            SelectStep::Label(label) => inside
                .iter_mut()
                .zip(of(*label))
                .for_each(|(inside, has)| *inside |= has),
            SelectStep::Only(label) => inside
                .iter_mut()
                .zip(of(*label))
                .for_each(|(inside, has)| *inside &= has),
            SelectStep::Grow(likeness) => {
                let (cloud, neighbours) = (&self.cloud, &self.neighbours);
                likeness.grow(cloud, neighbours, self.spacing, inside, progress)?;
            }
            SelectStep::Piece(rank) => {
                let pieces = pieces(&self.cloud.positions, self.spacing, &indices(inside));
                let piece = pieces.get(*rank).ok_or_else(|| {
                    SceneError::Request(format!(
                        "there is no part {rank}: the chosen points are in {}; parts count from 0",
                        pieces.len()
                    ))
                })?;
                inside.fill(false);
                piece
                    .iter()
                    .for_each(|&point| inside[point as usize] = true);
            }
        }
        Ok(())
    }

    fn seen(
        &self,
        seen: &SeenRegion,
        frames: &[Frame],
        tree: &LabelTree,
    ) -> Result<Vec<u32>, SceneError> {
        let sight = seen.eye.sight(frames)?;
        let (width, height) = (sight.camera.width, sight.camera.height);
        let region = if seen.radius_px == 0.0 {
            fill_polygons(width, height, std::slice::from_ref(&seen.points_px))?
        } else {
            stroke(width, height, &seen.points_px, seen.radius_px)?
        };
        let is_hidden = |id: &LabelId| {
            let path = tree.path(*id);
            let is_on_path = |id: &LabelId| path.contains(id);
            seen.hidden.iter().any(is_on_path)
                || seen.isolated.is_some_and(|only| !is_on_path(&only))
        };
        let ids = tree.iter().map(|label| label.id).chain([LabelId::NONE]);
        let hidden: Vec<LabelId> = ids.filter(is_hidden).collect();
        let is_there = |x: Vec3| {
            seen.cube_from_world
                .is_none_or(|cube| cube.transform_point3(x).abs().max_element() <= 1.0)
        };
        let stands_out = |point: usize| {
            seen.uncertain_below
                .is_none_or(|below| self.cloud.is_uncertain(point, below))
        };
        let is_drawn = |point: usize| {
            !hidden.contains(&self.cloud.labels[point])
                && stands_out(point)
                && is_there(self.cloud.positions[point])
        };
        Ok(seen_in(
            &self.cloud.positions,
            f64::from(self.spacing),
            &sight,
            &region,
            is_drawn,
        ))
    }
}

fn indices(inside: &[bool]) -> Vec<u32> {
    (0..inside.len() as u32)
        .into_par_iter()
        .filter(|&point| inside[point as usize])
        .collect()
}
