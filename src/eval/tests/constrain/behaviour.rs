//! Emitted masks, errors and warnings of the constrained tracker.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::drift::{Error, UNREADABLE, constrained, lose, outcome, swap};
use super::synthetic::Made;
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

fn swapped(made: &Made) -> Error {
    swap(made.label("leaf 1"), made.label("leaf 2"))
}

#[test]
fn tracking_from_both_sides_meets_and_keeps_keyframes() {
    let made = Made::new(9);
    let result = outcome(
        &made,
        &made.request(&[1, 7], Direction::Both),
        4,
        swapped(&made),
    );
    assert_eq!(
        result.tracked.keys().copied().collect::<Vec<_>>(),
        [0, 2, 3, 4, 5, 6, 8]
    );
    assert_eq!(
        result.answers,
        7 + 5,
        "the frames between were shown after the first walk"
    );
    assert!(result.tracked.values().all(|tracked| !tracked.preliminary));
    assert_eq!(
        result.begun,
        [1, 4, 7, 3, 1],
        "forwards from 1, 4 and 7, backwards from 7, 3 and 1"
    );
    for (&frame, tracked) in &result.tracked {
        for leaf in ["leaf 1", "leaf 2"] {
            let iou = made.iou(&tracked.mask, frame, made.label(leaf));
            assert!(iou > 0.95, "frame {frame}, {leaf}: {iou}");
        }
    }
    assert_eq!(
        result
            .lines
            .iter()
            .filter(|line| line.contains("own warning"))
            .count(),
        2,
        "{:?}",
        result.lines
    );
    assert!(
        result.lines[1].contains("restarted in the tracker on 003, 004"),
        "{:?}",
        result.lines
    );
}

#[test]
fn frames_without_depth_or_camera_are_not_changed() {
    let mut made = Made::new(8);
    made.frames[4].depth = None;
    made.frames[6].camera = None;
    let error = swapped(&made);
    let wrong = [4, 6].map(|frame| error(&made.truth[frame], 1));
    let result = outcome(&made, &made.request(&[0], Direction::Forward), 4, error);
    assert_eq!(result.tracked[&4].mask, wrong[0]);
    assert_eq!(result.begun, [0, 5], "the frame behind shows it");
    assert_eq!(result.tracked[&6].mask, made.truth[6]);
    assert!(
        result
            .lines
            .iter()
            .any(|line| line.contains("2 frames were not compared") && line.contains("004, 006"))
    );
}

#[test]
fn unreadable_keyframe_is_reported_and_others_are_used() {
    let made = Made::new(8);
    std::fs::write(
        made.frames[7]
            .depth
            .as_ref()
            .unwrap()
            .sensor_path()
            .unwrap(),
        "",
    )
    .unwrap();
    let result = outcome(
        &made,
        &made.request(&[0, 7], Direction::Both),
        4,
        swapped(&made),
    );
    assert!(
        result.lines[0].starts_with("geometry corrected"),
        "{:?}",
        result.lines
    );
    let unread: Vec<&String> = result
        .lines
        .iter()
        .filter(|line| line.contains("cannot be read"))
        .collect();
    assert!(
        unread.len() == 1 && unread[0].ends_with(": 007"),
        "{:?}",
        result.lines
    );
}

#[test]
fn frames_without_a_mask_are_reported() {
    let mut made = Made::new(8);
    made.frames[2].name = UNREADABLE.into();
    let result = outcome(
        &made,
        &made.request(&[0], Direction::Forward),
        4,
        swapped(&made),
    );
    assert_eq!(
        result.tracked.keys().copied().collect::<Vec<_>>(),
        [1, 3, 4, 5, 6, 7]
    );
    assert_eq!(result.begun, [0, 4]);
    assert!(
        result
            .lines
            .iter()
            .any(|line| line.ends_with("no mask for unreadable")),
        "{:?}",
        result.lines
    );
}

#[test]
fn untracked_labels_are_ignored() {
    let made = Made::new(6);
    let (lost, leaf) = (made.label("leaf 3"), made.label("leaf 2"));
    let request = TrackRequest {
        labels: Some(BTreeSet::from([leaf])),
        ..made.request(&[0], Direction::Forward)
    };
    let result = outcome(&made, &request, 2, lose(lost));
    assert!(
        result
            .tracked
            .values()
            .all(|tracked| !tracked.mask.ids.contains(&lost) || tracked.frame < 2)
    );
    assert_eq!(result.begun, [0]);
    assert!(
        result.lines[0].contains("agrees with the masks"),
        "{:?}",
        result.lines
    );
}

#[test]
fn labels_missing_on_a_keyframe_are_not_removed_elsewhere() {
    let made = Made::new(6);
    let leaf = made.label("leaf 2");
    let mut request = made.request(&[0], Direction::Forward);
    let ids = made.truth[0]
        .ids
        .iter()
        .map(|&id| if id == leaf { id } else { LabelId::NONE });
    let only = LabelMask {
        ids: ids.collect(),
        ..made.truth[0]
    };
    request.keyframes.insert(0, Arc::new(only));
    let result = outcome(&made, &request, 99, lose(leaf));
    assert!(
        result
            .tracked
            .iter()
            .all(|(&frame, tracked)| tracked.mask == made.truth[frame]),
        "{:?}",
        result.lines
    );
}

#[test]
fn missing_depth_or_cameras_give_an_error_with_advice() {
    let mut made = Made::new(3);
    let refused = |made: &Made| {
        let (tracker, _) = constrained(made, 99, swapped(made));
        let request = made.request(&[0], Direction::Both);
        tracker
            .track(&request, &mut |_| {}, &Progress::default())
            .unwrap_err()
            .to_string()
    };
    let depth = made.frames[0].depth.take();
    assert!(refused(&made).contains("a frame with a mask has depth and a camera; give them"));
    made.frames[0].depth = depth;
    made.frames[1..]
        .iter_mut()
        .for_each(|frame| frame.camera = None);
    assert!(refused(&made).contains("no frame from 0 to 2 other than the keyframes"));
}

#[test]
fn stopping_keeps_the_masks_emitted_so_far() {
    let made = Made::new(6);
    let (tracker, _) = constrained(&made, 3, swapped(&made));
    let progress = Progress::default();
    let mut answers = 0;
    let mut take = |tracked: TrackedFrame| {
        answers += 1;
        if tracked.frame == 3 {
            progress.stop();
        }
    };
    let ended = tracker.track(
        &made.request(&[0], Direction::Forward),
        &mut take,
        &progress,
    );
    assert!(matches!(ended, Err(MaskError::Stopped(_))));
    assert_eq!(answers, 3);
}

#[test]
fn result_does_not_depend_on_the_number_of_threads() {
    let made = Made::new(7);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let request = made.request(&[0, 6], Direction::Both);
        let result = pool.install(|| outcome(&made, &request, 3, swapped(&made)));
        let frames = result
            .tracked
            .into_values()
            .map(|tracked| (tracked.frame, tracked.mask, tracked.confidence));
        (frames.collect::<Vec<_>>(), result.lines)
    };
    assert_eq!(run(1), run(3));
}
