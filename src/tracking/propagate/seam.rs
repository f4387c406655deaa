use ostra_frames::Image;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// A network that carries masks from one picture to the next, in one direction; made anew for each walk through the frames.
pub(crate) trait Propagator {
    /// Takes the labels of `mask` on `image` as given: the first picture of the walk, a later anchor, or one on which labels
    /// appear for the first time. Labels that `mask` does not show keep what was remembered of them.
    fn remember(&mut self, image: &Image, mask: &LabelMask) -> Result<(), MaskError>;

    /// The next picture of the walk.
    fn propagate(&mut self, image: &Image) -> Result<Propagated, MaskError>;
}

/// Where a network sees the labels in a picture.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Propagated {
    /// The labels, ascending.
    pub labels: Vec<LabelId>,
    /// Size of the maps, px: the picture's own size.
    pub width: usize,
    pub height: usize,
    /// `[1 + labels][height][width]`, row by row: the probability of nothing, then of each label; they sum to 1.
    pub probabilities: Vec<f32>,
}
