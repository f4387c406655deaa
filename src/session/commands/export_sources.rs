//! What an export reads, as it was when the export began.

use crate::cloud::read_votes_on;
use anyhow::Result;
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::LengthUnit;
use ostra_frames::FrameStore;
use ostra_masks::{Label, LabelTree};
use ostra_project::Project;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What an export reads: snapshots.
pub struct Sources {
    pub(super) project: Arc<Project>,
    pub(super) store: Arc<FrameStore>,
    /// The labelled cloud in memory, or where it lies.
    pub(super) cloud: Option<Arc<LabelledCloud>>,
    pub(super) cloud_votes: Option<Arc<Votes>>,
    pub(super) cloud_file: Option<PathBuf>,
    /// The project's folder; `None` for a PLY that is inspected.
    pub(super) root: Option<PathBuf>,
    /// Where the surface lies that was made with the cloud, and the edge of its voxels.
    pub(super) surface: Option<(PathBuf, f64)>,
    pub(super) votes_file: Option<PathBuf>,
    /// Of lengths in the cloud and its surface.
    pub(super) unit: LengthUnit,
    /// What the cloud was made of has changed since.
    pub(super) is_stale: bool,
    /// The labels of the cloud in memory are those of the masks now.
    pub(super) follows: bool,
}

impl Sources {
    /// The project's labels; those taken out since a result was made keep their former names in it.
    pub(super) fn tree_of_today(&self, former: &LabelTree) -> LabelTree {
        let mut tree = self.project.labels.clone();
        for label in former
            .iter()
            .filter(|label| self.project.labels.get(label.id).is_none())
        {
            let _ = tree.set(Label {
                parent: None,
                ..label.clone()
            });
        }
        tree
    }

    /// How the cloud of so many points was voted on; `None` for a PLY that is inspected.
    pub(super) fn votes(&self, points: usize) -> Result<Option<Arc<Votes>>> {
        let of = |path: &Path| read_votes_on(path, points, &self.project.frames);
        let read = || self.votes_file.as_deref().map(of).transpose();
        if self.cloud_votes.is_some() {
            Ok(self.cloud_votes.clone())
        } else {
            Ok(read()?.map(Arc::new))
        }
    }
}
