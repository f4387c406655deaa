use std::sync::Arc;

use glam::DVec2;

use crate::{Command, PromptRequest};
use ostra_masks::{Apartness, Click, LabelId, Prompt, PxBox, Region, deepest_point, outlines};

/// A thing that no label explains, offered to be labelled.
#[derive(Debug, Clone, PartialEq)]
pub struct Suggestion {
    /// The frame on which it was found.
    pub frame: usize,
    /// A pixel deep inside it.
    pub at_px: DVec2,
    /// The box around it.
    pub around_px: PxBox,
    /// Its borders as closed rings of corners in pixels.
    pub rings_px: Arc<[Vec<DVec2>]>,
    /// Share of the frame that it takes, 0–1.
    pub share: f64,
    /// Why it is offered.
    pub why: Reason,
}

/// Why a thing is offered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reason {
    /// Something sets it apart from what is around it.
    Apart(Apartness),
    /// A segmenter takes it for one thing, so sure (0–1).
    Proposed(f32),
}

/// Things that words found on a frame, to be taken or not: a search changes nothing. What the user takes becomes labels and masks in
/// one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Grounding {
    /// Frame number.
    pub frame: usize,
    /// What found them.
    pub grounder: &'static str,
    /// The surest first.
    pub things: Vec<FoundThing>,
}

/// A thing that a phrase names.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundThing {
    /// The phrase.
    pub phrase: String,
    /// Box around the thing.
    pub extent: PxBox,
    /// How sure it is, 0–1.
    pub score: f32,
}

/// How far a ring may be off the pixels' borders.
const OFF_PX: f64 = 0.7;

impl Suggestion {
    /// Of the pixels of a thing; `None` where there are none.
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

    /// The prompt that gives it to a label.
    #[must_use]
    pub fn prompt(&self, label: LabelId, segmenter: &str) -> Command {
        let clicks = vec![Click {
            at_px: self.at_px,
            include: true,
        }];
        let prompt = Prompt {
            clicks,
            boxes: vec![self.around_px],
            ..Prompt::default()
        };
        Command::Prompt(PromptRequest {
            frame: self.frame,
            label,
            prompt,
            segmenter: segmenter.to_owned(),
        })
    }

    /// One line for people.
    #[must_use]
    pub fn text(&self) -> String {
        let why = match self.why {
            Reason::Apart(Apartness::Moves) => "moves on its own".to_owned(),
            Reason::Apart(Apartness::Stands) => "stands apart".to_owned(),
            Reason::Proposed(score) => format!("one thing to {:.0} %", 100.0 * score),
        };
        format!(
            "frame {}: {why}, {:.1} % of the picture",
            self.frame,
            self.share * 100.0
        )
    }
}
