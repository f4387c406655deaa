use serde::{Deserialize, Serialize};

/// Names a label in masks and clouds; 0 = nothing.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize,
)]
#[serde(transparent)]
pub struct LabelId(pub u16);

impl LabelId {
    /// No label.
    pub const NONE: Self = Self(0);
}

/// A node of the label tree (semantic › instance › part).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Label {
    /// Its id, never 0.
    pub id: LabelId,
    /// Unique in the tree, not empty, no line break.
    pub name: String,
    /// sRGB.
    pub color: [u8; 3],
    /// `None` = top level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub parent: Option<LabelId>,
}
