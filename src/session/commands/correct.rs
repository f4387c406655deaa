use crate::job_task::JobTitle;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use super::surface::save_surface;
use crate::Event;
use crate::queries::without_depth;
use crate::{CloudCorrection, Session};
use crate::{JobCompletion, JobKind};
use ostra_cloud::correct::SeeingPixels;
use ostra_cloud::fuse::{Fused, ProjectViews, readable};
use ostra_cloud::ply::{Coloring, save_ply};
use ostra_cloud::select::Selector;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, LabelMask, Region, RunMask};
use ostra_project::mask_edits::{anchor_of, label_name, mask_of};
use ostra_project::reusable_votes::ReusableVotes;
use ostra_project::store::{cloud_path, keep_mesh, sync_folder, version_in_force, votes_path};
use ostra_project::voted_cloud::{VotedCloud, save_votes};
use ostra_project::{Edit, FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};

/// What a correction comes to.
#[derive(Default)]
pub(super) struct Corrected {
    /// Edits of masks and labels.
    pub(super) edits: Vec<Edit>,
    /// What the user is told in the end; where there is that, there may be no edits, and nothing happens.
    pub(super) notice: Option<Notice>,
    /// What the user should know.
    pub(super) warnings: Vec<String>,
}

/// What to tell of the cloud as the masks voted again; of `None` where they did not.
pub(super) type Notice = Box<dyn FnOnce(Option<&LabelledCloud>) -> String + Send>;

impl From<Vec<Edit>> for Corrected {
    fn from(edits: Vec<Edit>) -> Self {
        Self {
            edits,
            ..Self::default()
        }
    }
}

/// What a correction in 3-D works on: the state that it began with.
pub(super) struct Correcting {
    pub(super) project: Arc<Project>,
    /// The cloud in force and who voted for its points.
    before: ReusableVotes,
    root: PathBuf,
    store: Arc<FrameStore>,
    selector: Option<Arc<Selector>>,
}

impl Session {
    /// Gives the pixels of all masks that see some points another label, and the points with them, in one step.
    pub(crate) fn correct_cloud(&mut self, correction: &CloudCorrection) -> Result<JobId> {
        let project = self.snapshot()?;
        let label = correction.change.label();
        let title = match label {
            LabelId::NONE => "Clear in 3-D".to_owned(),
            label => format!("Assign {} in 3-D", label_name(&project, label)?),
        };
        let correction = correction.clone();
        self.correct(&title, move |correcting, progress| {
            correcting.written_back(&correction, progress)
        })
    }

    /// Starts a job that makes edits of masks and labels from the project as it is now, lets the points of the cloud
    /// vote again by the masks as they are then, and takes in both as one step.
    pub(super) fn correct(
        &mut self,
        title: &str,
        corrected: impl FnOnce(&Correcting, &Progress) -> Result<Corrected> + Send + 'static,
    ) -> Result<JobId> {
        self.check_no_long_job()?;
        let project = self.snapshot()?;
        let version = version_in_force(&project, ResultKind::Cloud)
            .context("there is no cloud yet; fuse first")?;
        let loaded = self.background.cloud.voted(version);
        let selector = loaded
            .as_ref()
            .and_then(|loaded| self.selector_of(&loaded.cloud));
        let root = self.opened()?.root().to_owned();
        let next_version = self.opened()?.next_version()?;
        let before = ReusableVotes::in_force(&project, &root, loaded)
            .context("there is no cloud yet; fuse first")?;
        let correcting = Correcting {
            project,
            root,
            store: Arc::clone(&self.store),
            before,
            selector,
        };
        let title = title.to_owned();
        Ok(self.start(
            JobTitle::from(title.as_str()),
            JobKind::Long,
            move |context| {
                let Corrected {
                    mut edits,
                    notice,
                    warnings,
                } = corrected(&correcting, &context.progress)?;
                if edits.is_empty() {
                    let text = notice.context(
                        "no mask changes: none that may change sees these points otherwise",
                    )?(None);
                    return Ok(Box::new(|session: &mut Self| {
                        session.warn_all(warnings);
                        session.events.push(Event::Notice(text));
                        Ok(())
                    }) as JobCompletion);
                }
                let voted = correcting.voted_again(&edits, next_version, &context.progress)?;
                let record = voted.as_ref().map(|(_, record)| record.clone());
                let notice =
                    notice.map(|notice| notice(voted.as_ref().map(|(fused, _)| &fused.cloud)));
                edits.extend(record.map(|record| Edit::SetResult {
                    kind: ResultKind::Cloud,
                    record: Some(record),
                }));
                Ok(Box::new(move |session: &mut Self| {
                    let now = session.snapshot()?;
                    let same = Arc::ptr_eq(&now, &correcting.project) || now == correcting.project;
                    ensure!(same, "the project changed meanwhile; do it again");
                    session.commit(&title, edits)?;
                    session.warn_all(warnings);
                    session.events.extend(notice.map(Event::Notice));
                    if let Some((fused, _)) = voted {
                        session.background.cloud.put(
                            Some(next_version),
                            fused.cloud,
                            Some(fused.votes),
                        );
                        session.events.push(Event::CloudChanged);
                        session.warn_all(fused.report.warnings);
                    }
                    Ok(())
                }) as JobCompletion)
            },
        ))
    }
}

