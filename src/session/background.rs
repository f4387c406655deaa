use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use crate::queries::{
    AllPointsKey, Angles, AnglesKey, CloudKey, CloudState, Conflicts, ConflictsKey, DepthFrames,
    DepthPoints, DepthPointsKey, FramePointsKey, InstancesKey, LoadedCloud, MeasureSettings,
    MeasuredCloud, MeshKey, SelectionKey, SparseKey, SurfaceKey, SurfaceKind, Survey,
    SurveyRequest, TraitsKey, VoteMismatchKey,
};
use crate::{InstancesRequest, PromptRequest, ProposedInstances, Session, SparseReconstruction};
use ostra_cloud::conflicts::FrameConflict;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::{LengthUnit, TraitRow};
use ostra_cloud::select::{SelectStep, Selection, Selector};
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_frames::Frame;
use ostra_masks::{LabelId, LabelTree, Region, RunMask};
use ostra_project::ResultKind;
use ostra_project::store::version_in_force;

/// Values computed in the background.
///
/// A job computes each value when it is first requested and when its inputs have changed.
impl Session {
    /// Returns the project's labelled cloud, or that of the inspected PLY.
    ///
    /// A job loads a project's cloud when it is first requested. The result is `None` until
    /// [`Event::CloudChanged`](crate::Event::CloudChanged). The tree holds the names and colours at
    /// loading time; the project has the current ones.
    #[must_use]
    pub fn cloud(&self) -> Option<&Arc<LabelledCloud>> {
        self.loaded_cloud().map(|loaded| &loaded.cloud)
    }

    /// Returns the votes behind the labels of [`Self::cloud`]; `None` for an inspected PLY.
    #[must_use]
    pub fn votes(&self) -> Option<&Arc<Votes>> {
        self.loaded_cloud()?.votes.as_ref()
    }

    fn loaded_cloud(&self) -> Option<&LoadedCloud> {
        let loaded = &self.background.cloud.loaded;
        let known = match (self.cloud_version(), &self.open) {
            (None, Some(_)) => None,
            (None, None) => loaded.known(&CloudKey(None)),
            (version, _) => loaded.get(CloudKey(version)),
        };
        known.map(|known| &**known.value)
    }

    /// Returns the version of the project's cloud, or `None` if there is no cloud.
    pub(crate) fn cloud_version(&self) -> Option<u64> {
        version_in_force(self.project()?, ResultKind::Cloud)
    }

    /// Returns the current cloud version and its round of voting, or `None` if there is no cloud.
    pub(crate) fn cloud_state(&self) -> Option<CloudState> {
        Some(self.background.cloud.state(self.cloud_version()?))
    }

    /// Returns the voxel size of the surface of the project's cloud, in world units.
    ///
    /// Returns `None` if there is no cloud or it has no surface because it was given.
    #[must_use]
    pub fn surface_voxel(&self) -> Option<f64> {
        self.project()?.results.get(&ResultKind::Cloud)?.voxel
    }

    /// Returns the surface that was made with the project's cloud.
    ///
    /// Like [`Self::cloud`], a job loads it when it is first requested. The result is `None` until
    /// [`Event::CloudChanged`](crate::Event::CloudChanged).
    #[must_use]
    pub fn mesh(&self) -> Option<&Arc<LabelledMesh>> {
        self.surface_voxel()?;
        let version = self.cloud_version()?;
        let known = self.background.mesh.get(MeshKey { version })?;
        Some(known.value)
    }

    /// Returns the triangles to draw for the project's result.
    ///
    /// They have the labels of the cloud in memory. A job makes them when they are first requested.
    /// After a new vote, the previous triangles are returned until the new ones are ready.
    #[must_use]
    pub fn surface(&self, surface: SurfaceKind) -> Option<&Arc<LabelledMesh>> {
        let key = SurfaceKey {
            cloud: self.cloud_state()?,
            surface,
            voxel: self.surface_voxel()?,
        };
        Some(self.background.surface.get(key)?.value)
    }

    /// Returns the sparse model of the project's cameras if structure from motion found them.
    ///
    /// A job loads it when it is first requested. The result is `None` until
    /// [`Event::SparseChanged`](crate::Event::SparseChanged).
    #[must_use]
    pub fn sparse(&self) -> Option<&Arc<SparseReconstruction>> {
        let version = version_in_force(self.project()?, ResultKind::Cameras)?;
        let known = self.background.sparse.get(SparseKey { version })?;
        Some(known.value)
    }

    /// Returns the instances that [`Command::Instances`](crate::Command::Instances) would make.
    ///
    /// Like [`Self::cloud`], a job finds them when they are first requested. The result is `None`
    /// until [`Event::CloudChanged`](crate::Event::CloudChanged). Nothing is committed.
    #[must_use]
    pub fn proposed_instances(&self, request: InstancesRequest) -> Option<&Arc<ProposedInstances>> {
        let cloud = self.cloud_state()?;
        let key = InstancesKey { cloud, request };
        Some(self.background.instances.get(key)?.value)
    }

