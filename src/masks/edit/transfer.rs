use std::collections::BTreeSet;

use crate::run_mask::merged;
use crate::{LabelId, MaskError, RunMask};

/// Returns `mask` with the pixels that `labels` have in `source`.
///
/// The labels' former pixels are cleared. Their new pixels are set where `mask` is unlabelled or
/// has one of `labels`, and with `replace` also over other labels. All other pixels stay as they
/// are.
///
/// # Errors
/// [`MaskError::Request`] when the two masks differ in size.
pub fn transfer(
    mask: &RunMask,
    source: &RunMask,
    labels: &BTreeSet<LabelId>,
    replace: bool,
) -> Result<RunMask, MaskError> {
    mask.check_same_size(source)?;
    let moved = |(at, found, length): (LabelId, LabelId, u32)| {
        let free = at == LabelId::NONE || labels.contains(&at);
        let id = match (labels.contains(&found), free) {
            (true, _) if free || replace => found,
            (_, true) => LabelId::NONE,
            (_, false) => at,
        };
        (id, length)
    };
    Ok(RunMask {
        width: mask.width,
        height: mask.height,
        runs: merged(mask.joint_runs(source).map(moved)),
    })
}

/// Returns `after` with the pixels of the `held` labels as they are in `before`.
///
/// Pixels that have a held label only in `after` become unlabelled.
///
/// # Errors
/// [`MaskError::Request`] when the two masks differ in size.
pub fn hold(
    before: &RunMask,
    after: &RunMask,
    held: &BTreeSet<LabelId>,
) -> Result<RunMask, MaskError> {
    before.check_same_size(after)?;
    let kept = |(before, after, length): (LabelId, LabelId, u32)| {
        let id = match (held.contains(&before), held.contains(&after)) {
            (true, _) => before,
            (false, true) => LabelId::NONE,
            (false, false) => after,
        };
        (id, length)
    };
    Ok(RunMask {
        width: after.width,
        height: after.height,
        runs: merged(before.joint_runs(after).map(kept)),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::LabelMask;
    use crate::edit::tests::frame;

    proptest! {
        #[test]
        fn transfer_moves_only_the_chosen_labels(
            (mask, region) in frame(),
            shift in 0usize..40,
            labels in proptest::collection::btree_set((1u16..6).prop_map(LabelId), 0..3),
            replace: bool,
        ) {
            let mut source = LabelMask { width: region.width, height: region.height, ids: mask.ids.clone() };
            source.ids.rotate_left(shift % mask.ids.len());
            let moved = transfer(&RunMask::encode(&mask), &RunMask::encode(&source), &labels, replace).unwrap();
            prop_assert!(moved.runs.windows(2).all(|pair| pair[0].0 != pair[1].0));
            for ((&before, &found), after) in mask.ids.iter().zip(&source.ids).zip(moved.decode().ids) {
                let other = before != LabelId::NONE && !labels.contains(&before);
                let expected = match (labels.contains(&found), other) {
                    (true, true) if !replace => before,
                    (true, _) => found,
                    (false, true) => before,
                    (false, false) => LabelId::NONE,
                };
                prop_assert_eq!(after, expected);
            }
        }
    }

    #[test]
    fn transfer_rejects_masks_of_different_sizes() {
        assert!(
            transfer(
                &RunMask::empty(4, 3),
                &RunMask::empty(3, 4),
                &BTreeSet::new(),
                false
            )
            .is_err()
        );
    }

    proptest! {
        #[test]
        fn held_labels_stay_and_other_labels_change(
            (before, _) in frame(),
            (after, _) in frame(),
            held in proptest::collection::btree_set((1u16..6).prop_map(LabelId), 0..3),
        ) {
            let done = hold(&RunMask::encode(&before), &RunMask::encode(&after), &held).unwrap();
            prop_assert!(done.runs.windows(2).all(|pair| pair[0].0 != pair[1].0));
            let LabelMask { ids, .. } = done.decode();
            for label in (1..6).map(LabelId) {
                if held.contains(&label) {
                    prop_assert!(before.ids.iter().zip(&ids).all(|(a, b)| (*a == label) == (*b == label)));
                }
            }
            for ((before, after), id) in before.ids.iter().zip(&after.ids).zip(&ids) {
                if !held.contains(before) && !held.contains(after) {
                    prop_assert_eq!(id, after);
                }
            }
        }
    }

    #[test]
    fn hold_rejects_masks_of_different_sizes() {
        assert!(
            hold(
                &RunMask::empty(4, 3),
                &RunMask::empty(3, 4),
                &BTreeSet::new()
            )
            .is_err()
        );
    }
}
