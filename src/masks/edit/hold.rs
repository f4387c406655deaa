use std::collections::BTreeSet;

use crate::runs::merged;
use crate::{LabelId, MaskError, RunMask};

/// `after`, in which `held` labels have exactly the pixels that they have in `before`; where `after` gives them others,
/// nothing is.
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

    use super::super::tests::frame;
    use super::*;
    use crate::LabelMask;

    proptest! {
        #[test]
        fn held_labels_stay_and_the_others_move(
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
    fn masks_of_two_sizes_are_refused() {
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
