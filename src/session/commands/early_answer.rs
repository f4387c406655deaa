//! Answers that came before their frame was prepared for geometry. They are given again once it is.

use std::sync::Arc;

use anyhow::Result;

use crate::{Command, JobCompletion, JobKind, PromptRequest, Session, engines};
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{AnswerSource, Region, Segmenter};
use ostra_project::Project;
use ostra_project::prompt::PromptMeaning;

/// An answer of the built-in segmenter that geometry may improve.
struct EarlyAnswer {
    request: PromptRequest,
    /// The pixels of the label on the frame since then.
    region: Option<Region>,
}

impl EarlyAnswer {
    /// Returns whether neither the prompt nor the pixels of the label were changed since.
    fn stands(&self, project: &Project) -> bool {
        let PromptRequest { frame, label, .. } = self.request;
        let prompt = project.prompts.get(&(frame, label));
        prompt.is_some_and(|prompt| prompt.has_inputs_of(&self.request.prompt))
            && region_of(project, &self.request) == self.region
    }
}

/// Returns the pixels of the label on the frame of a prompt.
fn region_of(project: &Project, request: &PromptRequest) -> Option<Region> {
    let mask = project.masks.get(&request.frame)?;
    Some(mask.runs.decode().region(request.label))
}

impl Session {
    /// Answers a prompt again in the background, once its frame is prepared for geometry.
    ///
    /// The new answer replaces the early one, as the same step if nothing was done since. If its label
    /// was changed on the frame in the meantime, the new answer is dropped.
    pub(super) fn answer_again_when_ready(&mut self, request: PromptRequest) -> Result<()> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        let before = self.basis_of(&request)?.project;
        let geometry = self.prompting.geometry_for(&project.frames, &self.store);
        let Some(segmenter) = engines::fitting_segmenter(request.segmenter, &geometry) else {
            return Ok(());
        };
        let early = EarlyAnswer {
            region: region_of(&project, &request),
            request,
        };
        let (prepared, store) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
        );
        self.start("Segment again", JobKind::Background, move |context| {
            let ready = prepared.get(&segmenter, &frame, &store, &context.progress)?;
            let meaning = PromptMeaning::new(&before, &early.request)?;
            let image = store.image(&frame)?;
            let (region, source) =
                meaning.segment_with_source(ready.as_ref(), &image, &context.progress)?;
            Ok(Box::new(move |session: &mut Self| {
                session.replace_early_answer(&early, meaning, &region, source)
            }) as JobCompletion)
        });
        Ok(())
    }

    fn replace_early_answer(
        &mut self,
        early: &EarlyAnswer,
        meaning: PromptMeaning,
        region: &Region,
        source: Option<AnswerSource>,
    ) -> Result<()> {
        let by_another =
            source.filter(|source| source.segmenter != Segmenter::name(&BuiltinSegmenter));
        let project = self.snapshot()?;
        if by_another.is_none() || !early.stands(&project) || early.region.as_ref() == Some(region)
        {
            return Ok(());
        }
        self.report_source(by_another, true);
        self.take_answer(&early.request, meaning, region, by_another)?;
        self.record(Some(Command::Prompt(early.request.clone())));
        Ok(())
    }
}
