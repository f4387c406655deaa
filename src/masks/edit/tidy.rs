use super::assign::{PaintRule, assign, erase, yielding};
use crate::{LabelId, LabelMask, LabelTree, MaskError, Region};

/// Fills small holes of a label, removes its small islands and returns the changed pixels.
///
/// Holes have fewer than `holes_below_px` pixels and islands fewer than `islands_below_px` pixels;
/// 0 disables either step. A hole is enclosed by the label. Its pixels that belong to other labels
/// stay, except those of the label's own ancestors. The label's parts count as the label when
/// components are determined, and keep their pixels. Components are 8-connected, and their size
/// includes filled holes. The largest component is never an island. A second call with the same
/// arguments changes nothing.
///
/// # Errors
/// [`MaskError::Label`] when no pixel of the mask has the label.
pub fn tidy(
    mask: &mut LabelMask,
    label: LabelId,
    holes_below_px: usize,
    islands_below_px: usize,
    tree: &LabelTree,
) -> Result<usize, MaskError> {
    if !mask.ids.contains(&label) {
        return Err(MaskError::Label(
            "the label is not on this frame; choose another frame or label".into(),
        ));
    }
    let mut filled = filled(mask, label, holes_below_px, tree);
    let islands = islands(&filled, islands_below_px);
    filled.subtract(&islands);
    let removed = erase(mask, &islands, Some(label))?;
    Ok(removed + assign(mask, &filled, label, PaintRule::Protect, tree)?)
}

/// Returns the pixels of a label and its parts, with small holes filled.
///
/// Only hole pixels that the label may take are added. Pixels in a hole that other labels cut off
/// from the label stay as they are.
fn filled(mask: &LabelMask, label: LabelId, below_px: usize, tree: &LabelTree) -> Region {
    let mut filled = mask.region_with_parts(label, tree);
    let Some(most) = below_px.checked_sub(1) else {
        return filled;
    };
    let mut closed = filled.clone();
    closed.fill_holes(most);
    let yields = yielding(label, &[], tree);
    let own = filled.clone();
    for ((inside, closed), id) in filled.inside.iter_mut().zip(&closed.inside).zip(&mask.ids) {
        *inside |= *closed && yields.contains(id);
    }
    filled.keep_touching(&own);
    filled
}

/// Returns the components below a size, except the largest component.
fn islands(region: &Region, below_px: usize) -> Region {
    let (mut islands, mut large, mut largest) = (region.clone(), region.clone(), region.clone());
    large.remove_islands(below_px);
    largest.keep_largest();
    islands.subtract(&large);
    islands.subtract(&largest);
    islands
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::{frame, tree};
    use super::*;
    use crate::components::{Connectivity, components};

    proptest! {
        #[test]
        fn only_small_holes_and_islands_change(
            (mask, _) in frame(), id in 1u16..6, holes in 0usize..12, islands in 0usize..12,
        ) {
            let (label, tree) = (LabelId(id), tree());
            prop_assume!(mask.ids.contains(&label));
            let mut tidied = mask.clone();
            let changed = tidy(&mut tidied, label, holes, islands, &tree).unwrap();
            let before = mask.region_with_parts(label, &tree);
            let mut filled = before.clone();
            filled.fill_holes(holes.max(1) - 1);
            let free = |id: LabelId| id == LabelId::NONE || tree.is_ancestor(id, label);
            for (at, inside) in filled.inside.iter_mut().enumerate() {
                *inside &= before.inside[at] || free(mask.ids[at]);
            }
            filled.keep_touching(&before);
            let mut largest = filled.clone();
            largest.keep_largest();
            let mut counted = 0;
            for (at, (&old, &new)) in mask.ids.iter().zip(&tidied.ids).enumerate() {
                counted += usize::from(old != new);
                if old != new && new == label {
                    prop_assert!(filled.inside[at] && free(old));
                } else if old != new {
                    prop_assert!(old == label && new == LabelId::NONE && !largest.inside[at]);
                }
            }
            prop_assert_eq!(changed, counted);
            let whole = tidied.region_with_parts(label, &tree);
            let pieces = components(&whole, Connectivity::Eight);
            let most = pieces.areas.iter().copied().max().unwrap_or(0);
            for (&piece, &id) in pieces.labels.iter().zip(&tidied.ids).filter(|(_, id)| **id == label) {
                let area = pieces.areas[piece as usize - 1];
                prop_assert!(area >= islands || area == most, "a piece of {} pixels of {:?}", area, id);
            }
            if tidied.ids.contains(&label) {
                let again = tidied.clone();
                tidy(&mut tidied, label, holes, islands, &tree).unwrap();
                prop_assert_eq!(tidied, again);
            }
        }
    }

    #[test]
    fn pinhole_is_filled_and_speck_is_removed() {
        let rows = [
            "#####....",
            "#.#.#..#.",
            "#####....",
            ".....2...",
            ".........",
        ];
        let id = |byte: u8| match byte {
            b'#' => LabelId(5),
            b'2' => LabelId(2),
            _ => LabelId::NONE,
        };
        let ids = rows.iter().flat_map(|row| row.bytes().map(id)).collect();
        let mut mask = LabelMask {
            width: 9,
            height: 5,
            ids,
        };
        let mut plain = mask.clone();
        assert_eq!(tidy(&mut plain, LabelId(5), 0, 0, &tree()).unwrap(), 0);
        assert_eq!(tidy(&mut mask, LabelId(5), 2, 2, &tree()).unwrap(), 3);
        assert_eq!(
            (mask.at(1, 1), mask.at(7, 1), mask.at(5, 3)),
            (LabelId(5), LabelId::NONE, LabelId(2))
        );
        assert!(tidy(&mut mask, LabelId(4), 2, 2, &tree()).is_err());
    }

    #[test]
    fn hole_pixels_of_another_label_do_not_count_as_island_size() {
        let rows = ["####..###", "####..#2#", "####..###"];
        let id = |byte: u8| match byte {
            b'#' => LabelId(5),
            b'2' => LabelId(2),
            _ => LabelId::NONE,
        };
        let ids = rows.iter().flat_map(|row| row.bytes().map(id)).collect();
        let mut mask = LabelMask {
            width: 9,
            height: 3,
            ids,
        };
        assert_eq!(tidy(&mut mask, LabelId(5), 2, 8, &tree()).unwrap(), 0);
        assert_eq!(tidy(&mut mask, LabelId(5), 2, 9, &tree()).unwrap(), 8);
        assert_eq!((mask.at(6, 0), mask.at(7, 1)), (LabelId::NONE, LabelId(2)));
    }

    #[test]
    fn unlabelled_pixels_enclosed_by_another_label_stay() {
        // A ring of the label around a ring of another label around unlabelled pixels.
        let id = |x: i32, y: i32| match (x - 6).abs().max((y - 6).abs()) {
            5 => LabelId(5),
            4 => LabelId(2),
            _ => LabelId::NONE,
        };
        let ids = (0..13)
            .flat_map(|y| (0..13).map(move |x| id(x, y)))
            .collect();
        let mut mask = LabelMask {
            width: 13,
            height: 13,
            ids,
        };
        let before = mask.clone();
        assert_eq!(tidy(&mut mask, LabelId(5), 82, 41, &tree()).unwrap(), 0);
        assert_eq!(mask, before);
    }
}
