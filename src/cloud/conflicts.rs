//! Conflicts between a frame's mask and the vote of all views, and the mask that the vote implies.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::fuse::Votes;
use crate::points::Neighbours;
use crate::{LabelledCloud, SceneError};
use ostra_frames::{DepthMap, Frame};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{LabelId, LabelMask, Region};

/// Tolerance of borders in pixels: neither masks nor visible points are accurate to the pixel.
const BORDER_PX: u32 = 2;

/// Disagreement between a frame's mask and the vote of all frames.
///
/// Counts pixels that see a point and have a label in the mask or in the vote.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameConflict {
    /// Number of compared pixels.
    pub compared: usize,
    /// Number of pixels with different labels, except where only a border is slightly displaced.
    pub against: usize,
}

impl FrameConflict {
    /// Returns the share of pixels that disagree, 0–1.
    #[must_use]
    pub fn share(&self) -> f32 {
        if self.compared == 0 {
            0.0
        } else {
            self.against as f32 / self.compared as f32
        }
    }
}

/// Compares a frame's mask with the labels of the points that the frame sees.
///
/// `labels` has one entry per point that was voted on. A pixel disagrees if the mask does not have
/// the vote's label within two pixels, or the vote does not have the mask's label there.
///
/// This uses the (frame, pixel, point) records of the vote. It therefore needs no geometry and can
/// run in the background, mask by mask as they change.
#[must_use]
pub fn frame_conflict(
    votes: &Votes,
    labels: &[LabelId],
    frame: usize,
    mask: &LabelMask,
) -> FrameConflict {
    let observed = ObservedLabels::new(votes, labels, frame, mask.width, mask.height);
    let mut conflict = FrameConflict::default();
    for (at, (&voted, &own)) in observed.labels.iter().zip(&mask.ids).enumerate() {
        let Some(voted) = voted.filter(|&voted| voted != LabelId::NONE || own != LabelId::NONE)
        else {
            continue;
        };
        conflict.compared += 1;
        let differs = voted != own
            && (!mask_has_near(mask, at, BORDER_PX, voted)
                || !observed.has_near(at, BORDER_PX, own));
        conflict.against += usize::from(differs);
    }
    conflict
}

/// Returns the pixels where a frame's mask and the mask given by the vote have different labels.
///
/// Pixels where only a border is slightly displaced are excluded.
#[must_use]
pub fn mismatch(mask: &LabelMask, voted: &LabelMask) -> Region {
    let differs = |(at, (&own, &voted_id)): (usize, (&LabelId, &LabelId))| {
        own != voted_id
            && (!mask_has_near(mask, at, BORDER_PX, voted_id)
                || !mask_has_near(voted, at, BORDER_PX, own))
    };
    let inside = mask
        .ids
        .iter()
        .zip(&voted.ids)
        .enumerate()
        .map(differs)
        .collect();
    Region {
        width: mask.width,
        height: mask.height,
        inside,
    }
}

/// Labels of the points that a frame sees, per pixel; `None` where no point is visible.
pub struct ObservedLabels {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Labels in row-major order.
    pub labels: Vec<Option<LabelId>>,
}

impl ObservedLabels {
    /// Collects the sightings recorded in the votes.
    ///
    /// If several points are seen in one pixel, the first one counts.
    fn new(votes: &Votes, labels: &[LabelId], frame: usize, width: u32, height: u32) -> Self {
        let mut observed = Self {
            width,
            height,
            labels: vec![None; width as usize * height as usize],
        };
        for (point, x, y) in votes.observations(frame) {
            if x < width && y < height {
                observed.labels[(y * width + x) as usize].get_or_insert(labels[point]);
            }
        }
        observed
    }

    /// Returns whether a pixel within `radius` columns and rows sees this label.
    pub fn has_near(&self, at: usize, radius: u32, label: LabelId) -> bool {
        near(at, radius, self.width, self.height).any(|at| self.labels[at] == Some(label))
    }

    /// Returns the label seen by the nearest pixel within `radius` columns and rows.
    ///
    /// Among equally near pixels the first one wins.
    fn nearest(&self, at: usize, radius: u32) -> Option<LabelId> {
        if self.labels[at].is_some() {
            return self.labels[at];
        }
        let width = self.width as usize;
        let squared = |other: usize| {
            let (dx, dy) = (
                (other % width).abs_diff(at % width),
                (other / width).abs_diff(at / width),
            );
            dx * dx + dy * dy
        };
        let seen =
            near(at, radius, self.width, self.height).filter(|&other| self.labels[other].is_some());
        seen.min_by_key(|&other| squared(other))
            .and_then(|other| self.labels[other])
    }
}

/// Returns whether a pixel of a mask within `radius` columns and rows has this label.
pub fn mask_has_near(mask: &LabelMask, at: usize, radius: u32, label: LabelId) -> bool {
    near(at, radius, mask.width, mask.height).any(|at| mask.ids[at] == label)
}