    /// Returns the conflict of each mask with the vote of all frames, by frame number.
    ///
    /// It is computed in the background when first requested and after masks changed. Until then,
    /// the previous result is returned. It is empty without a cloud whose voters are known.
    #[must_use]
    pub fn conflicts(&self) -> &Arc<BTreeMap<usize, FrameConflict>> {
        static NONE: LazyLock<Arc<Conflicts>> = LazyLock::new(Arc::default);
        self.known_conflicts().unwrap_or(&NONE)
    }

    fn known_conflicts(&self) -> Option<&Arc<Conflicts>> {
        let (cloud, conflicts) = (self.cloud_state()?, &self.background.conflicts);
        let Some(voted) = self.background.cloud.voted(cloud.version) else {
            let (of, known) = conflicts.latest()?;
            return (of.cloud.version == cloud.version).then_some(known);
        };
        let key = ConflictsKey::new(self.project()?, cloud, &voted);
        Some(conflicts.get(key)?.value)
    }

    /// Returns the pixels of a frame that would get another label by accepting the vote.
    ///
    /// Small differences along label borders are ignored. The pixels are computed in the
    /// background, one frame at a time. This happens when they are first requested and when the
    /// mask, the cloud or the label tree changed. Until then, the previous result is returned, or
    /// `None` if there is none.
    #[must_use]
    pub fn vote_mismatch(&self, frame: usize) -> Option<&Arc<Region>> {
        let cloud = self.cloud_state()?;
        let key = VoteMismatchKey::new(self.project()?, frame, cloud)?;
        let mismatch = &self.background.vote_mismatch;
        let known = match self.background.cloud.voted(cloud.version) {
            Some(_) => mismatch.get(key),
            None => mismatch.known(&key),
        };
        Some(known?.value)
    }

    /// Returns what the files of a new project hold.
    ///
    /// A job reads them when they are first requested, and is stopped when others are requested.
    /// The result is `None` until then. No project needs to be open.
    #[must_use]
    pub fn survey(&self, request: SurveyRequest) -> Option<&Arc<Survey>> {
        Some(self.background.survey.get(request)?.value)
    }

    /// Returns the traits of the cloud's labels, in world units.
    ///
    /// A job measures them when they are first requested and when the cloud, the label tree or the
    /// settings change. The result is `None` until then.
    #[must_use]
    pub fn traits(&self, settings: MeasureSettings) -> Option<&Arc<Vec<TraitRow>>> {
        let of = self.measured_cloud()?;
        let known = self.background.traits.get(TraitsKey { of, settings })?;
        Some(known.value)
    }

    /// Returns the angles between labels of the cloud, including pairs requested before.
    ///
    /// A job measures a pair when it is first requested and when the cloud or the label tree
    /// changes. The pair is missing until then.
    #[must_use]
    pub fn angles(&self, pairs: impl IntoIterator<Item = [LabelId; 2]>) -> &Angles {
        static NONE: Angles = Angles::new();
        let Some(of) = self.measured_cloud() else {
            return &NONE;
        };
        let angles = &self.background.angles;
        let before = angles.requested().filter(|requested| requested.of == of);
        let mut key = before.unwrap_or_else(|| AnglesKey {
            of,
            pairs: Default::default(),
        });
        key.pairs.extend(pairs);
        let known = if key.pairs.is_empty() {
            angles.known(&key)
        } else {
            angles.get(key)
        };
        known.map_or(&NONE, |known| known.value)
    }

    /// Returns the unit of lengths in the 3-D view.
    ///
    /// It is metres if depths, given cameras or a known length define the scale. A cloud that is
    /// older than the scale of the cameras has no unit.
    #[must_use]
    pub fn length_unit(&self) -> LengthUnit {
        let Some(project) = self.project() else {
            return LengthUnit::World;
        };
        if self.preview_cloud().is_some() {
            project.coordinates().unit
        } else {
            project.cloud_unit()
        }
    }

    /// Returns the points of the depths that a running job is computing or placing.
    ///
    /// After a job that finished, its points are returned until [`Self::depth_points`] has those of
    /// the new depths. Returns `None` if there is no such job or none of its views is finished.
    #[must_use]
    pub fn preview_cloud(&self) -> Option<&Arc<LabelledCloud>> {
        let preview = &self.background.preview;
        Some(preview.cloud())
            .filter(|cloud| !cloud.is_empty() && (self.is_previewing() || self.is_preview_newest()))
    }

    /// Returns whether the job of the preview runs.
    pub(crate) fn is_previewing(&self) -> bool {
        let of = self.background.preview.job();
        of.is_some() && self.jobs().iter().any(|job| Some(job.id) == of)
    }

    /// Returns whether the preview shows the project's depths and no other points of them are known.
    fn is_preview_newest(&self) -> bool {
        let Some(project) = self.project() else {
            return false;
        };
        let is_unknown = |all| {
            let all_points = &self.background.all_points;
            all_points.known(&AllPointsKey { all }).is_none()
        };
        self.background.preview.is_of(&project.frames)
            && self.cloud_version().is_none()
            && project.frames.iter().any(Frame::has_posed_depth)
            && DepthFrames::of(project).is_some_and(is_unknown)
    }

