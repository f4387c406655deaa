use serde::{Deserialize, Serialize};

use ostra_cloud::select::SelectStep;
use ostra_masks::LabelId;

/// A correction in 3-D: points of the cloud are chosen, and every mask that sees them is changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CloudCorrection {
    /// How the points are chosen, step by step.
    pub select: Vec<SelectStep>,
    /// What becomes of the pixels that see them.
    pub change: CloudChange,
    /// The frames that change become anchors; else each stays what it was, and a frame without a mask gets a tracked one.
    #[serde(default)]
    pub as_anchors: bool,
}

/// What a correction in 3-D does to the pixels that see the chosen points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CloudChange {
    /// They become this label's.
    Assign(LabelId),
    /// They become nothing's.
    Clear,
}

impl CloudChange {
    /// The label that pixels get.
    #[must_use]
    pub fn label(self) -> LabelId {
        match self {
            Self::Assign(label) => label,
            Self::Clear => LabelId::NONE,
        }
    }
}
