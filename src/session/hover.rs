use std::sync::Arc;

use super::jobs::{Kind, Landing};
use super::{PromptRequest, Session, engines};
use ostra_core::job::JobId;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelMask, PreparedFrame, RunMask};
use ostra_project::Project;
use ostra_project::prompt::PromptMeaning;

/// A prompt that nobody sent yet, and what it would give.
#[derive(Default)]
pub(super) struct Hover {
    wanted: Option<PromptRequest>,
    answering: Option<JobId>,
    answer: Option<Arc<RunMask>>,
}

impl Session {
    /// Asks what a prompt would give if it were sent, or, with `None`, for nothing any more. It is answered in the
    /// background: one at a time, the newest wish next, from the same prepared frame as a prompt. Nothing is committed.
    pub fn hover(&mut self, wanted: Option<PromptRequest>) {
        if self.hover.wanted == wanted {
            return;
        }
        self.hover.wanted = wanted;
        self.hover.answer = None;
        self.answer_hover();
    }

    /// The answer to the newest wish of [`Self::hover`], where it is there: a mask of that prompt's label alone.
    #[must_use]
    pub fn hovered(&self) -> Option<&Arc<RunMask>> {
        self.hover.answer.as_ref()
    }

    fn answer_hover(&mut self) {
        let is_answering = |id| self.jobs.iter().any(|job| job.id == id && !job.has_ended());
        if self.hover.answering.is_some_and(is_answering) {
            return;
        }
        let (Some(request), Ok(project)) = (self.hover.wanted.clone(), self.snapshot()) else {
            return;
        };
        let geometry = self.geometry_for(&project);
        let (Some(frame), Ok(segmenter)) = (
            project.frames.get(request.frame).cloned(),
            engines::previewer(&request.segmenter, geometry),
        ) else {
            return;
        };
        let (prepared, store) = (Arc::clone(&self.prepared), Arc::clone(&self.store));
        self.hover.answering = Some(self.start("hover", Kind::Background, move |link| {
            // What cannot be shown is not worth a word: the click itself will tell.
            let ready = prepared
                .get(segmenter.as_ref(), &frame, &store, &link.progress)
                .ok();
            let answer = ready
                .and_then(|ready| shown_alone(ready.as_ref(), &project, &request, &link.progress))
                .map(Arc::new);
            Ok(Box::new(move |session: &mut Self| {
                session.take_hover(&request, answer);
                Ok(())
            }) as Landing)
        }));
    }

    fn take_hover(&mut self, request: &PromptRequest, answer: Option<Arc<RunMask>>) {
        self.hover.answering = None;
        if self.hover.wanted.as_ref() == Some(request) {
            self.hover.answer = answer;
        } else {
            self.answer_hover();
        }
    }
}

/// The pixels that a prompt would get, as a mask of its label.
fn shown_alone(
    ready: &dyn PreparedFrame,
    project: &Project,
    request: &PromptRequest,
    progress: &Progress,
) -> Option<RunMask> {
    let meaning = PromptMeaning::new(project, request).ok()?;
    let region = meaning.segment(ready, progress).ok()?;
    let id = |&inside: &bool| if inside { request.label } else { LabelId::NONE };
    let ids = region.inside.iter().map(id).collect();
    Some(RunMask::encode(&LabelMask {
        width: region.width,
        height: region.height,
        ids,
    }))
}
