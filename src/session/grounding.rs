use super::Session;
use ostra_masks::PxBox;

/// Things that words found on a frame, to be taken or not.
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

impl Session {
    /// What the last search by words found, but for what was taken since.
    #[must_use]
    pub fn grounding(&self) -> Option<&Grounding> {
        self.grounding.as_ref()
    }

    /// Those that are asked for are no longer offered.
    pub(super) fn drop_found(&mut self, frame: usize, extents: &[PxBox]) {
        if let Some(grounding) = self
            .grounding
            .as_mut()
            .filter(|grounding| grounding.frame == frame)
        {
            grounding
                .things
                .retain(|thing| !extents.contains(&thing.extent));
        }
    }
}
