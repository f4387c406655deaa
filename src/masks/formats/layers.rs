use std::ops::Range;

use super::frame_matching::MaskFrame;
use crate::{LabelId, LabelMask, LabelTree, MaskError, RunMask};

/// Overlapping objects of a frame merged into one mask.
pub(super) struct Stacked {
    pub mask: RunMask,
    /// Pixels claimed by two labels of which neither is an ancestor of the other.
    pub contested: usize,
}

/// Merges objects of one frame that may overlap.
///
/// The deepest label of the tree wins; among equally deep ones, the later one wins. `draw` emits
/// the ranges of an object's pixels, as indices row by row.
pub(super) fn stacked<L>(
    frame: &MaskFrame<'_>,
    mut layers: Vec<(LabelId, L)>,
    tree: &LabelTree,
    draw: impl Fn(&L, &mut dyn FnMut(Range<usize>)) -> Result<(), MaskError>,
) -> Result<Stacked, MaskError> {
    layers.sort_by_key(|(id, _)| tree.depth(*id));
    let mut mask = LabelMask::empty(frame.width, frame.height);
    let mut contested = 0;
    for (id, layer) in &layers {
        let yields = tree.path(*id);
        draw(layer, &mut |pixels| {
            for at in &mut mask.ids[pixels] {
                contested += usize::from(*at != LabelId::NONE && !yields.contains(at));
                *at = *id;
            }
        })?;
    }
    Ok(Stacked {
        mask: RunMask::encode(&mask),
        contested,
    })
}

/// Returns the warning about pixels that two labels claimed.
pub(super) fn contested_warning(contested: usize) -> Option<String> {
    let what = "pixels are claimed by two labels; each went to the deeper label, else to the one listed later";
    (contested > 0).then(|| format!("{contested} {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Label;

    #[test]
    fn parts_win_over_their_ancestors() {
        let label = |id: u16, parent: Option<u16>| Label {
            id: LabelId(id),
            name: id.to_string(),
            color: [0; 3],
            parent: parent.map(LabelId),
        };
        let tree: LabelTree = vec![label(1, None), label(2, Some(1)), label(3, None)]
            .try_into()
            .unwrap();
        let layers = vec![(LabelId(2), 0..2), (LabelId(1), 0..3), (LabelId(3), 2..4)];
        let draw = |pixels: &Range<usize>, emit: &mut dyn FnMut(Range<usize>)| {
            emit(pixels.clone());
            Ok(())
        };
        let frame = MaskFrame {
            name: "a.jpg",
            width: 4,
            height: 1,
        };
        let Stacked { mask, contested } = stacked(&frame, layers, &tree, draw).unwrap();
        assert_eq!(mask.decode().ids, [2, 2, 3, 3].map(LabelId));
        assert_eq!(contested, 1, "only label 3 over label 1");
    }
}
