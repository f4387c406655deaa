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
use ostra_cloud::conflicts::MaskedFrame;
use ostra_cloud::correct::SeeingPixels;
use ostra_cloud::fuse::{Fused, ProjectViews, readable};
use ostra_cloud::ply::{SavedColors, save_ply};
use ostra_cloud::select::Selector;
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, LabelMask, Region, RunMask};
use ostra_project::mask_edits::{keyframe_of, label_name, mask_of};
use ostra_project::reusable_votes::ReusableVotes;
use ostra_project::store::{cloud_path, keep_mesh, sync_folder, version_in_force, votes_path};
use ostra_project::voted_cloud::{VotedCloud, save_votes};
use ostra_project::{Edit, FrameMask, MaskOrigin, Project, ResultKind, ResultRecord};

/// Result of a correction.
#[derive(Default)]
pub(super) struct Corrected {
    /// Edits of masks and labels.
    pub(super) edits: Vec<Edit>,
    /// Message for the user at the end.
    ///
    /// With a message, the edits may be empty. The project then does not change.
    pub(super) notice: Option<Notice>,
    /// Warnings for the user.
    pub(super) warnings: Vec<String>,
}

/// Creates a message from the cloud after the masks voted again, or from `None` if they did not.
pub(super) type Notice = Box<dyn FnOnce(Option<&LabelledCloud>) -> String + Send>;

impl From<Vec<Edit>> for Corrected {
    fn from(edits: Vec<Edit>) -> Self {
        Self {
            edits,
            ..Self::default()
        }
    }
}

/// Inputs of a correction in 3-D: the state at its start.
pub(super) struct Correcting {
    pub(super) project: Arc<Project>,
    /// The current cloud and its votes.
    before: ReusableVotes,
    root: PathBuf,
    store: Arc<FrameStore>,
    selector: Option<Arc<Selector>>,
}

impl Session {
    /// Assigns some points and the pixels that see them in all masks to another label, in one step.
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

    /// Starts a job that changes masks and labels, and commits it in one step.
    ///
    /// The job makes the edits from a snapshot of the project. The points of the cloud then vote
    /// again with the changed masks, and the new labels belong to the same step.
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
                        "no mask changes: every mask that may change already shows these points so",
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
    /// Returns the current cloud with the labels of the masks at the start of the correction.
    pub(super) fn cloud_of_now(&self, progress: &Progress) -> Result<VotedCloud> {
        let voted = self
            .before
            .load(&self.project.frames, progress)?
            .context("the voters are not known; fuse again")?;
        Ok(voted.up_to_date(&self.project, &self.store, progress)?)
    }

    /// Returns the edits of the masks that see the selected points.
    fn written_back(&self, correction: &CloudCorrection, progress: &Progress) -> Result<Corrected> {
        progress.stage("choose points")?;
        let VotedCloud { cloud, votes } = self.cloud_of_now(progress)?;
        let selector = self.selector_for(cloud)?;
        let (frames, tree) = (&self.project.frames, &self.project.labels);
        let selection = selector.select(frames, tree, &correction.select, progress)?;
        ensure!(
            !selection.points.is_empty(),
            "no point is selected; draw around visible points"
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
        self.given_back(&seeing, &frames, correction.as_keyframes, give, progress)
    }

    /// Returns the current cloud's points with labels voted by the masks of a project.
    ///
    /// Returns `None` if the frames that voted are unknown.
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

    /// Returns the selector for points of a cloud.
    pub(super) fn selector_for(&self, cloud: Arc<LabelledCloud>) -> Result<Arc<Selector>> {
        match &self.selector {
            Some(selector) if Arc::ptr_eq(selector.cloud(), &cloud) => Ok(Arc::clone(selector)),
            _ => Ok(Arc::new(Selector::new(cloud)?)),
        }
    }

    /// Returns the edits of these frames' masks.
    ///
    /// `change` returns a frame's new mask from its mask and the region that sees the selected
    /// points. If a depth cannot be read, the region consists of the pixels that are recorded to
    /// see points, and a warning names the frame.
    pub(super) fn given_back(
        &self,
        seeing: &SeeingPixels<'_>,
        frames: &[usize],
        as_keyframes: bool,
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
            let region = seeing.in_frame(&MaskedFrame {
                number,
                frame,
                depth: depth.flatten().as_deref(),
                mask: &mask,
            });
            unreadable.extend((is_unreadable && region.is_some()).then_some(frame.name.as_str()));
            let changed = region.and_then(|region| change(number, &mask, region));
            edits.extend(changed.and_then(|mask| {
                mask_edit(
                    project,
                    number,
                    Arc::new(RunMask::encode(&mask)),
                    as_keyframes,
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

    /// Saves the cloud and its surface as voted after the edits, under a version of their own.
    ///
    /// Returns `None` if the frames that voted are unknown.
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
            SavedColors::Image,
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
                steps: Vec::new(),
                stale,
                version,
                ..before
            },
        )))
    }

    /// Saves the surface with labels from the changed masks, and returns whether that was possible.
    ///
    /// If the frames that voted for it are unknown, the surface keeps its labels. Also returns true
    /// if the cloud has no surface.
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

/// Returns the edit that gives a frame other runs after a correction in 3-D.
///
/// Returns `None` if nothing changes. Locked labels keep their pixels. Labels marked as absent
/// return only with `as_keyframe`.
fn mask_edit(
    project: &Project,
    frame: usize,
    runs: Arc<RunMask>,
    as_keyframe: bool,
) -> Option<Edit> {
    let before = project.masks.get(&frame);
    let mask = if as_keyframe {
        keyframe_of(project.with_locks(frame, runs))
    } else {
        let nothing = || FrameMask {
            origin: MaskOrigin::Tracked,
            ..keyframe_of(Arc::clone(&runs))
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

/// Removes the confidences of labels that the mask no longer shows.
fn with_labels_shown(mut mask: FrameMask) -> FrameMask {
    let shown = mask.runs.extents();
    mask.confidence.retain(|label, _| shown.contains_key(label));
    mask
}

/// Returns the edit that keeps corrected masks from becoming stale.
///
/// They would become stale by the change of neighbouring keyframes.
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
