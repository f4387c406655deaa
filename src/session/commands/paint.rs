use std::sync::Arc;

use anyhow::{Context, Result, bail};

use crate::{CleanRequest, MoveBorderRequest, PaintRequest, Session, TraceRequest};
use crate::{Event, JobCompletion, JobKind};
use ostra_core::job::JobId;
use ostra_frames::Frame;
use ostra_masks::{
    BorderDrag, PaintRule, Region, assign, erase, fill_polygons, pull, snapped_stroke, stroke,
    tidy, trace,
};
use ostra_project::mask_edits::{by_hand, check_unlocked, keyframe_of, label_name, mask_of};
use ostra_project::{Edit, MaskOrigin};

impl Session {
    /// Paints on a frame's mask.
    ///
    /// This is done immediately, except for a brush that snaps to edges. A job reads the image for
    /// it.
    pub(crate) fn paint(&mut self, request: &PaintRequest) -> Result<Option<JobId>> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        check_unlocked(&project, request.frame, request.label)?;
        if !request.snap || request.radius_px == 0.0 {
            let region = painted(&frame, request)?;
            return self.take_painted(request, &region).map(|()| None);
        }
        let (store, request) = (Arc::clone(&self.store), request.clone());
        Ok(Some(self.start("Paint", JobKind::Short, move |context| {
            context.progress.stage("paint")?;
            let region = snapped_stroke(
                &*store.image(&frame)?,
                &request.points_px,
                request.radius_px,
            )?;
            Ok(
                Box::new(move |session: &mut Self| session.take_painted(&request, &region))
                    as JobCompletion,
            )
        })))
    }

    /// Assigns the painted pixels to the label, or erases them, in the frame's current mask.
    fn take_painted(&mut self, request: &PaintRequest, region: &Region) -> Result<()> {
        let project = self.snapshot()?;
        let name = label_name(&project, request.label)?;
        check_unlocked(&project, request.frame, request.label)?;
        let mut mask = mask_of(&project, request.frame)?;
        if request.erase {
            erase(&mut mask, region, Some(request.label))?;
        } else {
            assign(
                &mut mask,
                region,
                request.label,
                rule(request.replace),
                &project.labels,
            )?;
        }
        let verb = if request.erase { "Erase" } else { "Paint" };
        let edits = by_hand(&project, request.frame, &mask);
        self.commit(&format!("{verb} {name} on frame {}", request.frame), edits)
    }

    /// Drags the border of a label on a frame; nothing happens if no pixel changes.
    pub(crate) fn pull(&mut self, request: &MoveBorderRequest) -> Result<()> {
        let project = self.snapshot()?;
        let MoveBorderRequest {
            frame,
            label,
            from_px,
            to_px,
            replace,
        } = *request;
        let name = label_name(&project, label)?;
        check_unlocked(&project, frame, label)?;
        let mut mask = mask_of(&project, frame)?;
        let pulled = pull(
            &mut mask,
            BorderDrag { from_px, to_px },
            label,
            rule(replace),
            &project.labels,
        );
        if pulled
            .with_context(|| format!("the border of '{name}' on frame {frame} cannot be moved"))?
            == 0
        {
            return Ok(());
        }
        let edits = by_hand(&project, frame, &mask);
        self.commit(&format!("Move border of {name} on frame {frame}"), edits)
    }

    pub(crate) fn make_keyframe(&mut self, frame: usize) -> Result<()> {
        let project = self.snapshot()?;
        project.frame(frame)?;
        let mask = project
            .masks
            .get(&frame)
            .with_context(|| format!("frame {frame} has no mask; prompt or track first"))?;
        if mask.origin == MaskOrigin::Keyframe {
            bail!("frame {frame} is a keyframe already");
        }
        let mask = keyframe_of(Arc::clone(&mask.runs));
        self.commit(
            &format!("Make frame {frame} a keyframe"),
            vec![Edit::SetMask {
                frame,
                mask: Some(mask),
            }],
        )
    }

    pub(crate) fn clear_mask(&mut self, frame: usize) -> Result<()> {
        let project = self.snapshot()?;
        project.frame(frame)?;
        project
            .locked_on(frame)
            .into_iter()
            .try_for_each(|label| check_unlocked(&project, frame, label))?;
        let prompts = project.prompts.keys().filter(|(of, _)| *of == frame);
        let mut edits: Vec<Edit> = prompts
            .map(|&(frame, label)| Edit::SetPrompt {
                frame,
                label,
                prompt: None,
            })
            .collect();
        edits.push(Edit::SetMask { frame, mask: None });
        self.commit(&format!("Clear frame {frame}"), edits)
    }

    pub(crate) fn trace(&mut self, request: &TraceRequest) -> Result<JobId> {
        let project = self.snapshot()?;
        let frame = project.frame(request.frame)?.clone();
        check_unlocked(&project, request.frame, request.label)?;
        let (store, request) = (Arc::clone(&self.store), request.clone());
        Ok(self.start("Trace", JobKind::Short, move |context| {
            context.progress.stage("trace")?;
            let region = trace(&*store.image(&frame)?, &request.points_px)?;
            Ok(
                Box::new(move |session: &mut Self| session.take_trace(&request, &region))
                    as JobCompletion,
            )
        }))
    }

    /// Assigns the traced pixels to the label in the frame's current mask.
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

    pub(crate) fn tidy(&mut self, request: &CleanRequest) -> Result<()> {
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
            &format!("Clean {name} on frame {frame}"),
            by_hand(&project, frame, &mask),
        )
    }
}

fn painted(frame: &Frame, request: &PaintRequest) -> Result<Region> {
    let (width, height) = (frame.width, frame.height);
    Ok(if request.radius_px == 0.0 {
        fill_polygons(width, height, std::slice::from_ref(&request.points_px))?
    } else {
        stroke(width, height, &request.points_px, request.radius_px)?
    })
}

/// Returns the rule for pixels of other labels.
fn rule(replace: bool) -> PaintRule {
    if replace {
        PaintRule::Replace
    } else {
        PaintRule::Protect
    }
}
