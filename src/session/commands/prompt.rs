use ostra_project::SegmenterId;
use std::sync::Arc;

use anyhow::{Result, ensure};

use crate::click_segmenter::ClickSegmenter;
use crate::jobs::Job;
use crate::prepared::Preparation;
use crate::{Command, Event};
use crate::{JobCompletion, JobKind};
use crate::{PromptRequest, Session, engines};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::readable;
use ostra_core::job::JobId;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{AnswerSize, AnswerSource, LabelId, Region, Segmenter};
use ostra_project::mask_edits::{check_unlocked, label_name};
use ostra_project::prompt::{PromptMeaning, without_label};
use ostra_project::{Edit, Project};
use ostra_tracking::supervoxels::unfit;

impl Session {
    pub(crate) fn prompt(&mut self, request: &PromptRequest) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        check_unlocked(&project, request.frame, request.label)?;
        ensure!(
            request.prompt.size == AnswerSize::Automatic || !request.prompt.clicks.is_empty(),
            "a size applies to the last click, and the prompt has none"
        );
        self.hover(None);
        if request.prompt.is_empty() {
            self.supersede(request);
            return self
                .take_off(&project, request.frame, request.label)
                .map(|()| None);
        }
        let clicked = self.segmenter_for(request, &project, &frame)?;
        self.supersede(request);
        let (prepared, store, request) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
            request.clone(),
        );
        // `ostra run` waits for geometry, so the recipe names the segmenter that answers now.
        let recorded = clicked.is_early().then(|| PromptRequest {
            segmenter: SegmenterId::Builtin,
            ..request.clone()
        });
        let kind = JobKind::Prompt {
            frame: request.frame,
            label: request.label,
        };
        let basis = self.basis_of(&request)?;
        let job = self.start("Segment", kind, move |context| {
            let segmenter = clicked.segmenter.as_ref();
            let ready = prepared.get(segmenter, &frame, &store, &context.progress)?;
            context.progress.stage("segment")?;
            let meaning = PromptMeaning::new(&basis.project, &request)?;
            let image = store.image(&frame)?;
            let (region, found) =
                meaning.segment_with_source(ready.as_ref(), &image, &context.progress)?;
            let warning = unread_depth(&frame, &store)?;
            let source = clicked.source(found);
            Ok(Box::new(move |session: &mut Self| {
                let choice = source.filter(|_| clicked.chooses);
                session.report_source(source, choice.is_some());
                session.take_answer(&request, meaning, &region, choice)?;
                session.warn_all(warning.into_iter().collect());
                if clicked.is_early() {
                    session.answer_again_when_ready(request)?;
                }
                Ok(())
            }) as JobCompletion)
        });
        if let (Some(request), Some(job)) = (recorded, self.jobs.get_mut(job)) {
            job.command = Some(Command::Prompt(request));
        }
        Ok(Some(job))
    }

    fn segmenter_for(
        &mut self,
        request: &PromptRequest,
        project: &Project,
        frame: &Frame,
    ) -> Result<ClickSegmenter> {
        let is_working = self
            .prompting
            .preparing
            .as_ref()
            .is_some_and(|preparation| self.jobs.is_working(preparation.job));
        self.prompting
            .for_clicks(request, &project.frames, frame, &self.store, is_working)
    }

    /// Returns the segmenter that previews a prompt, or `None` if it is not installed.
    ///
    /// It is the one that would answer the prompt now, unless that encodes the image for every
    /// click.
    pub(crate) fn preview_segmenter(
        &mut self,
        project: &Project,
        request: &PromptRequest,
    ) -> Option<Arc<dyn Segmenter>> {
        let frame = project.frames.get(request.frame)?;
        let request = PromptRequest {
            segmenter: match request.segmenter {
                SegmenterId::SamClose => SegmenterId::Sam,
                id => id,
            },
            ..request.clone()
        };
        let clicked = self.segmenter_for(&request, project, frame).ok()?;
        Some(clicked.segmenter)
    }

    /// Returns a prompt that names the segmenter if geometry is chosen only later.
    ///
    /// A preview is then shown again once geometry would answer.
    pub(crate) fn answered_now(&mut self, request: PromptRequest) -> PromptRequest {
        let Some(project) = self.project().map(Arc::clone) else {
            return request;
        };
        let clicked = project
            .frames
            .get(request.frame)
            .and_then(|frame| self.segmenter_for(&request, &project, frame).ok());
        let is_early = clicked.is_some_and(|clicked| clicked.is_early());
        PromptRequest {
            segmenter: if is_early {
                SegmenterId::Builtin
            } else {
                request.segmenter
            },
            ..request
        }
    }

    /// Reports which segmenter `auto` took and why.
    ///
    /// If the frame leaves no choice, it is reported only when it differs from the last one.
    pub(super) fn report_source(&mut self, source: Option<AnswerSource>, is_choice: bool) {
        let Some(AnswerSource { segmenter, reason }) = source else {
            return;
        };
        let text = format!("segmenter: {segmenter} ({reason})");
        if is_choice || self.prompting.reported.as_ref() != Some(&text) {
            self.events.push(Event::Notice(text.clone()));
            self.prompting.reported = Some(text);
        }
    }

    /// Prepares a frame and then its neighbours for prompts in the background.
    ///
    /// The most recently requested frame goes first.
    pub fn prepare(&mut self, frame: usize, segmenter: SegmenterId) {
        let Some(project) = self.project().map(Arc::clone) else {
            return;
        };
        let Some(name) = project.frames.get(frame).map(|frame| &frame.name) else {
            return;
        };
        let is_same =
            |last: &Preparation| last.segmenter == segmenter && last.is_of(&project.frames, name);
        if self.prompting.preparing.as_ref().is_some_and(is_same) {
            return;
        }
        let geometry = self.prompting.geometry_for(&project.frames, &self.store);
        let fitting = engines::fitting_segmenter(segmenter, &geometry);
        let Ok(previewer) = engines::previewer(segmenter, geometry) else {
            return;
        };
        self.jobs
            .iter()
            .filter(|job| job.kind == JobKind::ReadAhead)
            .for_each(Job::stop);
        let (name, frames) = (name.clone(), Arc::downgrade(&project.frames));
        let (prepared, store) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
        );
        let job = self.start("prepare", JobKind::ReadAhead, move |context| {
            for (done, of) in frames_around(&project.frames, frame).enumerate() {
                let get = |segmenter: &dyn Segmenter| {
                    prepared.get(segmenter, of, &store, &context.progress)
                };
                let fitting = fitting
                    .as_ref()
                    .filter(|_| unfit(&project.frames, of).is_none());
                // The first clicks need not wait for geometry.
                let ready = get(previewer.as_ref()).and_then(|ready| match fitting {
                    Some(fitting) => get(fitting),
                    None => Ok(ready),
                });
                let ready = match ready {
                    // Problems with a neighbour are reported when it is shown.
                    Err(_) if done > 0 => {
                        context.progress.check()?;
                        continue;
                    }
                    ready => ready?,
                };
                if done == 0 && !prepared.has_room_for(ready.bytes() * AHEAD.len()) {
                    break;
                }
            }
            Ok(Box::new(|_: &mut Self| Ok(())) as JobCompletion)
        });
        self.prompting.preparing = Some(Preparation {
            frame: name,
            segmenter,
            frames,
            job,
        });
    }

    /// Discards prompts for the same label and frame that are still being answered.
    fn supersede(&mut self, request: &PromptRequest) {
        let same = JobKind::Prompt {
            frame: request.frame,
            label: request.label,
        };
        let former = self.jobs.iter_mut().filter(|job| job.kind == same);
        former.for_each(Job::discard);
    }

    /// Composes an answer into the frame's mask.
    ///
    /// If the project changed while the answer was computed, the prompt is interpreted again. An
    /// answer that changes no pixel makes no step. `choice` is the segmenter chosen for it.
    pub(super) fn take_answer(
        &mut self,
        request: &PromptRequest,
        meaning: PromptMeaning,
        region: &Region,
        choice: Option<AnswerSource>,
    ) -> Result<()> {
        let PromptBasis {
            project,
            replaces_last,
        } = self.basis_of(request)?;
        let meaning = if meaning.is_of(&project) {
            meaning
        } else {
            PromptMeaning::new(&project, request)?
        };
        let edits = meaning.edits(&project, region)?;
        let name = label_name(&project, request.label)?;
        let how = if request.prompt.clicks.is_empty() {
            "Box around"
        } else {
            "Click on"
        };
        let mut title = format!("{how} {name}, frame {}", request.frame);
        if let Some(AnswerSource { segmenter, reason }) = choice {
            title += &format!(" ({segmenter}: {reason})");
        }
        let unchanged = if replaces_last && self.shows(request.frame, &edits) {
            Some(format!(
                "There is no {} answer to this click; try another place, or the brush",
                comparative(request.prompt.size)
            ))
        } else {
            meaning.why_unchanged(&project, &edits)?
        };
        if let Some(text) = unchanged {
            self.events.push(Event::Unchanged {
                frame: request.frame,
                label: request.label,
                text,
            });
            return Ok(());
        }
        if replaces_last {
            self.opened()?.undo()?;
        }
        let committed = self.commit(&title, edits);
        if replaces_last && committed.is_err() {
            self.opened()?.redo()?;
        }
        committed?;
        if meaning.keeps_outside() {
            self.events.push(Event::Notice(format!(
                "The mask of '{name}' outside the box is kept; to start again, remove the label from the frame first"
            )));
        }
        Ok(())
    }

    /// Returns the state that a prompt is applied to.
    ///
    /// If the last answered click is answered again, in another size or by another segmenter, this is
    /// the state before that click.
    pub(super) fn basis_of(&self, request: &PromptRequest) -> Result<PromptBasis> {
        let project = self.snapshot()?;
        let answered = self.last_prompt() == Some((request.frame, request.label));
        let same = project
            .prompts
            .get(&(request.frame, request.label))
            .filter(|prompt| answered && prompt.has_inputs_of(&request.prompt));
        let step = self
            .open
            .as_ref()
            .and_then(|open| open.history().last())
            .filter(|_| same.is_some());
        let Some(step) = step else {
            return Ok(PromptBasis {
                project,
                replaces_last: false,
            });
        };
        let mut before = Project::clone(&project);
        for edit in step.back() {
            before.apply(edit)?;
        }
        Ok(PromptBasis {
            project: Arc::new(before),
            replaces_last: true,
        })
    }

    /// Returns the frame and label of the prompt that the last step answered.
    ///
    /// The size of that answer can still be changed.
    #[must_use]
    pub fn last_prompt(&self) -> Option<(usize, LabelId)> {
        let open = self.open.as_ref()?;
        let (frame, label, prompt) = open.history().last()?.answered_prompt()?;
        let is_current = open.project().prompts.get(&(frame, label)) == Some(prompt);
        (is_current && !prompt.clicks.is_empty()).then_some((frame, label))
    }

    /// Returns whether a frame's mask already has the pixels that the edits would give it.
    fn shows(&self, frame: usize, edits: &[Edit]) -> bool {
        let now = self.project().and_then(|project| project.masks.get(&frame));
        edits.iter().any(|edit| match edit {
            Edit::SetMask {
                mask: Some(mask), ..
            } => now.is_some_and(|now| now.runs == mask.runs),
            _ => false,
        })
    }

    /// Removes a label from a frame.
    ///
    /// A frame without any remaining label is no longer a keyframe.
    fn take_off(&mut self, project: &Project, frame: usize, label: LabelId) -> Result<()> {
        let name = label_name(project, label)?;
        let edits = without_label(project, frame, label)?;
        self.commit(&format!("Remove {name} from frame {frame}"), edits)
    }
}

