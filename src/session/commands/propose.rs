use std::sync::Arc;

use anyhow::{Context, Result};

use super::prompt::unread_depth;
use crate::Event;
use crate::suggestion::Reason;
use crate::{JobCompletion, JobKind};
use crate::{Session, Suggestion, engines};
use ostra_core::job::JobId;
use ostra_masks::{LabelId, LabelMask, Proposal};
use ostra_project::Project;

/// Most proposals that are offered.
const MOST: usize = 40;
/// Share of a thing above which labels explain it already.
const EXPLAINED: f64 = 0.5;

impl Session {
    /// Offers what a segmenter takes for things on a frame, in the place of earlier suggestions; nothing changes.
    pub(crate) fn propose(&mut self, frame: usize, segmenter: &str) -> Result<JobId> {
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
        Ok(self.start("Propose", JobKind::Short, move |context| {
            let ready = prepared.get(segmenter.as_ref(), &of, &store, &context.progress)?;
            context.progress.stage("propose")?;
            let proposals = ready.proposals(&context.progress)?;
            let needs = || {
                format!(
                    "'{}' only answers prompts; install Segment Anything to have things proposed",
                    segmenter.name()
                )
            };
            let found = offered(&project, frame, proposals.with_context(needs)?);
            let warning = unread_depth(&of, &store)?;
            Ok(Box::new(move |session: &mut Self| {
                session
                    .events
                    .push(Event::Notice(format!("{} things proposed", found.len())));
                session.suggestions = found;
                session.warn_all(warning.into_iter().collect());
                Ok(())
            }) as JobCompletion)
        }))
    }
}

/// Those that no label explains, the surest first.
fn offered(project: &Project, frame: usize, proposals: Vec<Proposal>) -> Vec<Suggestion> {
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    let open = proposals
        .into_iter()
        .filter(|one| mask.as_ref().is_none_or(|mask| !is_explained(mask, one)));
    open.filter_map(|one| Suggestion::of(frame, &one.region, Reason::Proposed(one.score)))
        .take(MOST)
        .collect()
}

fn is_explained(mask: &LabelMask, proposal: &Proposal) -> bool {
    let labelled = mask
        .ids
        .iter()
        .zip(&proposal.region.inside)
        .filter(|&(&id, &inside)| inside && id != LabelId::NONE);
    labelled.count() as f64 > EXPLAINED * proposal.region.area() as f64
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use ostra_masks::{PxBox, Region, RunMask};
    use ostra_project::{FrameMask, MaskOrigin};

    /// A square of 10 × 10 pixels from a corner, in a picture of 40 × 30.
    fn square(x0: usize, y0: usize) -> Region {
        let is_in =
            |at: usize| (x0..x0 + 10).contains(&(at % 40)) && (y0..y0 + 10).contains(&(at / 40));
        Region {
            width: 40,
            height: 30,
            inside: (0..40 * 30).map(is_in).collect(),
        }
    }

    #[test]
    fn what_labels_explain_is_not_offered() {
        let proposal = |(x, y): (usize, usize)| {
            let extent = PxBox {
                min_px: glam::DVec2::ZERO,
                max_px: glam::DVec2::ONE,
            };
            Proposal {
                region: square(x, y),
                extent,
                score: 0.9,
                stability: 1.0,
            }
        };
        let proposals: Vec<Proposal> = [(0, 0), (20, 10), (24, 0)]
            .into_iter()
            .map(proposal)
            .collect();
        let mut project = Project::default();
        assert_eq!(
            offered(&project, 3, proposals.clone()).len(),
            3,
            "a frame without a mask"
        );
        let mask = LabelMask {
            width: 40,
            height: 30,
            ids: square(21, 11)
                .inside
                .iter()
                .map(|&on| LabelId(on.into()))
                .collect(),
        };
        let runs = Arc::new(RunMask::encode(&mask));
        project.masks.insert(
            3,
            FrameMask {
                runs,
                origin: MaskOrigin::Anchor,
                stale: false,
                confidence: Default::default(),
            },
        );
        let found = offered(&project, 3, proposals);
        let places: Vec<[f64; 2]> = found
            .iter()
            .map(|one| one.around_px.min_px.to_array())
            .collect();
        assert_eq!(
            places,
            [[0.0, 0.0], [24.0, 0.0]],
            "the one that is labelled for the most part is gone"
        );
        assert_eq!(
            (found[0].frame, found[0].why, found[0].rings_px[0].len()),
            (3, Reason::Proposed(0.9), 4)
        );
        assert_eq!(found[1].share, 100.0 / 1200.0);
    }
}
