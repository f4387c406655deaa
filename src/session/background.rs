use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use crate::queries::{
    Angles, AnglesKey, CloudKey, CloudState, Conflicts, ConflictsKey, InstancesKey, LoadedCloud,
    MeasureSettings, MeasuredCloud, MeshKey, SelectionKey, SparseKey, Surface, SurfaceKey,
    TraitsKey, VoteMismatchKey,
};
use crate::{InstancesRequest, PromptRequest, ProposedInstances, Session, SparseModel};
use ostra_cloud::doubt::FrameDoubt;
use ostra_cloud::fuse::Votes;
use ostra_cloud::measure::{LengthUnit, TraitRow};
use ostra_cloud::select::{SelectStep, Selection, Selector};
use ostra_cloud::{LabelledCloud, LabelledMesh};
use ostra_masks::{LabelId, LabelTree, Region, RunMask};
use ostra_project::ResultKind;
use ostra_project::store::version_in_force;

/// What can be asked for. Each value is made by a job when it is first asked for and when what it depends on has changed.
impl Session {
    /// The project's labelled cloud, or that of the PLY which is inspected. A project's cloud is loaded by a job when
    /// it is first asked for: `None` until [`Event::CloudChanged`](crate::Event::CloudChanged). Names and colours in its tree are those of the
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

    fn loaded_cloud(&self) -> Option<&LoadedCloud> {
        let loaded = &self.background.cloud.loaded;
        let known = match (self.cloud_version(), &self.open) {
            (None, Some(_)) => None,
            (None, None) => loaded.known(&CloudKey(None)),
            (version, _) => loaded.get(CloudKey(version)),
        };
        known.map(|known| &**known.value)
    }

    /// Version of the project's cloud; `None` where there is none.
    pub(crate) fn cloud_version(&self) -> Option<u64> {
        version_in_force(self.project()?, ResultKind::Cloud)
    }

    /// Which cloud is in force, and what round of voting is in memory; `None` where there is none.
    pub(crate) fn cloud_state(&self) -> Option<CloudState> {
        Some(self.background.cloud.state(self.cloud_version()?))
    }

    /// Edge of the voxels of the surface that was made with the project's cloud, world units; `None` where there is no
    /// cloud, or it has none (a cloud that was given).
    #[must_use]
    pub fn surface_voxel(&self) -> Option<f64> {
        self.project()?.results.get(&ResultKind::Cloud)?.voxel
    }

    /// The surface that was made with the project's cloud. As [`Self::cloud`] it is loaded by a job when it is first asked
    /// for: `None` until [`Event::CloudChanged`](crate::Event::CloudChanged).
    #[must_use]
    pub fn mesh(&self) -> Option<&Arc<LabelledMesh>> {
        self.surface_voxel()?;
        let version = self.cloud_version()?;
        let known = self.background.mesh.get(MeshKey { version })?;
        Some(known.value)
    }

    /// Triangles of the project's result to be drawn, labelled as the cloud in memory is. Made by a job as [`Self::mesh`] is
    /// loaded; those of the round of voting before stand until then.
    #[must_use]
    pub fn surface(&self, surface: Surface) -> Option<&Arc<LabelledMesh>> {
        let key = SurfaceKey {
            cloud: self.cloud_state()?,
            surface,
            voxel: self.surface_voxel()?,
        };
        Some(self.background.surface.get(key)?.value)
    }

    /// The sparse model of the project's cameras where they were found by structure from motion. It is loaded by a job
    /// when it is first asked for: `None` until [`Event::SparseChanged`](crate::Event::SparseChanged).
    #[must_use]
    pub fn sparse(&self) -> Option<&Arc<SparseModel>> {
        let version = version_in_force(self.project()?, ResultKind::Cameras)?;
        let known = self.background.sparse.get(SparseKey { version })?;
        Some(known.value)
    }

    /// The instances that [`Command::Instances`](crate::Command::Instances) would make. As [`Self::cloud`] they are found by
    /// a job when they are first asked for: `None` until [`Event::CloudChanged`](crate::Event::CloudChanged). Nothing is committed.
    #[must_use]
    pub fn proposed_instances(&self, request: InstancesRequest) -> Option<&Arc<ProposedInstances>> {
        let cloud = self.cloud_state()?;
        let key = InstancesKey { cloud, request };
        Some(self.background.instances.get(key)?.value)
    }

    /// By frame number, how much each mask contradicts the vote of all. It is worked out in the background when it is first
    /// asked for and after masks changed; until then it is that of the masks before. Empty without a cloud that knows who
    /// voted.
    #[must_use]
    pub fn doubts(&self) -> &Arc<BTreeMap<usize, FrameDoubt>> {
        static NONE: LazyLock<Arc<Conflicts>> = LazyLock::new(Arc::default);
        self.conflicts().unwrap_or(&NONE)
    }

    fn conflicts(&self) -> Option<&Arc<Conflicts>> {
        let (cloud, conflicts) = (self.cloud_state()?, &self.background.conflicts);
        let Some(voted) = self.background.cloud.voted(cloud.version) else {
            let (of, known) = conflicts.latest()?;
            return (of.cloud.version == cloud.version).then_some(known);
        };
        let key = ConflictsKey::new(self.project()?, cloud, &voted);
        Some(conflicts.get(key)?.value)
    }