/// Returns the pixels within `radius` columns and rows, in row-major order.
fn near(at: usize, radius: u32, width: u32, height: u32) -> impl Iterator<Item = usize> {
    let (x, y) = (at as u32 % width, at as u32 / width);
    let columns = x.saturating_sub(radius)..=(x + radius).min(width - 1);
    let rows = y.saturating_sub(radius)..=(y + radius).min(height - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| (y * width + x) as usize))
}

/// Distance over which pixels take the label of a pixel that sees a point, in frames without depth.
pub(crate) const FILL_PX: u32 = 2;
/// Maximum distance from a pixel's 3-D position to its point, in spacings of the cloud.
pub(crate) const REACH: f64 = 2.0;

/// A frame with its mask and, if there is one, its depth map.
#[derive(Clone, Copy)]
pub struct MaskedFrame<'a> {
    /// Number of the frame.
    pub number: usize,
    /// The frame.
    pub frame: &'a Frame,
    /// Its depth map.
    pub depth: Option<&'a DepthMap>,
    /// Its mask.
    pub mask: &'a LabelMask,
}

/// Returns the mask of a frame as given by the vote of all frames.
///
/// If the frame has depth, each pixel takes the label of the point at its 3-D position; otherwise
/// it takes that of the nearest pixel that sees a point. Pixels that see no point keep their label
/// in the frame's mask. If `only` is not empty, only pixels that have or receive one of these
/// labels change.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the frame has no pose, the cloud has too few points, or the
/// votes belong to another cloud.
pub fn voted_mask(
    cloud: &LabelledCloud,
    votes: &Votes,
    masked: &MaskedFrame<'_>,
    only: &[LabelId],
) -> Result<LabelMask, SceneError> {
    let (frame, mask) = (masked.frame, masked.mask);
    let refuse = |why: &str| SceneError::Request(format!("frame '{}': {why}", frame.name));
    if votes.len() != cloud.len() {
        return Err(refuse("the votes belong to another cloud; fuse again"));
    }
    let voted = match masked.depth {
        Some(depth) => by_depth(cloud, frame, depth)
            .ok_or_else(|| refuse("it has no camera, or the cloud no points"))?,
        None => by_observation(&ObservedLabels::new(
            votes,
            &cloud.labels,
            masked.number,
            mask.width,
            mask.height,
        )),
    };
    let is_meant = |id: LabelId| only.is_empty() || only.contains(&id);
    let choose = |(&own, &voted): (&LabelId, &Option<LabelId>)| match voted {
        Some(voted) if is_meant(voted) || is_meant(own) => voted,
        _ => own,
    };
    Ok(LabelMask {
        ids: mask.ids.iter().zip(&voted).map(choose).collect(),
        ..*mask
    })
}

fn by_observation(observed: &ObservedLabels) -> Vec<Option<LabelId>> {
    (0..observed.labels.len())
        .into_par_iter()
        .map(|at| observed.nearest(at, FILL_PX))
        .collect()
}

fn by_depth(
    cloud: &LabelledCloud,
    frame: &Frame,
    depth: &DepthMap,
) -> Option<Vec<Option<LabelId>>> {
    let lifted = Lifted::new(frame, depth)?;
    let points = Neighbours::new(&cloud.positions)?;
    let reach = (REACH * points.spacing(&cloud.positions)?) as f32;
    let label = |at: usize| {
        let (nearest, distance) = points.nearest(lifted.place(at)?);
        (distance <= reach).then(|| cloud.labels[nearest])
    };
    Some((0..depth.depths.len()).into_par_iter().map(label).collect())
}

/// The pixels of a frame in 3-D, by its depth.
pub(crate) struct Lifted<'a> {
    camera: &'a Camera,
    world_from_camera: Pose,
    depth: &'a DepthMap,
}

impl<'a> Lifted<'a> {
    /// Creates the unprojection, or returns `None` if the frame has no camera.
    pub(crate) fn new(frame: &'a Frame, depth: &'a DepthMap) -> Option<Self> {
        let (camera, pose) = frame.posed_camera()?;
        Some(Self {
            camera,
            world_from_camera: pose.inverse(),
            depth,
        })
    }

    /// Returns the position of a pixel's surface in world space, or `None` if its depth is unknown.
    pub(crate) fn place(&self, at: usize) -> Option<Vec3> {
        let depth = self.depth.depths[at];
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        let (x, y) = (at as u32 % self.depth.width, at as u32 / self.depth.width);
        let ray = self
            .camera
            .unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
            .extend(1.0);
        Some(
            self.world_from_camera
                .transform(ray * f64::from(depth))
                .as_vec3(),
        )
    }
}

#[cfg(test)]
mod tests;
