use std::sync::Arc;

use anyhow::Result;

use super::cloud::CloudState;
use crate::mask_edits::{mask_of, without_depth};
use crate::query::QueryKey;
use crate::voted_cloud::VotedCloud;
use ostra_cloud::SceneError;
use ostra_cloud::doubt::{contradiction, voted_mask};
use ostra_cloud::fuse::readable;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelMask, Region, RunMask};
use ostra_project::Project;

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
    /// A frame's mask as it is now; `None` where it has none.
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

    /// What an earlier mask or cloud gave for the frame stands until then.
    fn serves(&self, wanted: &Self) -> bool {
        self.frame == wanted.frame
    }
}

/// Where accepting the vote would give the frame other labels, those hidden on it left aside.
///
/// Locks are applied to the vote as they are when it is accepted, so that the stripes show what *Accept vote* would change.
/// Differences within two pixels of a border are ignored, as in the list of conflicts.
///
/// # Errors
/// As [`mask_by_vote`].
pub(crate) fn find_vote_mismatch(
    project: &Project,
    store: &FrameStore,
    voted: &VotedCloud,
    key: &VoteMismatchKey,
) -> Result<Region> {
    let by_vote = mask_by_vote(project, store, voted, key.frame, &[])?;
    let runs = Arc::new(RunMask::encode(&by_vote.mask));
    let runs = project.in_play(key.frame, &project.with_locks(key.frame, runs));
    Ok(contradiction(&key.mask.decode(), &runs.decode()))
}

/// The mask that the vote of all frames gives a frame.
pub(crate) struct MaskByVote {
    pub(crate) mask: LabelMask,
    /// Names the frame where its depth cannot be read: it is left aside, as if there were none.
    pub(crate) warning: Option<String>,
}

/// The mask that the vote of all frames gives a frame, for some labels or (none named) for all.
///
/// # Errors
/// When the frame is not there, or its mask and the votes do not fit together.
pub(crate) fn mask_by_vote(
    project: &Project,
    store: &FrameStore,
    voted: &VotedCloud,
    number: usize,
    labels: &[LabelId],
) -> Result<MaskByVote> {
    let frame = project.frame(number)?;
    let depth = readable(store.depth(frame).map_err(SceneError::from))?;
    let own = mask_of(project, number)?;
    let warning = if depth.is_none() {
        without_depth(&[frame.name.as_str()])
    } else {
        None
    };
    let depth = depth.flatten();
    let cloud = (&*voted.cloud, &*voted.votes);
    let mut mask = voted_mask(cloud, (number, frame), depth.as_deref(), &own, labels)?;
    for (id, own) in mask.ids.iter_mut().zip(&own.ids) {
        // A label that was taken out since the vote stays out.
        if *id != LabelId::NONE && project.labels.get(*id).is_none() {
            *id = *own;
        }
    }
    Ok(MaskByVote { mask, warning })
}
