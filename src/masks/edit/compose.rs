use super::assign::yielding;
use crate::{LabelId, LabelMask, LabelTree, MaskError, Prompt, Region};

/// Puts a segmenter's answer for `label` into a frame's mask: the label's former pixels are cleared, the region is
/// written. Pixels of other labels stay, unless these are ancestors of the label (a part takes from its parent) or named
/// in `replaceable`. The pixel of an include click becomes the label whatever was there.
///
/// # Errors
/// [`MaskError::Request`] when the region has another size than the mask.
pub fn compose(
    mask: &mut LabelMask,
    region: &Region,
    label: LabelId,
    prompt: &Prompt,
    replaceable: &[LabelId],
    tree: &LabelTree,
) -> Result<(), MaskError> {
    region.check_size(mask.width, mask.height)?;
    let yields = yielding(label, replaceable, tree);
    for (at, &inside) in mask.ids.iter_mut().zip(&region.inside) {
        if yields.contains(at) && (inside || *at == label) {
            *at = if inside { label } else { LabelId::NONE };
        }
    }
    for pixel in prompt
        .clicks
        .iter()
        .filter(|click| click.include)
        .filter_map(|click| click.pixel_in(mask.width, mask.height))
    {
        mask.ids[pixel] = label;
    }
    Ok(())
}

/// The pixels that [`compose`] would keep from `label` because other labels hold them: what a segmenter is told is
/// taken.
#[must_use]
pub fn taken_by_others(
    mask: &LabelMask,
    label: LabelId,
    replaceable: &[LabelId],
    tree: &LabelTree,
) -> Region {
    let yields = yielding(label, replaceable, tree);
    let inside = mask.ids.iter().map(|at| !yields.contains(at)).collect();
    Region {
        width: mask.width,
        height: mask.height,
        inside,
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec2;
    use proptest::prelude::*;

    use super::super::tests::{frame, tree};
    use super::*;
    use crate::Click;

    proptest! {
        #[test]
        fn only_the_label_and_what_yields_changes(
            (mask, region) in frame(),
            id in 1u16..6,
            other in 1u16..6,
            click in (-2.0f64..14.0, -2.0f64..12.0, any::<bool>()),
        ) {
            let (label, tree) = (LabelId(id), tree());
            let click = Click { at_px: DVec2::new(click.0, click.1), include: click.2 };
            let prompt = Prompt { clicks: vec![click], ..Prompt::default() };
            let mut composed = mask.clone();
            compose(&mut composed, &region, label, &prompt, &[LabelId(other)], &tree).unwrap();
            let taken = taken_by_others(&mask, label, &[LabelId(other)], &tree);
            for (at, (&before, &after)) in mask.ids.iter().zip(&composed.ids).enumerate() {
                let concerned = before == LabelId::NONE
                    || before == label
                    || before == LabelId(other)
                    || tree.is_ancestor(before, label);
                prop_assert_eq!(taken.inside[at], !concerned);
                let clicked = click.include && click.pixel_in(mask.width, mask.height) == Some(at);
                let expected = if clicked || (region.inside[at] && concerned) {
                    label
                } else if before == label {
                    LabelId::NONE
                } else {
                    before
                };
                prop_assert_eq!(after, expected);
            }
        }
    }

    #[test]
    fn a_part_takes_from_its_parent_and_not_the_other_way() {
        let ids = |row: [u16; 4]| row.map(LabelId).to_vec();
        let all = Region {
            width: 4,
            height: 1,
            inside: vec![true; 4],
        };
        let mut mask = LabelMask {
            width: 4,
            height: 1,
            ids: ids([1, 2, 5, 0]),
        };
        compose(
            &mut mask,
            &all,
            LabelId(2),
            &Prompt::default(),
            &[],
            &tree(),
        )
        .unwrap();
        assert_eq!(mask.ids, ids([2, 2, 5, 2]));
        compose(
            &mut mask,
            &all,
            LabelId(1),
            &Prompt::default(),
            &[],
            &tree(),
        )
        .unwrap();
        assert_eq!(mask.ids, ids([2, 2, 5, 2]));
    }
}
