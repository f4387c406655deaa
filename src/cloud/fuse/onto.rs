use serde::{Deserialize, Serialize};

use super::fused::{FuseReport, Fused, finish, labelled, naming};
use super::views::Views;
use super::visibility::measured_tolerance;
use super::vote::{SeenPoints, VoteOptions, vote};
use crate::points::spacing;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_geometry::DepthTolerance;
use ostra_masks::LabelTree;

/// Options for voting masks onto the points of an existing cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OntoOptions {
    /// Minimum share of the votes for a label, 0–1. Points below it become unlabelled.
    pub min_confidence: f32,
    /// Whether unlabelled points are dropped.
    pub drop_unlabelled: bool,
    /// Maximum depth difference between a frame and a point that it sees, as a share of the depth.
    ///
    /// Two point spacings are added to it. Ranges from 0 to 1. With `None` it is measured so that
    /// nine tenths of the depths are within it.
    pub depth_tolerance: Option<f32>,
    /// Radius of a point in world units, above 0, used for occlusion where frames have no depth.
    ///
    /// With `None` it is derived from the point spacing.
    pub radius: Option<f64>,
    /// Memory budget in bytes for the pairs that voted, as in [`super::FuseOptions`].
    pub pair_budget_bytes: usize,
}

impl Default for OntoOptions {
    fn default() -> Self {
        Self {
            min_confidence: 0.0,
            drop_unlabelled: false,
            depth_tolerance: None,
            radius: None,
            pair_budget_bytes: 512 << 20,
        }
    }
}

/// The frames that vote onto an existing cloud, their labels and the options of the vote.
#[derive(Clone, Copy)]
pub struct MaskVote<'a> {
    /// The frames with their masks.
    pub views: &'a dyn Views,
    /// The labels of the masks.
    pub tree: &'a LabelTree,
    /// The options of the vote.
    pub options: &'a OntoOptions,
}

/// Labels the points of an existing cloud by the masks of all frames that see them.
///
/// Visibility is decided by the depth of a frame. If a frame has no depth, the cloud itself is
/// rendered into the frame as discs.
///
/// # Errors
///
/// Returns the errors of [`vote_seen`]. Returns [`SceneError::Request`] if no frame has both a mask
/// and a camera.
pub fn vote_onto(
    cloud: &LabelledCloud,
    mask_vote: &MaskVote<'_>,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    let fused = vote_seen(cloud.clone(), &SeenPoints::new(), mask_vote, progress)?;
    if fused.report.frames_voted == 0 {
        return Err(SceneError::Request(
            "no frame has both a mask and a camera with a pose; add masks first".into(),
        ));
    }
    Ok(fused)
}

/// Labels points when it is known which frames see them.
///
/// A frame listed in `seen` votes exactly in the pixels listed there. All other frames vote as in
/// [`vote_onto`].
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the cloud is empty, or if the size of a mask or depth differs
/// from that of its frame. Returns the error of a frame that cannot be read. Returns
/// [`SceneError::Stopped`] if the job is stopped.
pub fn vote_seen(
    cloud: LabelledCloud,
    seen: &SeenPoints,
    mask_vote: &MaskVote<'_>,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    let MaskVote {
        views,
        tree,
        options,
    } = *mask_vote;
    let mut report = FuseReport::default();
    let frames = views.frames().iter();
    let no_camera: Vec<&str> = frames
        .filter(|frame| frame.posed_camera().is_none())
        .map(|frame| frame.name.as_str())
        .collect();
    report.warnings.extend(naming(
        [
            "has no camera and is left out",
            "have no camera and are left out",
        ],
        &no_camera,
    ));
    let spacing = spacing(&cloud.positions).ok_or_else(|| {
        SceneError::Request("the cloud has too few points to label; give another".into())
    })?;
    let by_depth = |&index: &usize| views.has_depth(index) && !seen.contains_key(&index);
    let with_depth: Vec<usize> = (0..views.frames().len()).filter(by_depth).collect();
    report.depth_tolerance = match options.depth_tolerance {
        Some(share) => f64::from(share),
        None => measured_tolerance(&cloud.positions, views, &with_depth, 2.0 * spacing)?,
    };
    let vote_options = VoteOptions {
        tolerance: DepthTolerance {
            absolute: 2.0 * spacing,
            relative: report.depth_tolerance,
        },
        radius: options.radius.unwrap_or(2.0 * spacing),
        min_confidence: options.min_confidence,
        pair_budget_bytes: options.pair_budget_bytes,
    };
    let voted = vote(&cloud.positions, seen, views, &vote_options, progress)?;
    (report.frames_fused, report.frames_voted) = (seen.len(), voted.frames);
    Ok(finish(
        labelled(cloud, &voted.votes, tree),
        voted.votes,
        options.drop_unlabelled,
        report,
    ))
}