impl Correcting {
    /// The cloud in force with the labels of the masks as they were when the work began.
    pub(super) fn cloud_of_now(&self, progress: &Progress) -> Result<VotedCloud> {
        let voted = self
            .before
            .load(&self.project.frames, progress)?
            .context("it is not known who voted; fuse again")?;
        Ok(voted.up_to_date(&self.project, &self.store, progress)?)
    }

    /// The edits of the masks that see the chosen points.
    fn written_back(&self, correction: &CloudCorrection, progress: &Progress) -> Result<Corrected> {
        progress.stage("choose points")?;
        let VotedCloud { cloud, votes } = self.cloud_of_now(progress)?;
        let selector = self.selector_for(cloud)?;
        let (frames, tree) = (&self.project.frames, &self.project.labels);
        let selection = selector.select(frames, tree, &correction.select, progress)?;
        ensure!(
            !selection.points.is_empty(),
            "no point is chosen; draw around points that are seen"
        );
        let seeing = SeeingPixels::new(&selector, &votes, &selection)?;
        let label = correction.change.label();
        let frames: Vec<usize> = votes.frames().collect();
        let give = |_, mask: &LabelMask, region: Region| {
            let given = mask
                .ids
                .iter()
                .zip(region.inside)
                .map(|(&id, inside)| if inside { label } else { id });
            Some(LabelMask {
                ids: given.collect(),
                ..*mask
            })
        };
        self.given_back(&seeing, &frames, correction.as_anchors, give, progress)
    }

    /// The cloud as the masks of a project vote, whose points are those of the cloud in force; `None` where it is not
    /// known who voted.
    pub(super) fn voted(&self, project: &Project, progress: &Progress) -> Result<Option<Fused>> {
        let masks = |frame: usize| {
            project
                .mask_in_play(frame)
                .map(|runs| Arc::new(runs.decode()))
        };
        let views = ProjectViews {
            frames: &project.frames,
            store: &self.store,
            masks: &masks,
        };
        self.before.cloud(&views, project, progress)
    }

    /// What choosing points of a cloud needs.
    pub(super) fn selector_for(&self, cloud: Arc<LabelledCloud>) -> Result<Arc<Selector>> {
        match &self.selector {
            Some(selector) if Arc::ptr_eq(selector.cloud(), &cloud) => Ok(Arc::clone(selector)),
            _ => Ok(Arc::new(Selector::new(cloud)?)),
        }
    }

    /// The edits of these frames' masks by what becomes of a frame's mask and the region that sees the chosen points. A
    /// depth that cannot be read is left aside: the pixels that are recorded to see points give the region, and a warning
    /// names the frame.
    pub(super) fn given_back(
        &self,
        seeing: &SeeingPixels<'_>,
        frames: &[usize],
        as_anchors: bool,
        change: impl Fn(usize, &LabelMask, Region) -> Option<LabelMask>,
        progress: &Progress,
    ) -> Result<Corrected> {
        let project = &self.project;
        let mut edits = Vec::new();
        let mut unreadable: Vec<&str> = Vec::new();
        progress.stage("write back")?;
        for (done, &number) in frames.iter().enumerate() {
            progress.step(done, frames.len())?;
            let frame = project.frame(number)?;
            let mask = mask_of(project, number)?;
            let depth = readable(self.store.depth(frame).map_err(SceneError::from))?;
            let is_unreadable = depth.is_none();
            let region = seeing.in_frame((number, frame), depth.flatten().as_deref(), &mask);
            unreadable.extend((is_unreadable && region.is_some()).then_some(frame.name.as_str()));
            let changed = region.and_then(|region| change(number, &mask, region));
            edits.extend(changed.and_then(|mask| {
                mask_edit(
                    project,
                    number,
                    Arc::new(RunMask::encode(&mask)),
                    as_anchors,
                )
            }));
        }
        edits.extend(project.there_again(&edits));
        edits.extend(not_stale(project, &edits));
        Ok(Corrected {
            edits,
            notice: None,
            warnings: without_depth(&unreadable).into_iter().collect(),
        })
    }

