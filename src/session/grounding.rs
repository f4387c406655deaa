use ostra_masks::PxBox;

/// Objects found by text on a frame, offered to the user.
///
/// A search does not change the project. The objects that the user takes become labels and masks in
/// one step.
#[derive(Debug, Clone, PartialEq)]
pub struct Grounding {
    /// Frame number.
    pub frame: usize,
    /// Name of the grounder that found them.
    pub grounder: &'static str,
    /// Found objects, the most confident first.
    pub things: Vec<FoundThing>,
}

/// An object found by a phrase.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundThing {
    /// Phrase that names the object.
    pub phrase: String,
    /// Bounding box of the object.
    pub extent: PxBox,
    /// Confidence, 0–1.
    pub score: f32,
}
