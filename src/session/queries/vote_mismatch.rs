use std::sync::Arc;

use anyhow::Result;

use super::cloud::CloudState;
use crate::query::QueryKey;
use ostra_cloud::SceneError;
use ostra_cloud::conflicts::mismatch;
use ostra_cloud::fuse::{naming, readable};
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelMask, Region, RunMask};
use ostra_project::Project;
use ostra_project::reusable_votes::MaskByVote;
use ostra_project::voted_cloud::VotedCloud;

/// The mask of a frame and the cloud it is compared with.
#[derive(Clone)]
pub(crate) struct VoteMismatchKey {
    frame: usize,
    mask: Arc<RunMask>,
    pub(crate) cloud: CloudState,
    labels: Vec<LabelId>,
    frames: Arc<Vec<Frame>>,
}

impl VoteMismatchKey {
    /// Creates the key for a frame's current mask, or returns `None` if it has none.
    pub(crate) fn new(project: &Project, frame: usize, cloud: CloudState) -> Option<Self> {
        let mask = project.mask_in_play(frame)?;
        let labels = project.labels.iter().map(|label| label.id).collect();
        Some(Self {
            frame,
            mask,
            cloud,
            labels,
            frames: Arc::clone(&project.frames),
        })
    }
}

impl PartialEq for VoteMismatchKey {
    fn eq(&self, other: &Self) -> bool {
        (self.frame, self.cloud, &self.labels) == (other.frame, other.cloud, &other.labels)
            && Arc::ptr_eq(&self.frames, &other.frames)
            && (Arc::ptr_eq(&self.mask, &other.mask) || self.mask == other.mask)
    }
}

impl QueryKey for VoteMismatchKey {
    const TITLE: &'static str = "compare with vote";

    /// The result of an earlier mask or cloud is shown for the frame until then.
    fn serves(&self, wanted: &Self) -> bool {
        self.frame == wanted.frame
    }
}

/// Returns the pixels where accepting the vote would change the label.
///
/// Labels that are hidden on the frame are ignored.
///
/// Locks are applied to the vote as they are when it is accepted, so that the stripes show what
/// *Use 3-D vote* would change. Differences within two pixels of a border are ignored, as in the
/// list of conflicts.
///
/// # Errors
///
/// Returns the errors of [`mask_by_vote`].
pub(crate) fn find_vote_mismatch(
    project: &Project,
    store: &FrameStore,
    voted: &VotedCloud,
    key: &VoteMismatchKey,
) -> Result<Region> {
    let by_vote = MaskByVote {
        cloud: &voted.cloud,
        votes: &voted.votes,
        frame: key.frame,
        labels: &[],
    };
    let voted = mask_by_vote(project, store, &by_vote)?.mask;
    let runs = Arc::new(RunMask::encode(&voted));
    let runs = project.in_play(key.frame, &project.with_locks(key.frame, runs));
    Ok(mismatch(&key.mask.decode(), &runs.decode()))
}

/// The mask of a frame by the vote of all frames.
pub(crate) struct VotedMask {
    pub(crate) mask: LabelMask,
    /// Warning that names the frame if its depth cannot be read and is ignored.
    pub(crate) warning: Option<String>,
}

/// Reads the frame's depth and projects the labels into the frame.
///
/// A depth that cannot be read is ignored, as if the frame had none.
///
/// # Errors
///
/// Returns an error if the frame is missing, or its mask and the votes do not fit together.
pub(crate) fn mask_by_vote(
    project: &Project,
    store: &FrameStore,
    by_vote: &MaskByVote<'_>,
) -> Result<VotedMask> {
    let frame = project.frame(by_vote.frame)?;
    let depth = readable(store.depth(frame).map_err(SceneError::from))?;
    let unread = [frame.name.as_str()];
    let warning = depth.is_none().then(|| without_depth(&unread)).flatten();
    let mask = by_vote.project(project, depth.flatten().as_deref())?;
    Ok(VotedMask { mask, warning })
}

/// Returns a warning about frames whose masks are changed without their unreadable depth.
pub(crate) fn without_depth(names: &[&str]) -> Option<String> {
    naming(
        [
            "has a depth that cannot be read, and its mask is changed without it; check its file",
            "have a depth that cannot be read, and their masks are changed without it; check their files",
        ],
        names,
    )
}
