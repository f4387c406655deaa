use glam::DVec2;

use super::{Command, PromptRequest};
use crate::masks::{Apartness, Click, LabelId, Prompt, PxBox};

/// A thing that no label explains, offered to be labelled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Suggestion {
    /// The frame on which it was found.
    pub frame: usize,
    /// A pixel deep inside it.
    pub at_px: DVec2,
    /// The box around it.
    pub around_px: PxBox,
    /// Share of the frame that it takes, 0–1.
    pub share: f64,
    /// Why it is offered.
    pub why: Apartness,
}

impl Suggestion {
    /// The prompt that gives it to a label.
    #[must_use]
    pub fn prompt(&self, label: LabelId, segmenter: &str) -> Command {
        let clicks = vec![Click { at_px: self.at_px, include: true }];
        let prompt = Prompt { clicks, boxes: vec![self.around_px] };
        Command::Prompt(PromptRequest { frame: self.frame, label, prompt, segmenter: segmenter.to_owned() })
    }

    /// One line for people.
    #[must_use]
    pub fn text(&self) -> String {
        let why = match self.why {
            Apartness::Moves => "moves on its own",
            Apartness::Stands => "stands apart",
        };
        format!("frame {}: {why}, {:.1} % of the picture", self.frame, self.share * 100.0)
    }
}
