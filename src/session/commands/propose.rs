use crate::job_task::JobTask;
use std::sync::Arc;

use anyhow::{Context, Result};

use super::prompt::unread_depth;
use crate::Event;
use crate::{JobCompletion, JobKind};
use crate::{Session, engines};
use ostra_core::job::JobId;
use ostra_project::SegmenterId;
use ostra_project::suggestion::unexplained;

impl Session {
    /// Replaces the suggestions by the objects that a segmenter proposes on a frame.
    ///
    /// The project does not change.
    pub(crate) fn propose(&mut self, frame: usize, segmenter: SegmenterId) -> Result<JobId> {
        let project = self.snapshot()?;
        let of = project.frame(frame)?.clone();
        let segmenter = engines::previewer(
            segmenter,
            self.prompting.geometry_for(&project.frames, &self.store),
        )?;
        let (prepared, store) = (
            Arc::clone(&self.prompting.prepared),
            Arc::clone(&self.store),
        );
        Ok(
            self.start(JobTask::Propose, JobKind::Short, move |context| {
                let ready = prepared.get(segmenter.as_ref(), &of, &store, &context.progress)?;
                context.progress.stage("propose")?;
                let proposals = ready.proposals(&context.progress)?;
                let needs = || {
                    format!(
                        "'{}' only answers prompts; install Segment Anything to get proposals",
                        segmenter.name()
                    )
                };
                let found = unexplained(&project, frame, proposals.with_context(needs)?);
                let warning = unread_depth(&of, &store)?;
                Ok(Box::new(move |session: &mut Self| {
                    session
                        .events
                        .push(Event::Notice(format!("{} objects proposed", found.len())));
                    session.suggestions = found;
                    session.warn_all(warning.into_iter().collect());
                    Ok(())
                }) as JobCompletion)
            }),
        )
    }
}
