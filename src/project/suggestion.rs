//! Suggestions of unlabelled objects.

use crate::SegmenterId;
use std::sync::Arc;

use glam::DVec2;

use crate::{Project, PromptRequest};
use ostra_masks::{
    Apartness, Click, LabelId, LabelMask, Prompt, Proposal, PxBox, Region, deepest_point, outlines,
};

/// An unlabelled object that is suggested for labelling.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// Frame on which it was found.
    pub frame: usize,
    /// A pixel deep inside it.
    pub at_px: DVec2,
    /// Bounding box.
    pub around_px: PxBox,
    /// Borders as closed rings of corners, in pixels.
    pub rings_px: Arc<[Vec<DVec2>]>,
    /// Share of the frame that it covers, 0–1.
    pub share: f64,
    /// Why it is suggested.
    pub why: Reason,
}

/// Why an object is suggested.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// Its motion or depth differs from its surroundings.
    Apart(Apartness),
    /// A segmenter considers it one object, with this confidence (0–1).
    Proposed(f32),
}

/// Maximum number of proposals.
const MOST_PROPOSALS: usize = 40;
/// Labelled share of a proposal above which it is not suggested.
const EXPLAINED: f64 = 0.5;
/// Maximum deviation of a ring from the pixel borders.
const OFF_PX: f64 = 0.7;

impl Suggestion {
    /// Creates a suggestion from the pixels of an object; `None` if there are no pixels.
    #[must_use]
    pub fn of(frame: usize, region: &Region, why: Reason) -> Option<Self> {
        let (x, y) = deepest_point(region)?;
        let rings = outlines(region)
            .into_iter()
            .filter_map(|one| one.simplified(OFF_PX));
        let rings: Arc<[Vec<DVec2>]> = rings
            .flat_map(|one| std::iter::once(one.outer).chain(one.holes))
            .collect();
        let corners = || rings.iter().flatten().copied();
        Some(Self {
            frame,
            at_px: DVec2::new(f64::from(x), f64::from(y)) + 0.5,
            around_px: PxBox {
                min_px: corners().reduce(DVec2::min)?,
                max_px: corners().reduce(DVec2::max)?,
            },
            share: region.area() as f64 / region.inside.len() as f64,
            rings_px: rings,
            why,
        })
    }

    /// Returns the prompt that assigns the object to a label.
    #[must_use]
    pub fn prompt(&self, label: LabelId, segmenter: SegmenterId) -> PromptRequest {
        let clicks = vec![Click {
            at_px: self.at_px,
            include: true,
        }];
        let prompt = Prompt {
            clicks,
            boxes: vec![self.around_px],
            ..Prompt::default()
        };
        PromptRequest {
            frame: self.frame,
            label,
            prompt,
            segmenter,
        }
    }

    /// Returns a one-line description for people.
    #[must_use]
    pub fn text(&self) -> String {
        let why = match self.why {
            Reason::Apart(Apartness::Moves) => "moves on its own".to_owned(),
            Reason::Apart(Apartness::Stands) => "stands apart".to_owned(),
            Reason::Proposed(score) => {
                format!("a single object with {:.0} % confidence", 100.0 * score)
            }
        };
        format!(
            "frame {}: {why}, {:.1} % of the image",
            self.frame,
            self.share * 100.0
        )
    }
}

/// Returns the proposals that the frame's labels do not cover.
///
/// The proposals are expected with the most confident first. They keep their order, and their
/// number is limited.
#[must_use]
pub fn unexplained(project: &Project, frame: usize, proposals: Vec<Proposal>) -> Vec<Suggestion> {
    let mask = project.masks.get(&frame).map(|mask| mask.runs.decode());
    let open = proposals
        .into_iter()
        .filter(|one| mask.as_ref().is_none_or(|mask| !is_explained(mask, one)));
    open.filter_map(|one| Suggestion::of(frame, &one.region, Reason::Proposed(one.score)))
        .take(MOST_PROPOSALS)
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
    use super::*;
    use crate::{FrameMask, MaskOrigin};
    use ostra_masks::RunMask;

    /// Returns a square of 10 × 10 pixels at a corner, in an image of 40 × 30 pixels.
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
    fn labelled_objects_are_not_suggested() {
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
            unexplained(&project, 3, proposals.clone()).len(),
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
                origin: MaskOrigin::Keyframe,
                stale: false,
                confidence: Default::default(),
            },
        );
        let found = unexplained(&project, 3, proposals);
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
