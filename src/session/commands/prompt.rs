use ostra_project::SegmenterId;
use std::sync::Arc;

use anyhow::{Result, ensure};

use crate::Event;
use crate::jobs::Job;
use crate::{JobCompletion, JobKind};
use crate::{PromptRequest, Session, engines};
use ostra_cloud::SceneError;
use ostra_cloud::fuse::{naming, readable};
use ostra_core::job::JobId;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{AnswerSize, LabelId, Region};
use ostra_project::mask_edits::{check_unlocked, label_name};
use ostra_project::prompt::{PromptMeaning, without_label};
use ostra_project::{Edit, Project};

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
        let segmenter = engines::segmenter(
            request.segmenter,
            self.prompting.geometry_for(&project.frames, &self.store),
        )?;
        self.supersede(request);
        if request.segmenter == SegmenterId::Auto
            && self.prompting.reported.replace(segmenter.name()) != Some(segmenter.name())
        {
            self.events
                .push(Event::Notice(format!("segmenter: {}", segmenter.name())));
        }
        let (prepared, store, request) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
            request.clone(),
        );
        let kind = JobKind::Prompt {
            frame: request.frame,
            label: request.label,
        };
        let basis = self.basis_of(&request)?;
        Ok(Some(self.start("Segment", kind, move |context| {
            let ready = prepared.get(segmenter.as_ref(), &frame, &store, &context.progress)?;
            context.progress.stage("segment")?;
            let meaning = PromptMeaning::new(&basis.project, &request)?;
            let image = store.image(&frame)?;
            let region = meaning.segment(ready.as_ref(), &image, &context.progress)?;
            let warning = unread_depth(&frame, &store)?;
            Ok(Box::new(move |session: &mut Self| {
                session.take_answer(&request, meaning, &region)?;
                session.warn_all(warning.into_iter().collect());
                Ok(())
            }) as JobCompletion)
        })))
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
        if self.prompting.preparing.as_deref() == Some(name) {
            return;
        }
        let Ok(segmenter) = engines::previewer(
            segmenter,
            self.prompting.geometry_for(&project.frames, &self.store),
        ) else {
            return;
        };
        self.jobs
            .iter()
            .filter(|job| job.kind == JobKind::ReadAhead)
            .for_each(Job::stop);
        self.prompting.preparing = Some(name.clone());
        let (prepared, store) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
        );
        self.start("prepare", JobKind::ReadAhead, move |context| {
            for (done, of) in frames_around(&project.frames, frame).enumerate() {
                let ready = match prepared.get(segmenter.as_ref(), of, &store, &context.progress) {
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
    /// answer that changes no pixel makes no step.
    fn take_answer(
        &mut self,
        request: &PromptRequest,
        meaning: PromptMeaning,
        region: &Region,
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
        let title = format!("{how} {name}, frame {}", request.frame);
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
    /// If only the size of the last answered click changes, this is the state before that click.
    fn basis_of(&self, request: &PromptRequest) -> Result<PromptBasis> {
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
            .filter(|_| same.is_some_and(|prompt| prompt.size != request.prompt.size));
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
struct PromptBasis {
    project: Arc<Project>,
    /// Whether the answer replaces the last step.
    replaces_last: bool,
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
    let unread = depth.is_none().then_some(frame.name.as_str());
    Ok(naming(
        "have a depth that cannot be read, and are segmented without it; check their files",
        unread.as_slice(),
    ))
}

/// Offsets of the frames that are prepared, relative to the one shown.
const AHEAD: [isize; 5] = [0, 1, -1, 2, -2];

/// Returns a frame and its neighbours, the nearest first.
fn frames_around(frames: &[Frame], at: usize) -> impl Iterator<Item = &Frame> {
    AHEAD
        .into_iter()
        .filter_map(move |step| frames.get(at.checked_add_signed(step)?))
}
