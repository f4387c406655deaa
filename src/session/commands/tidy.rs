use anyhow::{Context, Result};

use super::paint::{by_hand, check_unlocked, label_name, mask_of};
use crate::Event;
use crate::{Session, TidyRequest};
use ostra_masks::tidy;

impl Session {
    pub(crate) fn tidy(&mut self, request: &TidyRequest) -> Result<()> {
        let project = self.snapshot()?;
        let (name, frame) = (label_name(&project, request.label)?, request.frame);
        check_unlocked(&project, frame, request.label)?;
        let mut mask = mask_of(&project, frame)?;
        let before = mask.clone();
        tidy(
            &mut mask,
            request.label,
            request.holes_below_px,
            request.islands_below_px,
            &project.labels,
        )
        .with_context(|| format!("'{name}' on frame {frame}"))?;
        if mask == before {
            self.events.push(Event::Notice(format!(
                "{name} on frame {frame} has no holes or islands of that size"
            )));
            return Ok(());
        }
        self.commit(
            &format!("Tidy {name} on frame {frame}"),
            by_hand(&project, frame, &mask),
        )
    }
}