/// State of the project that a prompt is applied to.
pub(super) struct PromptBasis {
    pub project: Arc<Project>,
    /// Whether the answer replaces the last step.
    pub replaces_last: bool,
}

fn comparative(size: AnswerSize) -> &'static str {
    match size {
        AnswerSize::Smallest | AnswerSize::Smaller => "smaller",
        AnswerSize::Automatic => "other",
        AnswerSize::Larger | AnswerSize::Largest => "larger",
    }
}

/// Returns a warning that names the frame if its depth cannot be read.
pub(super) fn unread_depth(frame: &Frame, store: &FrameStore) -> Result<Option<String>> {
    let depth = readable(store.depth(frame).map_err(SceneError::from))?;
    let name = &frame.name;
    Ok(depth.is_none().then(|| {
        format!(
            "{name} has a depth that cannot be read, and is segmented without it; check its file"
        )
    }))
}

/// Offsets of the frames that are prepared, relative to the one shown.
const AHEAD: [isize; 5] = [0, 1, -1, 2, -2];

/// Returns a frame and its neighbours, the nearest first.
fn frames_around(frames: &[Frame], at: usize) -> impl Iterator<Item = &Frame> {
    AHEAD
        .into_iter()
        .filter_map(move |step| frames.get(at.checked_add_signed(step)?))
}
