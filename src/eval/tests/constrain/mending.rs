//! Swapped, drifted and lost labels are corrected; moving objects are not changed.

use super::drift::{Error, drift, lose, outcome, swap};
use super::synthetic::{BALL, Made};
use ostra_masks::{Direction, LabelId};

/// The frame at which the trackers go wrong.
const WRONG_AT: usize = 4;

/// Returns the minimum and mean IoU from `WRONG_AT` on, before and after the correction.
///
/// It asserts that the tracker restarted once, at that frame.
fn corrected(made: &Made, labels: &[LabelId], error: Error, again: &Error) -> [[f64; 2]; 2] {
    let request = made.request(&[0], Direction::Both);
    let result = outcome(made, &request, WRONG_AT, error);
    println!("{:?}", result.lines);
    let frames = || {
        (WRONG_AT..made.frames.len())
            .flat_map(|frame| labels.iter().map(move |&label| (frame, label)))
    };
    let before = frames().map(|(frame, label)| {
        made.iou(
            &again(&made.truth[frame], 1 + frame - WRONG_AT),
            frame,
            label,
        )
    });
    let after = frames().map(|(frame, label)| made.iou(&result.tracked[&frame].mask, frame, label));
    let summary = |ious: Vec<f64>| {
        [
            ious.iter().copied().fold(1.0, f64::min),
            ious.iter().sum::<f64>() / ious.len() as f64,
        ]
    };
    let (before, after) = (summary(before.collect()), summary(after.collect()));
    println!("IoU least and mean before {before:.3?}, after {after:.3?}");
    assert_eq!(
        result.begun,
        [0, WRONG_AT],
        "it began again where it went wrong, and went well from there"
    );
    [before, after]
}

#[test]
fn swapped_leaves_are_corrected() {
    let made = Made::new(10);
    let (a, b) = (made.label("leaf 1"), made.label("leaf 2"));
    let [before, after] = corrected(&made, &[a, b], swap(a, b), &swap(a, b));
    assert!(before[1] < 0.01 && after[0] > 0.95, "{before:?} {after:?}");
}

#[test]
fn drifting_leaf_is_corrected() {
    let made = Made::new(10);
    let leaf = made.label("leaf 2");
    let [before, after] = corrected(&made, &[leaf], drift(leaf, 12), &drift(leaf, 12));
    assert!(before[1] < 0.3 && after[0] > 0.8, "{before:?} {after:?}");
}

#[test]
fn lost_leaf_is_restored() {
    let made = Made::new(10);
    let leaf = made.label("leaf 3");
    let [before, after] = corrected(&made, &[leaf], lose(leaf), &lose(leaf));
    assert!(before[1] < 0.01 && after[0] > 0.85, "{before:?} {after:?}");
}

#[test]
fn moving_object_is_left_to_the_tracker() {
    let made = Made::with_ball(8, |k| {
        Some([60.0 + 20.0 * k as f32, 120.0 + 10.0 * k as f32])
    });
    let request = made.request(&[0], Direction::Forward);
    let leaf = made.label("leaf 2");
    let right = outcome(&made, &request, 99, lose(leaf));
    assert!(
        right
            .tracked
            .iter()
            .all(|(&frame, tracked)| tracked.mask == made.truth[frame]),
        "{:?}",
        right.lines
    );
    assert!(
        right.lines[0].contains("agrees with the masks of all 7 compared frames"),
        "{:?}",
        right.lines
    );
    // Static labels are corrected all the same.
    let wrong = outcome(&made, &request, 3, lose(leaf));
    for (&frame, tracked) in &wrong.tracked {
        assert_eq!(made.iou(&tracked.mask, frame, BALL), 1.0, "frame {frame}");
        assert!(
            made.iou(&tracked.mask, frame, leaf) > 0.85,
            "frame {frame}: {}",
            made.iou(&tracked.mask, frame, leaf)
        );
    }
}
