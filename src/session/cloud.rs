use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result};

use super::Session;
use super::jobs::{Kind, Landing};
use crate::Event;
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_cloud::ply::read_ply;
use ostra_core::job::JobId;
use ostra_project::ResultKind;
pub(super) use ostra_project::reusable_votes::read_votes_on;
use ostra_project::store::{cloud_path, mesh_path, version_in_force, votes_path};

/// The labelled cloud that was loaded or made last.
#[derive(Default)]
pub(super) struct CloudSlot {
    loaded: Option<Loaded>,
    /// Somebody asked for the project's cloud since it was last loaded.
    wanted: Cell<bool>,
    /// The version that is being loaded or could not be.
    tried: Option<u64>,
    /// How often points voted again.
    rounds: u64,
}

/// A state of the project's cloud, for what is made of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct CloudState {
    /// Which version of the project's.
    pub(super) version: u64,
    /// Which round of voting since; 0 = as it was made.
    pub(super) round: u64,
}

struct Loaded {
    /// Which version of the project's; `None` = inspected alone.
    version: Option<u64>,
    round: u64,
    cloud: Arc<LabelledCloud>,
    votes: Option<Arc<Votes>>,
}

impl CloudSlot {
    pub(super) fn put(&mut self, version: Option<u64>, cloud: LabelledCloud, votes: Option<Votes>) {
        self.tried = None;
        self.loaded = Some(Loaded {
            version,
            round: 0,
            cloud: Arc::new(cloud),
            votes: votes.map(Arc::new),
        });
    }

    /// Puts a cloud in the place of that with the votes `before`, whose points voted again; whether that is still there.
    pub(super) fn revote(
        &mut self,
        before: &Arc<Votes>,
        cloud: LabelledCloud,
        votes: &Arc<Votes>,
    ) -> bool {
        let is_before = |loaded: &&mut Loaded| {
            loaded
                .votes
                .as_ref()
                .is_some_and(|votes| Arc::ptr_eq(votes, before))
        };
        let Some(loaded) = self.loaded.as_mut().filter(is_before) else {
            return false;
        };
        self.rounds += 1;
        *loaded = Loaded {
            round: self.rounds,
            cloud: Arc::new(cloud),
            votes: Some(Arc::clone(votes)),
            ..*loaded
        };
        true
    }

    /// The project's cloud of this version with its votes, where it is in memory.
    pub(super) fn in_force(
        &self,
        version: Option<u64>,
    ) -> Option<(Arc<LabelledCloud>, Arc<Votes>)> {
        let loaded = self
            .loaded
            .as_ref()
            .filter(|loaded| version.is_some() && loaded.version == version)?;
        Some((Arc::clone(&loaded.cloud), loaded.votes.clone()?))
    }
}

impl Session {
    /// The project's labelled cloud, or that of the PLY which is inspected. A project's cloud is loaded by a job when
    /// it is first asked for: `None` until [`Event::CloudChanged`]. Names and colours in its tree are those of the
    /// time it was loaded; the project's own are the newest.
    #[must_use]
    pub fn cloud(&self) -> Option<&Arc<LabelledCloud>> {
        self.loaded_cloud().map(|loaded| &loaded.cloud)
    }

    /// The votes behind the cloud's labels, as [`Self::cloud`]; `None` for a PLY that is inspected.
    #[must_use]
    pub fn votes(&self) -> Option<&Arc<Votes>> {
        self.loaded_cloud()?.votes.as_ref()
    }

    /// Which cloud is in force, and what round of voting is in memory; `None` where there is none.
    pub(super) fn cloud_state(&self) -> Option<CloudState> {
        let version = version_in_force(self.project()?, ResultKind::Cloud)?;
        let loaded = self
            .cloud
            .loaded
            .as_ref()
            .filter(|loaded| loaded.version == Some(version));
        Some(CloudState {
            version,
            round: loaded.map_or(0, |loaded| loaded.round),
        })
    }

    /// Where the surface that was made with the cloud lies, and the edge of its voxels.
    pub(super) fn surface_file(&self) -> Option<(PathBuf, f64)> {
        let version = version_in_force(self.project()?, ResultKind::Cloud)?;
        Some((mesh_path(self.root()?, version), self.surface_voxel()?))
    }

    fn loaded_cloud(&self) -> Option<&Loaded> {
        let version = self
            .project()
            .and_then(|project| version_in_force(project, ResultKind::Cloud));
        if self.open.is_some() && version.is_none() {
            return None;
        }
        let loaded = self
            .cloud
            .loaded
            .as_ref()
            .filter(|loaded| loaded.version == version);
        if loaded.is_none() && version.is_some() {
            self.cloud.wanted.set(true);
        }
        loaded
    }

    /// Starts to load the cloud that was asked for.
    pub(super) fn load_wanted_cloud(&mut self) {
        let version = self
            .project()
            .and_then(|project| version_in_force(project, ResultKind::Cloud));
        if !self.cloud.wanted.take() || version.is_none() || self.cloud.tried == version {
            return;
        }
        self.cloud.tried = version;
        let (Some(version), Some(root)) = (version, self.root().map(Path::to_owned)) else {
            return;
        };
        let frames = self
            .project()
            .map(|project| Arc::clone(&project.frames))
            .unwrap_or_default();
        self.start("Load cloud", Kind::Short, move |link| {
            let path = cloud_path(&root, version);
            let read = read_ply(&path, &link.progress)
                .with_context(|| "the cloud of this step is not kept any more; fuse again")?;
            let (votes, why) =
                match read_votes_on(&votes_path(&root, version), read.cloud.len(), &frames) {
                    Ok(votes) => (Some(votes), None),
                    Err(error) => (
                        None,
                        Some(format!("{error:#}; the cloud is shown without its votes")),
                    ),
                };
            Ok(Box::new(move |session: &mut Self| {
                session.cloud.put(Some(version), read.cloud, votes);
                session.warn_all(why.into_iter().collect());
                session.events.push(Event::CloudChanged);
                Ok(())
            }) as Landing)
        });
    }

    pub(super) fn inspect(&mut self, path: &Path) -> Result<JobId> {
        let path =
            std::path::absolute(path).with_context(|| format!("{}: is no path", path.display()))?;
        Ok(self.start("Open cloud", Kind::Short, move |link| {
            let read = read_ply(&path, &link.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.close();
                session.cloud.put(None, read.cloud, None);
                session.inspected = Some(path.clone());
                session
                    .events
                    .extend([Event::Inspecting(path), Event::CloudChanged]);
                session.warn_all(read.warnings);
                Ok(())
            }) as Landing)
        }))
    }
}
