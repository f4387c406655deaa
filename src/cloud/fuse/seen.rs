use std::collections::BTreeMap;

/// A pixel that is known to see a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SeenPoint {
    /// The point's index.
    pub point: u32,
    /// Column of the frame's picture.
    pub x: u32,
    /// Row of the frame's picture.
    pub y: u32,
}

/// By frame number, the points that the frame is known to see, by rising index, each once.
pub type SeenPoints = BTreeMap<usize, Vec<SeenPoint>>;
