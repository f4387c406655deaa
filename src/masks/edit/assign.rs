use serde::{Deserialize, Serialize};

use crate::{LabelId, LabelMask, LabelTree, MaskError, Prompt, Region};

/// Effect of painting on pixels of other labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PaintRule {
    /// Other labels keep their pixels, except that a label takes pixels from its ancestors.
    #[default]
    Protect,
    /// Other labels are painted over.
    Replace,
}

/// Gives the pixels of a region to a label and returns how many pixels changed.
///
/// # Errors
/// [`MaskError::Request`] when the region and the mask differ in size.
pub fn assign(
    mask: &mut LabelMask,
    region: &Region,
    label: LabelId,
    rule: PaintRule,
    tree: &LabelTree,
) -> Result<usize, MaskError> {
    region.check_size(mask.width, mask.height)?;
    let yields = yielding(label, &[], tree);
    let may = |at: LabelId| rule == PaintRule::Replace || yields.contains(&at);
    let targets = mask
        .ids
        .iter_mut()
        .zip(&region.inside)
        .filter(|(at, inside)| **inside && **at != label && may(**at));
    Ok(targets.map(|(at, _)| *at = label).count())
}

/// Removes labels from the pixels of a region and returns how many pixels changed.
///
/// Removes only the label `only` when it is given, and all labels otherwise.
///
/// # Errors
/// [`MaskError::Request`] when the region and the mask differ in size.
pub fn erase(
    mask: &mut LabelMask,
    region: &Region,
    only: Option<LabelId>,
) -> Result<usize, MaskError> {
    region.check_size(mask.width, mask.height)?;
    let goes = |at: LabelId| at != LabelId::NONE && only.is_none_or(|only| only == at);
    let targets = mask
        .ids
        .iter_mut()
        .zip(&region.inside)
        .filter(|(at, inside)| **inside && goes(**at));
    Ok(targets.map(|(at, _)| *at = LabelId::NONE).count())
}

/// Returns the ids whose pixels `label` may take.
///
/// These are 0 (unlabelled), the label itself, its ancestors and `replaceable`.
pub(super) fn yielding(label: LabelId, replaceable: &[LabelId], tree: &LabelTree) -> Vec<LabelId> {
    let mut yields = tree.path(label);
    yields.push(LabelId::NONE);
    yields.extend_from_slice(replaceable);
    yields
}

/// A segmenter's answer for a label on a frame.
#[derive(Debug, Clone, Copy)]
pub struct LabelAnswer<'a> {
    /// Pixels of the answer.
    pub region: &'a Region,
    /// Label that the answer is for.
    pub label: LabelId,
    /// Prompt that was answered.
    pub prompt: &'a Prompt,
    /// Other labels whose pixels the answer may take.
    pub replaceable: &'a [LabelId],
}

/// Writes a segmenter's answer into a frame's mask.
///
/// The label's former pixels are cleared and the region is written. Pixels of other labels stay,
/// unless the label is an ancestor of the answer's label (a part takes from its parent) or is named
/// in `replaceable`. The pixel of an include click always gets the label, and the pixel of an exclude
/// click loses it. Where clicks of both kinds share a pixel, the last one counts.
///
/// # Errors
/// [`MaskError::Request`] when the region and the mask differ in size.
pub fn compose(
    mask: &mut LabelMask,
    answer: &LabelAnswer<'_>,
    tree: &LabelTree,
) -> Result<(), MaskError> {
    let LabelAnswer {
        region,
        label,
        prompt,
        replaceable,
    } = *answer;
    region.check_size(mask.width, mask.height)?;
    let yields = yielding(label, replaceable, tree);
    for (at, &inside) in mask.ids.iter_mut().zip(&region.inside) {
        if yields.contains(at) && (inside || *at == label) {
            *at = if inside { label } else { LabelId::NONE };
        }
    }
    for click in &prompt.clicks {
        let Some(pixel) = click.pixel_in(mask.width, mask.height) else {
            continue;
        };
        if click.include {
            mask.ids[pixel] = label;
        } else if mask.ids[pixel] == label {
            mask.ids[pixel] = LabelId::NONE;
        }
    }
    Ok(())
}

