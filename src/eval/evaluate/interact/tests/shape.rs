//! Synthetic masks of one label.

use ostra_masks::{LabelId, LabelMask};

pub const LABEL: LabelId = LabelId(1);
/// Number of columns and rows.
pub const SIZE: u32 = 100;

/// Returns a mask whose label covers the columns and rows that `is_inside` accepts.
pub fn mask(is_inside: impl Fn(u32, u32) -> bool) -> LabelMask {
    let id = |at: u32| {
        if is_inside(at % SIZE, at / SIZE) {
            LABEL
        } else {
            LabelId::NONE
        }
    };
    LabelMask {
        width: SIZE,
        height: SIZE,
        ids: (0..SIZE * SIZE).map(id).collect(),
    }
}
