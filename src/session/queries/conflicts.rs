use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;

use super::cloud::CloudState;
use crate::Event;
use crate::query::QueryKey;
use ostra_cloud::conflicts::{FrameConflict, frame_conflict};
use ostra_core::job::Progress;
use ostra_masks::RunMask;
use ostra_project::Project;
use ostra_project::voted_cloud::VotedCloud;

/// Conflict of each mask with the vote of all frames, by frame number.
pub(crate) type Conflicts = BTreeMap<usize, FrameConflict>;

/// The masks of the frames that voted, and the cloud they are compared with.
#[derive(Clone)]
pub(crate) struct ConflictsKey {
    pub(crate) cloud: CloudState,
    pub(crate) masks: BTreeMap<usize, Arc<RunMask>>,
}

impl ConflictsKey {
    pub(crate) fn new(project: &Project, cloud: CloudState, voted: &VotedCloud) -> Self {
        let masks = voted
            .votes
            .frames()
            .filter_map(|frame| Some((frame, project.mask_in_play(frame)?)));
        Self {
            cloud,
            masks: masks.collect(),
        }
    }
}

fn is_same(a: &Arc<RunMask>, b: &Arc<RunMask>) -> bool {
    Arc::ptr_eq(a, b) || a == b
}

impl PartialEq for ConflictsKey {
    fn eq(&self, other: &Self) -> bool {
        let pairs = || self.masks.iter().zip(&other.masks);
        self.cloud == other.cloud
            && self.masks.len() == other.masks.len()
            && pairs().all(|((frame, a), (of, b))| frame == of && is_same(a, b))
    }
}

impl QueryKey for ConflictsKey {
    const TITLE: &'static str = "compare masks";
    const EVENT: Option<Event> = Some(Event::ConflictsChanged);

    /// Conflicts with an earlier round of voting are shown until the new ones are ready.
    fn serves(&self, wanted: &Self) -> bool {
        self.cloud.version == wanted.cloud.version
    }
}

/// Compares the masks with the vote.
///
/// If the cloud is the same as `before`, only changed masks are compared.
///
/// # Errors
///
/// Returns an error if the progress is stopped.
pub(crate) fn find_conflicts(
    voted: &VotedCloud,
    key: &ConflictsKey,
    before: Option<&(ConflictsKey, Arc<Conflicts>)>,
    progress: &Progress,
) -> Result<Conflicts> {
    let before = before.filter(|(of, _)| of.cloud == key.cloud);
    let unchanged = |frame: &usize, mask: &Arc<RunMask>| {
        let (of, conflicts) = before?;
        let same = of
            .masks
            .get(frame)
            .is_some_and(|before| is_same(before, mask));
        conflicts.get(frame).filter(|_| same).cloned()
    };
    let mut found = Conflicts::new();
    for (&frame, mask) in &key.masks {
        let conflict = match unchanged(&frame, mask) {
            Some(known) => known,
            None => {
                progress.check()?;
                frame_conflict(&voted.votes, &voted.cloud.labels, frame, &mask.decode())
            }
        };
        found.insert(frame, conflict);
    }
    Ok(found)
}