    /// Returns the points of the depth maps while no cloud is fused.
    ///
    /// These are the points of a frame and a thinned sample of those of all frames with a posed
    /// camera. They have the labels of the masks. Jobs read the depths when they are first requested
    /// and when frames, cameras or depths change. Until then, earlier points of the same cameras are
    /// returned, or `None`. A frame without a posed camera is placed in its own camera if no frame
    /// has a pose. With `over_cloud`, the points of the frame alone are returned where there is a
    /// cloud.
    #[must_use]
    pub fn depth_points(&self, frame: usize, over_cloud: bool) -> Option<&Arc<DepthPoints>> {
        let project = self.project()?;
        let frames = DepthFrames::of(project)?;
        let has_cloud = self.cloud_version().is_some();
        if has_cloud && !over_cloud {
            return None;
        }
        let all = if frames.has_poses() && !has_cloud {
            let all = frames.clone();
            self.background.all_points.get(AllPointsKey { all })
        } else {
            None
        };
        let key = FramePointsKey {
            all: frames.clone(),
            frame,
        };
        let shown = self.background.frame_points.get(key);
        let key = DepthPointsKey::new(
            &frames,
            shown.as_ref().map(|known| known.value),
            all.as_ref().map(|known| known.value),
            |frame| project.mask_in_play(frame),
        )?;
        Some(self.background.depth_points.get(key)?.value)
    }

    /// Requests a preview of a prompt, or with `None` cancels the request.
    ///
    /// Requests are answered in the background one at a time, the newest first, from the same
    /// prepared frame as a prompt. Nothing is committed.
    pub fn hover(&mut self, wanted: Option<PromptRequest>) {
        let wanted = wanted.map(|request| self.answered_now(request));
        let preview = &mut self.background.prompt_preview;
        match wanted {
            Some(request) if preview.requested().as_ref() == Some(&request) => return,
            Some(request) => preview.ask(request),
            None => preview.clear(),
        }
        self.start_prompt_preview();
    }

    /// Returns the answer to the newest request of [`Self::hover`], if it is ready.
    ///
    /// The mask contains only the label of the prompt.
    #[must_use]
    pub fn hovered(&self) -> Option<&Arc<RunMask>> {
        let (_, mask) = self.background.prompt_preview.newest()?;
        mask.as_ref().as_ref()
    }

    /// Requests the points that the steps select in the project's cloud.
    ///
    /// An empty list cancels the request. The selection is computed in the background, one request
    /// at a time, the newest first. If the cloud has changed, requesting the same steps selects
    /// again.
    pub fn select(&mut self, wanted: &[SelectStep]) {
        if wanted.is_empty() {
            self.background.selection.clear();
            return;
        }
        let Some(key) = self.cloud().map(|cloud| SelectionKey::new(cloud, wanted)) else {
            return;
        };
        self.background.selection.ask(key);
        self.start_selection();
    }

    /// Returns the points selected by the newest request of [`Self::select`].
    ///
    /// The inner error says why the steps select no points. Returns `None` until the selection is
    /// ready.
    #[must_use]
    pub fn selected(&self) -> Option<Result<&Arc<Selection>, &str>> {
        let (key, chosen) = self.background.selection.newest()?;
        key.is_in(self.cloud()?)
            .then(|| chosen.selection.as_ref().map_err(String::as_str))
    }

    /// Returns the prepared selector for a cloud, if there is one.
    pub(crate) fn selector_of(&self, cloud: &Arc<LabelledCloud>) -> Option<Arc<Selector>> {
        let (_, chosen) = self.background.selection.latest()?;
        chosen
            .selector
            .clone()
            .filter(|selector| Arc::ptr_eq(selector.cloud(), cloud))
    }

    /// Requests labels from the current masks for the project's cloud in memory.
    ///
    /// After masks or the label tree changed, the points of [`Self::cloud`] vote again in the
    /// background, and [`Event::CloudChanged`](crate::Event::CloudChanged) reports the new labels.
    /// Points do not move, and files do not change until the cloud is fused. Each request triggers
    /// at most one vote. Nothing happens while a long job runs or if the frames that voted are
    /// unknown.
    pub fn follow_masks(&self) {
        self.background.revote.is_wanted.set(true);
    }

    /// Returns whether the labels of the cloud in memory are those of the current masks.
    pub(crate) fn follows(&self) -> bool {
        let voted = self
            .cloud_version()
            .and_then(|version| self.background.cloud.voted(version));
        voted.zip(self.project()).is_some_and(|(voted, project)| {
            self.background.revote.is_up_to_date(project, &voted.votes)
        })
    }

    /// Returns the cloud to measure and its label tree.
    pub(crate) fn measurable(&self) -> Option<(&Arc<LabelledCloud>, &LabelTree)> {
        let cloud = self.cloud()?;
        let tree = self
            .project()
            .map_or(&cloud.tree, |project| &project.labels);
        Some((cloud, tree))
    }

    fn measured_cloud(&self) -> Option<MeasuredCloud> {
        let (cloud, tree) = self.measurable()?;
        Some(MeasuredCloud::new(cloud, tree))
    }
}
