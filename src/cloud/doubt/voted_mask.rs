use rayon::prelude::*;

use super::lifted::Lifted;
use super::sighted::Sighted;
use crate::fuse::Votes;
use crate::points::Neighbours;
use crate::{LabelledCloud, SceneError};
use ostra_frames::{DepthMap, Frame};
use ostra_masks::{LabelId, LabelMask};

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
