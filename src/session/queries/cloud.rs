use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result};

use crate::Event;
use crate::jobs::JobKind;
use crate::query::{Query, QueryKey, WithWarnings};
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_cloud::ply::read_ply;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_project::Project;
use ostra_project::store::{cloud_path, votes_path};
use ostra_project::voted_cloud::{VotedCloud, read_votes_on};

/// The open project as it was when a job began.
#[derive(Clone)]
pub(crate) struct Snapshot {
    pub(crate) project: Arc<Project>,
    pub(crate) root: PathBuf,
    pub(crate) store: Arc<FrameStore>,
    /// The project's cloud, if it is in memory with its votes.
    pub(crate) loaded: Option<(CloudState, VotedCloud)>,
}

impl Snapshot {
    /// Returns a version of the project's cloud, from memory or else from disk.
    ///
    /// # Errors
    ///
    /// Returns the errors of [`VotedCloud::read`].
    pub(crate) fn voted_cloud(&self, version: u64, progress: &Progress) -> Result<VotedCloud> {
        match &self.loaded {
            Some((state, voted)) if state.version == version => Ok(voted.clone()),
            _ => VotedCloud::read(&self.root, version, &self.project.frames, progress),
        }
    }
}

/// A state of the project's cloud, as part of the keys of values derived from it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct CloudState {
    /// Version of the result.
    pub(crate) version: u64,
    /// Round of voting since then; 0 means labelled as it was fused.
    pub(crate) round: u64,
}

/// A version of the project's cloud, or `None` for the inspected PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CloudKey(pub(crate) Option<u64>);

impl QueryKey for CloudKey {
    const TITLE: &'static str = "Load cloud";
    const EVENT: Option<Event> = Some(Event::CloudChanged);

    fn kind(&self) -> JobKind {
        JobKind::Short
    }
}

/// A labelled cloud in memory.
pub(crate) struct LoadedCloud {
    pub(crate) round: u64,
    pub(crate) cloud: Arc<LabelledCloud>,
    /// Votes; `None` for an inspected PLY and if they cannot be read.
    pub(crate) votes: Option<Arc<Votes>>,
}

impl LoadedCloud {
    fn voted(&self) -> Option<VotedCloud> {
        Some(VotedCloud {
            cloud: Arc::clone(&self.cloud),
            votes: self.votes.clone()?,
        })
    }
}

/// The labelled cloud that was last loaded or made.
#[derive(Default)]
pub(crate) struct CloudQuery {
    pub(crate) loaded: Query<CloudKey, LoadedCloud>,
    /// Number of votes since the start.
    rounds: u64,
}

impl CloudQuery {
    pub(crate) fn put(&mut self, version: Option<u64>, cloud: LabelledCloud, votes: Option<Votes>) {
        let loaded = LoadedCloud {
            round: 0,
            cloud: Arc::new(cloud),
            votes: votes.map(Arc::new),
        };
        self.loaded.put(CloudKey(version), Arc::new(loaded));
    }

    /// Replaces the cloud with the votes `before` by one that voted again.
    ///
    /// Returns whether that cloud was still in memory.
    pub(crate) fn revote(&mut self, before: &Arc<Votes>, voted: VotedCloud) -> bool {
        let key = self.loaded.latest().and_then(|(key, loaded)| {
            let votes = loaded.votes.as_ref()?;
            Arc::ptr_eq(votes, before).then_some(*key)
        });
        let Some(key) = key else {
            return false;
        };
        self.rounds += 1;
        let loaded = LoadedCloud {
            round: self.rounds,
            cloud: voted.cloud,
            votes: Some(voted.votes),
        };
        self.loaded.put(key, Arc::new(loaded));
        true
    }

    /// Returns the state of the project's cloud of this version.
    ///
    /// A cloud that is not in memory is in the state in which it was fused.
    pub(crate) fn state(&self, version: u64) -> CloudState {
        let loaded = self.loaded.known(&CloudKey(Some(version)));
        CloudState {
            version,
            round: loaded.map_or(0, |loaded| loaded.value.round),
        }
    }

    /// Returns the project's cloud of this version with its votes, if it is in memory.
    pub(crate) fn voted(&self, version: u64) -> Option<VotedCloud> {
        self.loaded.known(&CloudKey(Some(version)))?.value.voted()
    }
}

/// Reads a version of the project's cloud; a warning reports missing votes.
///
/// # Errors
///
/// Returns an error if the file of the cloud is missing or damaged.
pub(crate) fn load_cloud(
    snapshot: &Snapshot,
    key: &CloudKey,
    progress: &Progress,
) -> Result<WithWarnings<LoadedCloud>> {
    let version = key.0.context("no version of the cloud was named")?;
    let root = &snapshot.root;
    let cloud = read_ply(&cloud_path(root, version), progress)
        .with_context(|| "the cloud of this step is not kept any more; fuse again")?
        .cloud;
    let frames = &snapshot.project.frames;
    let (votes, warning) = match read_votes_on(&votes_path(root, version), cloud.len(), frames) {
        Ok(votes) => (Some(Arc::new(votes)), None),
        Err(error) => {
            let warning = format!("{error:#}; the cloud is shown without its votes");
            (None, Some(warning))
        }
    };
    Ok(WithWarnings {
        value: LoadedCloud {
            round: 0,
            cloud: Arc::new(cloud),
            votes,
        },
        warnings: warning.into_iter().collect(),
    })
}
