use crate::job_task::JobTitle;
use std::collections::BTreeSet;

use anyhow::{Result, ensure};

use crate::{JobCompletion, JobKind};
use crate::{RangeRequest, Session};
use ostra_core::job::{JobId, Progress};
use ostra_masks::LabelId;
use ostra_project::{Edit, range};

impl Session {
    /// Changes labels over a range of frames, in one step.
    ///
    /// Pixels of other labels and of locked labels stay unchanged.
    pub(crate) fn change_range(&mut self, request: &RangeRequest) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let labels = range::labels_of(&project, request)?;
        let title = range::title(&project, request, &labels)?;
        if range::takes_time(request.change) {
            return self.in_a_job(request, title, labels).map(Some);
        }
        let edits = range::edits(&project, request, &labels, &Progress::default())?;
        self.commit_range(&title, edits)?;
        Ok(None)
    }

    /// Commits a change in one step; labels that the masks now show are no longer marked as absent.
    fn commit_range(&mut self, title: &str, mut edits: Vec<Edit>) -> Result<()> {
        ensure!(
            !edits.is_empty(),
            "{}: there is nothing to change on these frames",
            title.to_lowercase()
        );
        edits.extend(self.snapshot()?.there_again(&edits));
        self.commit(title, edits)
    }

    /// Starts a job for a slow change.
    ///
    /// It works on the current masks, and the result is rejected if they change in the meantime.
    fn in_a_job(
        &mut self,
        request: &RangeRequest,
        title: String,
        labels: BTreeSet<LabelId>,
    ) -> Result<JobId> {
        let (made_from, request) = (self.snapshot()?, request.clone());
        Ok(self.start(
            JobTitle::from(title.as_str()),
            JobKind::Short,
            move |context| {
                let edits = range::edits(&made_from, &request, &labels, &context.progress)?;
                Ok(Box::new(move |session: &mut Self| {
                    let now = session.snapshot()?;
                    let touched = || request.from..=request.to;
                    let same =
                        touched().all(|frame| now.masks.get(&frame) == made_from.masks.get(&frame));
                    let same =
                        same && now.marks == made_from.marks && now.prompts == made_from.prompts;
                    ensure!(same, "the masks changed meanwhile; do it again");
                    session.commit_range(&title, edits)
                }) as JobCompletion)
            },
        ))
    }
}