    /// The pixels of a frame to which accepting the vote of all would give another label, but for borders that lie a little
    /// aside. It is worked out in the background when it is first asked for and when the mask, the cloud or the tree of labels
    /// changed, one frame at a time; until then it is that of before. `None` until it is there.
    #[must_use]
    pub fn contradicted(&self, frame: usize) -> Option<&Arc<Region>> {
        let cloud = self.cloud_state()?;
        let key = VoteMismatchKey::new(self.project()?, frame, cloud)?;
        let mismatch = &self.background.vote_mismatch;
        let known = match self.background.cloud.voted(cloud.version) {
            Some(_) => mismatch.get(key),
            None => mismatch.known(&key),
        };
        Some(known?.value)
    }

    /// The traits of the cloud's labels, in world units. They are measured by a job when they are first asked for and when
    /// the cloud, the tree of labels or the settings are other ones: `None` until then.
    #[must_use]
    pub fn traits(&self, settings: MeasureSettings) -> Option<&Arc<Vec<TraitRow>>> {
        let of = self.measured_cloud()?;
        let known = self.background.traits.get(TraitsKey { of, settings })?;
        Some(known.value)
    }

    /// Angles between labels of the cloud, and those asked for before. A job measures a pair when it is first asked for and
    /// when the cloud or the tree of labels is another: it is not there until then.
    #[must_use]
    pub fn angles(&self, pairs: impl IntoIterator<Item = [LabelId; 2]>) -> &Angles {
        static NONE: Angles = Angles::new();
        let Some(of) = self.measured_cloud() else {
            return &NONE;
        };
        let angles = &self.background.angles;
        let before = angles.asked().filter(|asked| asked.of == of);
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

    /// Unit of lengths in what the 3-D view shows: metres where depths, given cameras or a known length give the scale. A
    /// cloud that is older than the scale of the cameras has no unit.
    #[must_use]
    pub fn length_unit(&self) -> LengthUnit {
        let Some(project) = self.project() else {
            return LengthUnit::World;
        };
        if self.growing_cloud().is_some() {
            project.coordinates().unit
        } else {
            project.cloud_unit()
        }
    }

    /// The points of the depths that are being made or placed; `None` unless a job does so and has a view done.
    #[must_use]
    pub fn growing_cloud(&self) -> Option<&Arc<LabelledCloud>> {
        let preview = &self.background.preview;
        let running = self.jobs().iter().any(|job| Some(job.id) == preview.job());
        Some(preview.cloud()).filter(|cloud| running && !cloud.is_empty())
    }

    /// Asks what a prompt would give if it were sent, or, with `None`, for nothing any more. It is answered in the
    /// background: one at a time, the newest request next, from the same prepared frame as a prompt. Nothing is committed.
    pub fn hover(&mut self, wanted: Option<PromptRequest>) {
        let preview = &mut self.background.prompt_preview;
        match wanted {
            Some(request) if preview.asked().as_ref() == Some(&request) => return,
            Some(request) => preview.ask(request),
            None => preview.clear(),
        }
        self.start_prompt_preview();
    }

    /// The answer to the newest request of [`Self::hover`], where it is there: a mask of that prompt's label alone.
    #[must_use]
    pub fn hovered(&self) -> Option<&Arc<RunMask>> {
        let (_, mask) = self.background.prompt_preview.newest()?;
        mask.as_ref().as_ref()
    }

    /// Asks for the points that some steps choose in the project's cloud, or, with none, for nothing any more. They are found
    /// in the background: one request at a time, the newest next. Asked again, it finds them again in a cloud that changed.
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

    /// The points that the newest request of [`Self::select`] chooses, where they are found; else why there are none.
    #[must_use]
    pub fn selected(&self) -> Option<Result<&Arc<Selection>, &str>> {
        let (key, chosen) = self.background.selection.newest()?;
        key.is_in(self.cloud()?)
            .then(|| chosen.selection.as_ref().map_err(String::as_str))
    }

    /// What was made ready for choosing points of a cloud, where it was.
    pub(crate) fn selector_of(&self, cloud: &Arc<LabelledCloud>) -> Option<Arc<Selector>> {
        let (_, chosen) = self.background.selection.latest()?;
        chosen
            .selector
            .clone()
            .filter(|selector| Arc::ptr_eq(selector.cloud(), cloud))
    }

    /// Asks for labels of the project's cloud in memory ([`Self::cloud`], [`Self::votes`]) as the masks are now: after masks or
    /// the tree of labels changed, the points vote again in the background, and [`Event::CloudChanged`](crate::Event::CloudChanged) reports it. Points stay
    /// where they are, and files what they are until the cloud is fused. Asked once, it is done once; nothing happens while a
    /// long job runs, nor where it is not known who voted.
    pub fn follow_masks(&self) {
        self.background.revote.is_wanted.set(true);
    }

    /// Whether the labels of the cloud in memory are those of the masks now.
    pub(crate) fn follows(&self) -> bool {
        let voted = self
            .cloud_version()
            .and_then(|version| self.background.cloud.voted(version));
        voted.zip(self.project()).is_some_and(|(voted, project)| {
            self.background.revote.is_up_to_date(project, &voted.votes)
        })
    }

    /// The cloud to measure and the tree that its labels lie in.
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