    /// The cloud and its surface as the masks vote after the edits, saved under a version of their own; `None` where it
    /// is not known who voted.
    fn voted_again(
        &self,
        edits: &[Edit],
        version: u64,
        progress: &Progress,
    ) -> Result<Option<(Fused, ResultRecord)>> {
        let begun = Instant::now();
        let mut after = Project::clone(&self.project);
        for edit in edits {
            after.apply(edit.clone())?;
        }
        let masks = |frame: usize| {
            after
                .mask_in_play(frame)
                .map(|runs| Arc::new(runs.decode()))
        };
        let views = ProjectViews {
            frames: &after.frames,
            store: &self.store,
            masks: &masks,
        };
        let Some(mut fused) = self.before.cloud(&views, &after, progress)? else {
            return Ok(None);
        };
        progress.stage("save")?;
        save_ply(
            &cloud_path(&self.root, version),
            &fused.cloud,
            Coloring::Picture,
            progress,
        )?;
        save_votes(&votes_path(&self.root, version), &fused.votes)?;
        let has_new_labels = self.surface_again(&views, &after, version, progress)?;
        sync_folder(&self.root.join("versions"))?;
        if !has_new_labels {
            fused
                .report
                .warnings
                .push("the mesh keeps the labels that it had; fuse again".into());
        }
        let before = self.before.record.clone();
        let (frames, seconds) = (fused.report.frames_voted, begun.elapsed().as_secs_f64());
        let stale = before.stale || !has_new_labels;
        Ok(Some((
            fused,
            ResultRecord {
                frames,
                seconds,
                stale,
                version,
                ..before
            },
        )))
    }

    /// The surface as the masks vote now, saved under this version; as it was where it is not known who voted for it.
    /// Whether it carries the labels of now.
    fn surface_again(
        &self,
        views: &ProjectViews<'_>,
        after: &Project,
        version: u64,
        progress: &Progress,
    ) -> Result<bool> {
        if self.before.record.voxel.is_none() {
            return Ok(true);
        }
        let Some((mesh, votes)) = self.before.surface(views, after, progress)? else {
            keep_mesh(&self.root, self.before.record.version, version)?;
            return Ok(false);
        };
        save_surface(&self.root, version, &mesh, &votes, progress)?;
        Ok(true)
    }
}

/// The edit that gives a frame other runs by a correction in 3-D; `None` where nothing changes. Labels that are locked
/// stay, those that are not there come back only by an anchor.
fn mask_edit(project: &Project, frame: usize, runs: Arc<RunMask>, as_anchor: bool) -> Option<Edit> {
    let before = project.masks.get(&frame);
    let mask = if as_anchor {
        anchor_of(project.with_locks(frame, runs))
    } else {
        let nothing = || FrameMask {
            origin: MaskOrigin::Tracked,
            ..anchor_of(Arc::clone(&runs))
        };
        let kept = FrameMask {
            runs: Arc::clone(&runs),
            ..before.cloned().unwrap_or_else(nothing)
        };
        with_labels_shown(project.within_marks(frame, kept))
    };
    let same = before.map_or(mask.runs.extents().is_empty(), |before| {
        before.runs == mask.runs
    });
    (!same).then_some(Edit::SetMask {
        frame,
        mask: Some(mask),
    })
}

/// Confidences are kept of labels that the mask still shows.
fn with_labels_shown(mut mask: FrameMask) -> FrameMask {
    let shown = mask.runs.extents();
    mask.confidence.retain(|label, _| shown.contains_key(label));
    mask
}

/// The edit that leaves corrected masks as fresh as they were, though anchors beside them change.
fn not_stale(project: &Project, edits: &[Edit]) -> Option<Edit> {
    let is_fresh = |frame: &usize| project.masks.get(frame).is_none_or(|mask| !mask.stale);
    let frames: Vec<usize> = edits
        .iter()
        .filter_map(Edit::masked_frame)
        .filter(is_fresh)
        .collect();
    (!frames.is_empty()).then_some(Edit::SetStale {
        frames,
        stale: false,
    })
}
