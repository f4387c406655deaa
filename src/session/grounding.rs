use ostra_masks::PxBox;

/// Things that words found on a frame, to be taken or not: a search changes nothing. What the user takes becomes labels and
/// masks in one step.
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
