use proptest::prelude::*;

use crate::{Label, LabelId, LabelMask, LabelTree, Region};

/// Returns the label tree 1 › 2 › 3, 1 › 4, and 5 on its own.
pub(super) fn tree() -> LabelTree {
    let label = |id: u16, parent: Option<u16>| Label {
        id: LabelId(id),
        name: format!("label {id}"),
        color: LabelTree::color_for(LabelId(id)),
        parent: parent.map(LabelId),
    };
    vec![
        label(1, None),
        label(2, Some(1)),
        label(3, Some(2)),
        label(4, Some(1)),
        label(5, None),
    ]
    .try_into()
    .unwrap()
}

/// Generates a mask of 12 × 10 pixels with the labels of [`tree`], and a region of its size.
pub(super) fn frame() -> impl Strategy<Value = (LabelMask, Region)> {
    let ids = prop::collection::vec((0u16..6).prop_map(LabelId), 120);
    let inside = prop::collection::vec(any::<bool>(), 120);
    (ids, inside).prop_map(|(ids, inside)| {
        (
            LabelMask {
                width: 12,
                height: 10,
                ids,
            },
            Region {
                width: 12,
                height: 10,
                inside,
            },
        )
    })
}
