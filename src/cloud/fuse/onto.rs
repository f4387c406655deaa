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

/// How masks vote on the points of a given cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct OntoOptions {
    /// Points whose label won a smaller share of the votes become unlabelled; 0–1.
    pub min_confidence: f32,
    /// Leave points without a label out.
    pub drop_unlabelled: bool,
    /// A frame with depth sees a point when their depths differ by at most this share of the depth, and two spacings of
    /// the cloud; 0–1. `None` = measured: what nine tenths of the depths keep to.
    pub depth_tolerance: Option<f32>,
    /// Radius in world units that a point covers where frames have no depth and the cloud hides itself, above 0.
    /// `None` = from the spacing of the points.
    pub radius: Option<f64>,
    /// Memory for the (frame, pixel) pairs that voted, as in [`super::FuseOptions`].
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

/// Labels the points of a given cloud by the masks of all frames that see them. A frame's depth says what it sees; where
/// it has none the cloud itself does, drawn into the frame as discs.
///
/// # Errors
/// As [`vote_seen`], and [`SceneError::Request`] where no frame has both a mask and a camera.
pub fn vote_onto(
    cloud: &LabelledCloud,
    views: &dyn Views,
    tree: &LabelTree,
    options: &OntoOptions,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    let fused = vote_seen(
        cloud.clone(),
        &SeenPoints::new(),
        views,
        tree,
        options,
        progress,
    )?;
    if fused.report.frames_voted == 0 {
        return Err(SceneError::Request(
            "no frame has both a mask and a camera with a pose; add masks first".into(),
        ));
    }
    Ok(fused)
}

/// Labels points where it is known which frames see them: a frame in `seen` votes in the very pixels that are named there
/// and nowhere else, all others as in [`vote_onto`].
///
/// # Errors
/// [`SceneError::Request`] for an empty cloud, a mask or depth of another size than its frame; what reading a frame says;
/// [`SceneError::Stopped`].
pub fn vote_seen(
    cloud: LabelledCloud,
    seen: &SeenPoints,
    views: &dyn Views,
    tree: &LabelTree,
    options: &OntoOptions,
    progress: &Progress,
) -> Result<Fused, SceneError> {
    let mut report = FuseReport::default();
    let frames = views.frames().iter();
    let no_camera: Vec<&str> = frames
        .filter(|frame| frame.posed_camera().is_none())
        .map(|frame| frame.name.as_str())
        .collect();
    report
        .warnings
        .extend(naming("have no camera and are left out", &no_camera));
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