/// Returns the pixels that [`compose`] leaves to other labels.
///
/// A segmenter may not take them for `label`.
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

    use super::*;
    use crate::Click;
    use crate::edit::tests::{frame, tree};

    proptest! {
        #[test]
        fn protected_labels_never_change((mask, region) in frame(), id in 1u16..6) {
            let (label, tree) = (LabelId(id), tree());
            let mut painted = mask.clone();
            let changed = assign(&mut painted, &region, label, PaintRule::Protect, &tree).unwrap();
            let mut counted = 0;
            for (at, (&before, &after)) in mask.ids.iter().zip(&painted.ids).enumerate() {
                let free = before == LabelId::NONE || tree.is_ancestor(before, label);
                prop_assert_eq!(after, if region.inside[at] && free { label } else { before });
                counted += usize::from(before != after);
            }
            prop_assert_eq!(changed, counted);
        }

        #[test]
        fn replacing_changes_exactly_the_region((mask, region) in frame(), id in 1u16..6) {
            let mut painted = mask.clone();
            assign(&mut painted, &region, LabelId(id), PaintRule::Replace, &tree()).unwrap();
            for (at, (&before, &after)) in mask.ids.iter().zip(&painted.ids).enumerate() {
                prop_assert_eq!(after, if region.inside[at] { LabelId(id) } else { before });
            }
        }

        #[test]
        fn erasing_removes_one_label_or_all((mask, region) in frame(), id in 1u16..6) {
            let (mut one, mut all) = (mask.clone(), mask.clone());
            erase(&mut one, &region, Some(LabelId(id))).unwrap();
            erase(&mut all, &region, None).unwrap();
            for (at, &before) in mask.ids.iter().enumerate() {
                let gone = region.inside[at];
                prop_assert_eq!(one.ids[at], if gone && before == LabelId(id) { LabelId::NONE } else { before });
                prop_assert_eq!(all.ids[at], if gone { LabelId::NONE } else { before });
            }
        }
    }

    #[test]
    fn region_of_another_size_is_rejected() {
        let mut mask = LabelMask::empty(4, 4);
        assert!(
            assign(
                &mut mask,
                &Region::empty(4, 3),
                LabelId(1),
                PaintRule::Replace,
                &tree()
            )
            .is_err()
        );
        assert!(erase(&mut mask, &Region::empty(2, 8), None).is_err());
    }

    proptest! {
        #[test]
        fn composing_changes_only_the_label_and_replaceable_labels(
            (mask, region) in frame(),
            id in 1u16..6,
            other in 1u16..6,
            click in (-2.0f64..14.0, -2.0f64..12.0, any::<bool>()),
        ) {
            let (label, tree) = (LabelId(id), tree());
            let click = Click { at_px: DVec2::new(click.0, click.1), include: click.2 };
            let prompt = Prompt { clicks: vec![click], ..Prompt::default() };
            let mut composed = mask.clone();
            let replaceable = &[LabelId(other)];
            let answer = LabelAnswer { region: &region, label, prompt: &prompt, replaceable };
            compose(&mut composed, &answer, &tree).unwrap();
            let taken = taken_by_others(&mask, label, &[LabelId(other)], &tree);
            for (at, (&before, &after)) in mask.ids.iter().zip(&composed.ids).enumerate() {
                let concerned = before == LabelId::NONE
                    || before == label
                    || before == LabelId(other)
                    || tree.is_ancestor(before, label);
                prop_assert_eq!(taken.inside[at], !concerned);
                let clicked = click.pixel_in(mask.width, mask.height) == Some(at);
                let is_inside = region.inside[at] && concerned;
                let expected = if clicked && click.include {
                    label
                } else if clicked && is_inside {
                    LabelId::NONE
                } else if is_inside {
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
    fn part_takes_from_its_parent_but_not_the_reverse() {
        let ids = |row: [u16; 4]| row.map(LabelId).to_vec();
        let all = Region {
            width: 4,
            height: 1,
            inside: vec![true; 4],
        };
        let prompt = Prompt::default();
        let whole = |label| LabelAnswer {
            region: &all,
            label,
            prompt: &prompt,
            replaceable: &[],
        };
        let mut mask = LabelMask {
            width: 4,
            height: 1,
            ids: ids([1, 2, 5, 0]),
        };
        compose(&mut mask, &whole(LabelId(2)), &tree()).unwrap();
        assert_eq!(mask.ids, ids([2, 2, 5, 2]));
        compose(&mut mask, &whole(LabelId(1)), &tree()).unwrap();
        assert_eq!(mask.ids, ids([2, 2, 5, 2]));
    }
}
