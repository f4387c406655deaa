//! Where the vote of all views contradicts a frame's mask, and what the mask would be by that vote.

use glam::{DVec2, Vec3};
use rayon::prelude::*;

use crate::fuse::Votes;
use crate::points::Neighbours;
use crate::{LabelledCloud, SceneError};
use ostra_frames::{DepthMap, Frame};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{LabelId, LabelMask, Region};

/// Pixels by which borders may differ: no mask is drawn to the pixel, and no point is seen to it.
const BORDER_PX: u32 = 2;

/// How far a frame's mask and the vote of all frames are apart, in pixels that see a point and have a label by one of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameDoubt {
    /// All of them.
    pub compared: usize,
    /// Those where both name different labels, and not only because a border lies a little aside.
    pub against: usize,
}

impl FrameDoubt {
    /// The share that disagrees, 0–1.
    #[must_use]
    pub fn share(&self) -> f32 {
        if self.compared == 0 {
            0.0
        } else {
            self.against as f32 / self.compared as f32
        }
    }
}

/// Compares a frame's mask with the labels of the points that the frame sees; `labels` holds one for each point that was
/// voted on. A pixel disagrees where the mask has the vote's label nowhere within two pixels, or the vote the mask's.
///
/// Uses the (frame, pixel, point) records of the vote, so that it needs no geometry and can run in the
/// background, mask by mask as they change.
#[must_use]
pub fn frame_doubt(
    votes: &Votes,
    labels: &[LabelId],
    frame: usize,
    mask: &LabelMask,
) -> FrameDoubt {
    let sighted = Sighted::new(votes, labels, frame, (mask.width, mask.height));
    let mut doubt = FrameDoubt::default();
    for (at, (&voted, &own)) in sighted.labels.iter().zip(&mask.ids).enumerate() {
        let Some(voted) = voted.filter(|&voted| voted != LabelId::NONE || own != LabelId::NONE)
        else {
            continue;
        };
        doubt.compared += 1;
        let differs = voted != own
            && (!mask_has_near(mask, at, BORDER_PX, voted)
                || !sighted.has_near(at, BORDER_PX, own));
        doubt.against += usize::from(differs);
    }
    doubt
}

/// The pixels where a frame's mask and the mask that the vote of all gives it name different labels, and not only because a
/// border lies a little aside.
#[must_use]
pub fn contradiction(mask: &LabelMask, voted: &LabelMask) -> Region {
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

/// The labels of the points that a frame sees, in the pixels that see them; `None` where no point is seen.
pub struct Sighted {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Row by row.
    pub labels: Vec<Option<LabelId>>,
}

impl Sighted {
    /// By the sightings that the votes know. Of several points in one pixel the first counts.
    fn new(votes: &Votes, labels: &[LabelId], frame: usize, (width, height): (u32, u32)) -> Self {
        let mut sighted = Self {
            width,
            height,
            labels: vec![None; width as usize * height as usize],
        };
        for (point, x, y) in votes.sightings(frame) {
            if x < width && y < height {
                sighted.labels[(y * width + x) as usize].get_or_insert(labels[point]);
            }
        }
        sighted
    }

    /// Whether a pixel at most `radius` columns and rows away sees this label.
    pub fn has_near(&self, at: usize, radius: u32, label: LabelId) -> bool {
        near(at, radius, (self.width, self.height)).any(|at| self.labels[at] == Some(label))
    }

    /// The label that the nearest pixel sees, at most `radius` columns and rows away; of equally near ones the first.
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
        let seen = near(at, radius, (self.width, self.height))
            .filter(|&other| self.labels[other].is_some());
        seen.min_by_key(|&other| squared(other))
            .and_then(|other| self.labels[other])
    }
}

/// Whether a pixel of a mask at most `radius` columns and rows away has this label.
pub fn mask_has_near(mask: &LabelMask, at: usize, radius: u32, label: LabelId) -> bool {
    near(at, radius, (mask.width, mask.height)).any(|at| mask.ids[at] == label)
}

/// The pixels at most `radius` columns and rows away, row by row.
fn near(at: usize, radius: u32, (width, height): (u32, u32)) -> impl Iterator<Item = usize> {
    let (x, y) = (at as u32 % width, at as u32 / width);
    let columns = x.saturating_sub(radius)..=(x + radius).min(width - 1);
    let rows = y.saturating_sub(radius)..=(y + radius).min(height - 1);
    rows.flat_map(move |y| columns.clone().map(move |x| (y * width + x) as usize))
}

/// How far from a pixel that sees a point others take its label, where a frame has no depth.
pub(crate) const FILL_PX: u32 = 2;
/// How far a pixel's place may lie from the point whose label it takes, in spacings of the cloud.
pub(crate) const REACH: f64 = 2.0;

/// The mask of a frame as the vote of all frames has it. Where the frame has depth, each pixel takes the label of the point
/// that lies at its place; elsewhere, that of the nearest pixel which sees one. Pixels that see nothing keep what `mask` has.
/// With `only`, pixels change that have or get one of these labels; all do where it is empty.
///
/// # Errors
/// [`SceneError::Request`] where the frame has no pose, the cloud has too few points, or the votes belong to another one.
pub fn voted_mask(
    (cloud, votes): (&LabelledCloud, &Votes),
    (number, frame): (usize, &Frame),
    depth: Option<&DepthMap>,
    mask: &LabelMask,
    only: &[LabelId],
) -> Result<LabelMask, SceneError> {
    let refuse = |why: &str| SceneError::Request(format!("frame '{}': {why}", frame.name));
    if votes.len() != cloud.len() {
        return Err(refuse("the votes belong to another cloud; fuse again"));
    }
    let voted = match depth {
        Some(depth) => by_depth(cloud, frame, depth)
            .ok_or_else(|| refuse("it has no camera, or the cloud no points"))?,
        None => by_sight(&Sighted::new(
            votes,
            &cloud.labels,
            number,
            (mask.width, mask.height),
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

fn by_sight(sighted: &Sighted) -> Vec<Option<LabelId>> {
    (0..sighted.labels.len())
        .into_par_iter()
        .map(|at| sighted.nearest(at, FILL_PX))
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

/// A frame's pixels in 3-D, by its depth.
pub(crate) struct Lifted<'a> {
    camera: &'a Camera,
    world_from_camera: Pose,
    depth: &'a DepthMap,
}

impl<'a> Lifted<'a> {
    /// `None` where the frame has no camera.
    pub(crate) fn new(frame: &'a Frame, depth: &'a DepthMap) -> Option<Self> {
        let (camera, pose) = frame.posed_camera()?;
        Some(Self {
            camera,
            world_from_camera: pose.inverse(),
            depth,
        })
    }

    /// Where a pixel's surface lies in the world; `None` where the depth is not known.
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
