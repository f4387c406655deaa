use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ostra_cloud::doubt::FrameDoubt;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::{LengthUnit, TraitRow};
use ostra_cloud::select::Selection;
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_compute::nn::Row;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelTree, Region, RunMask};
use ostra_project::{Estimate, Project};
use ostra_session::{
    Angles, Drawings, Engine, EngineKind, Grounding, JobTask, JobView, Pictures, ProposedInstances,
    SparseModel, Suggestion,
};
use ostra_view::{Layer, LayerPicture, draw_layer};

/// What panels look at: a snapshot of the open session, borrowed for one picture of the window.
#[derive(Clone, Copy)]
pub struct SessionView<'a> {
    /// The open project; empty when none is open.
    pub project: &'a Project,
    /// Its folder; `None` when none is open.
    pub root: Option<&'a Path>,
    /// The labelled cloud: the project's, or the PLY that is inspected.
    pub cloud: Option<&'a Arc<LabelledCloud>>,
    /// The votes behind its labels, where they are known.
    pub votes: Option<&'a Arc<Votes>>,
    /// Instances as they would be made, while they are looked at.
    pub proposed: Option<&'a Arc<ProposedInstances>>,
    /// Whether a mesh was made with the cloud, which can be shown in the points' place.
    pub has_surface: bool,
    /// The triangles of the model shown; `None` where points are, or while they are loaded.
    pub surface: Option<&'a Arc<LabelledMesh>>,
    /// Points of the depths that are being made.
    pub growing: Option<&'a Arc<LabelledCloud>>,
    /// What the cameras were found with, where that was structure from motion.
    pub sparse: Option<&'a Arc<SparseModel>>,
    /// The points chosen in the cloud, or why there are none; `None` while they are looked for.
    pub chosen: Option<Result<&'a Arc<Selection>, &'a str>>,
    /// The PLY that is inspected alone.
    pub inspected: Option<&'a Path>,
    /// Pictures and thumbnails.
    pub pictures: Option<&'a Pictures>,
    /// Depth and the like, drawn.
    pub layers: Option<&'a Layers>,
    /// What an include click where the pointer rests would give.
    pub hovered: Option<&'a Arc<RunMask>>,
    /// What is running, oldest first.
    pub jobs: &'a [JobView],
    /// Segmenters, trackers and the rest, installed or not.
    pub engines: &'a [Engine],
    /// Every network that is known, installed or not.
    pub models: &'a [Row],
    /// What undo would take back.
    pub undo: Option<&'a str>,
    /// What redo would do again.
    pub redo: Option<&'a str>,
    /// Projects opened before, latest first.
    pub recent: &'a [PathBuf],
    /// The shown frame's mask before the last step that changed it, while the two are compared.
    pub before: Option<&'a Arc<RunMask>>,
    /// Things found that no label explains.
    pub suggestions: &'a [Suggestion],
    /// What words found.
    pub grounding: Option<&'a Grounding>,
    /// Work by hand on masks since the session began.
    pub interactions: usize,
    /// By frame, how much its mask contradicts the vote of all.
    pub doubts: &'a BTreeMap<usize, FrameDoubt>,
    /// The pixels of the shown frame that the vote of all contradicts, where they are to be shown.
    pub contradicted: Option<&'a Arc<Region>>,
    /// What was measured of the cloud's labels, once it was asked for.
    pub traits: Option<&'a Arc<Vec<TraitRow>>>,
    /// The angles between labels that were asked for, once they are measured.
    pub angles: Option<&'a Angles>,
    /// What lengths of the scene are told in.
    pub unit: LengthUnit,
    /// How good the masks probably are.
    pub estimate: Option<Estimate>,
}

impl SessionView<'_> {
    /// Whether there is a project with frames.
    #[must_use]
    pub fn has_frames(&self) -> bool {
        !self.project.frames.is_empty()
    }

    /// The points of the 3-D view: those of the depths that are being made, the labelled cloud, else those that the cameras
    /// were found with.
    #[must_use]
    pub fn points(&self) -> Option<&Arc<LabelledCloud>> {
        self.growing
            .or(self.proposed.map(|proposed| &proposed.cloud))
            .or(self.cloud)
            .or(self.sparse.map(|sparse| &sparse.cloud))
    }

    /// The labels in whose colours the 3-D view is drawn; `None` for a cloud that has its own.
    #[must_use]
    pub fn shown_tree(&self) -> Option<LabelTree> {
        let proposed = self.proposed.map(|proposed| &proposed.cloud.tree);
        proposed
            .or(self.root.map(|_| &self.project.labels))
            .cloned()
    }

    /// Whether lengths can be given in metres: where the scale is known, and of a PLY alone, whose unit the user knows.
    #[must_use]
    pub fn may_be_metric(&self) -> bool {
        self.unit != LengthUnit::World || self.inspected.is_some()
    }

    /// Returns the running job of a task.
    #[must_use]
    pub fn running(&self, task: &JobTask) -> Option<&JobView> {
        self.jobs.iter().find(|job| job.task.as_ref() == Some(task))
    }

    /// The jobs that run long enough to be worth showing.
    pub fn slow_jobs(&self) -> impl Iterator<Item = &JobView> {
        self.jobs.iter().filter(|job| job.elapsed.as_millis() > 400)
    }

    /// The engines of one kind.
    pub fn engines_of(&self, kind: EngineKind) -> impl Iterator<Item = &Engine> {
        self.engines
            .iter()
            .filter(move |engine| engine.kind == kind)
    }
}

/// The project's labels, or those of the PLY that is inspected.
pub(super) fn labels_of<'a>(session: &SessionView<'a>) -> &'a LabelTree {
    match session.cloud {
        Some(cloud) if session.root.is_none() => &cloud.tree,
        _ => &session.project.labels,
    }
}

/// Depth and the like, drawn as pictures on a worker thread, by frame number.
pub type Layers = Drawings<(usize, Layer), Drawn>;

/// The picture, `None` where the frame has no such layer, or why it cannot be read.
pub type Drawn = Result<Option<LayerPicture>, String>;

/// Draws layers of `frames` from what `store` loads.
#[must_use]
pub fn layers_of(
    frames: Arc<Vec<Frame>>,
    store: Arc<FrameStore>,
    notify: impl Fn() + Send + Sync + 'static,
) -> Layers {
    let draw = move |&(number, layer): &(usize, Layer)| match frames.get(number) {
        Some(frame) => draw_layer(layer, frame, &store).map_err(|error| error.to_string()),
        None => Ok(None),
    };
    Layers::new(draw, notify)
}
