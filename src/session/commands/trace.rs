use std::sync::Arc;

use anyhow::Result;

use super::paint::{by_hand, check_unlocked, label_name, mask_of, rule};
use crate::{Kind, Landing};
use crate::{Session, TraceRequest};
use ostra_core::job::JobId;
use ostra_masks::{Region, assign, trace};

impl Session {
    pub(crate) fn trace(&mut self, request: &TraceRequest) -> Result<JobId> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        check_unlocked(&project, request.frame, request.label)?;
        let (store, request) = (Arc::clone(&self.store), request.clone());
        Ok(self.start("Trace", Kind::Short, move |link| {
            link.progress.stage("trace")?;
            let region = trace(&*store.image(&frame)?, &request.points_px)?;
            Ok(
                Box::new(move |session: &mut Self| session.take_trace(&request, &region))
                    as Landing,
            )
        }))
    }

    /// Gives the traced pixels to the label, in the frame's mask as it is now.
    fn take_trace(&mut self, request: &TraceRequest, region: &Region) -> Result<()> {
        let project = self.snapshot()?;
        let name = label_name(&project, request.label)?;
        let mut mask = mask_of(&project, request.frame)?;
        assign(
            &mut mask,
            region,
            request.label,
            rule(request.replace),
            &project.labels,
        )?;
        let edits = by_hand(&project, request.frame, &mask);
        self.commit(&format!("Trace {name} on frame {}", request.frame), edits)
    }
}
