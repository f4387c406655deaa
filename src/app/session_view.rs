use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use ostra_cloud::conflicts::FrameConflict;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::{LengthUnit, TraitRow};
use ostra_cloud::select::Selection;
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_compute::nn::ModelStatus;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelTree, Region, RunMask};
use ostra_project::Project;
use ostra_session::{
    Angles, DepthPoints, Drawings, EngineInfo, EngineKind, Grounding, Images, JobTask, JobView,
    ProposedInstances, RecentProject, SparseReconstruction, Suggestion, Survey, Unfinished,
};
use ostra_view::{Layer, LayerImage, draw_layer};

/// Read-only view of the open session, borrowed by the panels for one frame of the window.
#[derive(Clone, Copy)]
pub struct SessionView<'a> {
    /// Open project; empty when none is open.
    pub project: &'a Project,
    /// Number that changes whenever the project or its conflicts change.
    pub revision: u64,
    /// Folder of the open project; `None` when none is open.
    pub root: Option<&'a Path>,
    /// Labelled cloud of the project, or the inspected PLY.
    pub cloud: Option<&'a Arc<LabelledCloud>>,
    /// Votes behind the cloud's labels, if known.
    pub votes: Option<&'a Arc<Votes>>,
    /// Preview of instances that are not yet created.
    pub proposed: Option<&'a Arc<ProposedInstances>>,
    /// Whether the cloud has a mesh that can be shown instead of its points.
    pub has_surface: bool,
    /// Triangles to show; `None` while points are shown or the surface is loading.
    pub surface: Option<&'a Arc<LabelledMesh>>,
    /// Points of the depth maps that a running job has computed so far.
    pub preview_cloud: Option<&'a Arc<LabelledCloud>>,
    /// Points of the depth maps while no cloud is fused, or those of the shown frame over it.
    pub depth_points: Option<&'a Arc<DepthPoints>>,
    /// Sparse model of the cameras, if they come from structure from motion.
    pub sparse: Option<&'a Arc<SparseReconstruction>>,
    /// Selected points of the cloud, or why there are none; `None` while they are computed.
    pub chosen: Option<Result<&'a Arc<Selection>, &'a str>>,
    /// PLY file that is viewed on its own.
    pub inspected: Option<&'a Path>,
    /// Images and thumbnails.
    pub images: Option<&'a Images>,
    /// Depth, normals and confidence drawn as images.
    pub layers: Option<&'a Layers>,
    /// Mask that an include click at the resting pointer would give.
    pub hovered: Option<&'a Arc<RunMask>>,
    /// Running jobs, oldest first.
    pub jobs: &'a [JobView],
    /// Interrupted work that can be continued.
    pub unfinished: Option<&'a Unfinished>,
    /// Segmenters, trackers and other engines, installed or not.
    pub engines: &'a [EngineInfo],
    /// All known networks, installed or not.
    pub models: &'a [ModelStatus],
    /// Frame and label of the click that the last step answered.
    pub last_prompt: Option<(usize, LabelId)>,
    /// Title of the step that undo reverts.
    pub undo: Option<&'a str>,
    /// Title of the step that redo applies.
    pub redo: Option<&'a str>,
    /// Recently opened projects, latest first.
    pub recent: &'a [PathBuf],
    /// What the folders of recent projects hold, as far as it is known.
    pub recent_projects: Option<&'a BTreeMap<PathBuf, RecentProject>>,
    /// What the files of the new-project dialog hold, once they are read.
    pub survey: Option<&'a Arc<Survey>>,
    /// Thumbnails of these files.
    pub survey_images: Option<&'a Images>,
    /// Shown frame's mask before the last step that changed it, while both are compared.
    pub before: Option<&'a Arc<RunMask>>,
    /// Suggested objects: regions that no label explains.
    pub suggestions: &'a [Suggestion],
    /// Result of the search by text.
    pub grounding: Option<&'a Grounding>,
    /// Conflict of each frame's mask with the vote of all views, by frame index.
    pub conflicts: &'a BTreeMap<usize, FrameConflict>,
    /// Pixels of the shown frame that the vote contradicts, if they are to be shown.
    pub vote_mismatch: Option<&'a Arc<Region>>,
    /// Traits of the cloud's labels, once requested and measured.
    pub traits: Option<&'a Arc<Vec<TraitRow>>>,
    /// Requested angles between labels, once measured.
    pub angles: Option<&'a Angles>,
    /// Unit of lengths in the scene.
    pub unit: LengthUnit,
}

impl<'a> SessionView<'a> {
    /// Returns `true` if the open project has frames.
    #[must_use]
    pub fn has_frames(&self) -> bool {
        !self.project.frames.is_empty()
    }

    /// Returns whether there is something for the 3-D view, or it is being computed.
    #[must_use]
    pub fn has_scene(&self) -> bool {
        self.points().is_some()
            || self.running(&JobTask::Reconstruct).is_some()
            || self
                .project
                .frames
                .iter()
                .any(|frame| frame.posed_camera().is_some())
    }

    /// Returns the points to show in the 3-D view.
    ///
    /// In order of preference: depth maps in progress, proposed instances, the labelled cloud, the
    /// depth maps, the sparse model.
    #[must_use]
    pub fn points(&self) -> Option<&Arc<LabelledCloud>> {
        self.preview_cloud
            .or(self.proposed.map(|proposed| &proposed.cloud))
            .or(self.cloud)
            .or(self.depth_points.map(|points| &points.cloud))
            .or(self.sparse.map(|sparse| &sparse.cloud))
    }

    /// Returns the labels whose colours the 3-D view uses; `None` for a cloud with its own labels.
    #[must_use]
    pub fn shown_tree(&self) -> Option<LabelTree> {
        let proposed = self.proposed.map(|proposed| &proposed.cloud.tree);
        proposed
            .or(self.root.map(|_| &self.project.labels))
            .cloned()
    }

    /// Returns `true` if lengths can be given in metres.
    ///
    /// This is so if the scale is known. For a PLY viewed on its own the user has to know its unit.
    #[must_use]
    pub fn may_be_metric(&self) -> bool {
        self.unit != LengthUnit::World || self.inspected.is_some()
    }

    /// Returns the running job of a task.
    #[must_use]
    pub fn running(&self, task: &JobTask) -> Option<&JobView> {
        self.jobs.iter().find(|job| job.task.as_ref() == Some(task))
    }

    /// Returns the jobs that have run for more than 400 ms and are worth showing.
    pub fn slow_jobs(&self) -> impl Iterator<Item = &JobView> {
        self.jobs.iter().filter(|job| job.elapsed.as_millis() > 400)
    }

    /// Returns the engines of one kind.
    pub fn engines_of(&self, kind: EngineKind) -> impl Iterator<Item = &EngineInfo> {
        self.engines
            .iter()
            .filter(move |engine| engine.kind == kind)
    }
}

/// Returns the project's labels, or those of the inspected PLY.
pub(super) fn labels_of<'a>(session: &SessionView<'a>) -> &'a LabelTree {
    match session.cloud {
        Some(cloud) if session.root.is_none() => &cloud.tree,
        _ => &session.project.labels,
    }
}

/// Layers drawn as images on a worker thread, by frame index and layer.
pub type Layers = Drawings<(usize, Layer), Drawn>;

/// Drawn layer, `None` if the frame has no such layer, or why it cannot be read.
pub type Drawn = Result<Option<LayerImage>, String>;

/// Creates the drawings of the layers of `frames`, loading data through `store`.
///
/// `notify` is called when a drawing is ready.
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
