//! Tests of unreadable frames, backward passes and frames between keyframes.

use proptest::prelude::*;

use super::*;
use ostra_masks::{Region, WalkedFrame, merged};

/// Returns the masks and the warnings.
fn reported(request: &TrackRequest) -> (BTreeMap<usize, TrackedFrame>, Vec<String>) {
    let mut tracked = BTreeMap::new();
    let mut take = |frame: TrackedFrame| {
        tracked.insert(frame.frame, frame);
    };
    let warnings = FlowTracker::default()
        .track(request, &mut take, &Progress::default())
        .unwrap();
    (tracked, warnings)
}

/// Deletes the file of frame `gone` and truncates those of `cut`.
fn damage(video: &Video, gone: usize, cut: &[usize]) {
    let path = |frame: usize| video._folder.path().join(format!("{frame:03}.png"));
    std::fs::remove_file(path(gone)).unwrap();
    for &frame in cut {
        let bytes = std::fs::read(path(frame)).unwrap();
        std::fs::write(path(frame), &bytes[..bytes.len() / 2]).unwrap();
    }
}

#[test]
fn backward_tracks_only_earlier_frames_in_descending_order() {
    let video = Video::new(40, &two_disks(), 0..0);
    let request = TrackRequest {
        direction: Direction::Backward,
        ..video.request(&[37])
    };
    let mut order = Vec::new();
    let mut tracked = BTreeMap::new();
    let mut take = |frame: TrackedFrame| {
        order.push(frame.frame);
        tracked.insert(frame.frame, frame);
    };
    FlowTracker::default()
        .track(&request, &mut take, &Progress::default())
        .unwrap();
    assert_eq!(order, (0..37).rev().collect::<Vec<_>>());
    for (frame, label) in [(0, LEFT), (20, LEFT), (0, RIGHT), (20, RIGHT)] {
        let iou = video.iou(&tracked, frame, label);
        assert!(iou > 0.85, "{label:?} in frame {frame}: {iou}");
    }
}

#[test]
fn unreadable_frames_are_skipped_and_named() {
    for (keyframe, last) in [(0, 19), (19, 0)] {
        let video = Video::new(20, &two_disks(), 0..0);
        damage(&video, 6, &[7, 12]);
        let (tracked, warnings) = reported(&video.request(&[keyframe]));
        let expected: Vec<usize> = (0..20)
            .filter(|frame| ![keyframe, 6, 7, 12].contains(frame))
            .collect();
        assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), expected);
        assert!(video.iou(&tracked, last, LEFT) > 0.85 && video.iou(&tracked, last, RIGHT) > 0.85);
        let [warning] = warnings.as_slice() else {
            panic!("{warnings:?}")
        };
        assert!(
            warning.starts_with("3 frames cannot be read")
                && warning.contains("006.png, 007.png, 012.png")
        );
    }
}

#[test]
fn unreadable_frames_between_keyframes_are_skipped_in_both_passes() {
    let video = Video::new(20, &two_disks(), 0..0);
    for gone in [1, 7, 12, 18] {
        damage(&video, gone, &[]);
    }
    let (tracked, warnings) = reported(&video.request(&[0, 19]));
    let readable: Vec<usize> = (1..19)
        .filter(|frame| ![1, 7, 12, 18].contains(frame))
        .collect();
    assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), readable);
    for frame in [2, 8, 17] {
        assert!(
            video.iou(&tracked, frame, LEFT) > 0.9,
            "frame {frame}: {}",
            video.iou(&tracked, frame, LEFT)
        );
    }
    let [warning] = warnings.as_slice() else {
        panic!("{warnings:?}")
    };
    assert!(warning.starts_with("4 frames cannot be read"), "{warning}");
}

#[test]
fn unreadable_frame_outside_the_range_is_ignored() {
    let video = Video::new(12, &two_disks(), 0..0);
    damage(&video, 7, &[]);
    let request = TrackRequest {
        from: 3,
        to: 6,
        direction: Direction::Forward,
        ..video.request(&[1, 10])
    };
    let (tracked, warnings) = reported(&request);
    assert_eq!(
        (tracked.keys().copied().collect::<Vec<_>>(), warnings),
        (vec![3, 4, 5, 6], vec![])
    );
}

#[test]
fn unreadable_keyframe_is_replaced_by_the_pass_from_the_other_side() {
    let video = Video::new(12, &two_disks(), 0..0);
    damage(&video, 0, &[]);
    let (tracked, warnings) = reported(&video.request(&[0, 11]));
    assert_eq!(
        tracked.keys().copied().collect::<Vec<_>>(),
        (1..11).collect::<Vec<_>>()
    );
    assert!(
        video.iou(&tracked, 1, LEFT) > 0.85 && warnings[0].contains("000.png"),
        "{warnings:?}"
    );
    let alone = video.request(&[0]);
    let refused = FlowTracker::default()
        .track(&alone, &mut |_| {}, &Progress::default())
        .unwrap_err();
    assert!(refused.to_string().contains("000.png"), "{refused}");
}

#[test]
fn mask_area_between_keyframes_is_interpolated() {
    let video = Video::new(21, &two_disks(), 0..0);
    let mut request = video.request(&[0, 20]);
    // The second keyframe shows a larger object than the first.
    let grown = video.truth[20].region(LEFT).dilated(3.0);
    let mask = Arc::make_mut(request.keyframes.get_mut(&20).unwrap());
    mask.ids
        .iter_mut()
        .zip(&grown.inside)
        .filter(|(_, inside)| **inside)
        .for_each(|(id, _)| *id = LEFT);
    let (tracked, _) = reported(&request);
    let area = |frame: usize| tracked[&frame].mask.region(LEFT).area();
    let ends = (video.truth[0].region(LEFT).area(), grown.area());
    for frame in 1..20 {
        assert!(
            (ends.0 * 9 / 10..=ends.1 * 5 / 4).contains(&area(frame)),
            "frame {frame}: {} of {ends:?}",
            area(frame)
        );
        assert!(
            video.iou(&tracked, frame, RIGHT) > 0.85,
            "the other object stays in frame {frame}"
        );
    }
    let mean = |frames: Range<usize>| frames.clone().map(area).sum::<usize>() / frames.len();
    assert!(
        mean(1..8) < mean(7..14) && mean(7..14) < mean(13..20),
        "it grows towards the larger one"
    );
}

/// A disk as the result of one pass.
fn walked(x: f32, y: f32, radius: f32, confidence: f32) -> WalkedFrame {
    let inside = |at: usize| {
        Vec2::new((at % 40) as f32, (at / 40) as f32).distance(Vec2::new(x, y)) < radius
    };
    let ids = (0..40 * 30)
        .map(|at| if inside(at) { LEFT } else { LabelId::NONE })
        .collect();
    WalkedFrame {
        mask: LabelMask {
            width: 40,
            height: 30,
            ids,
        },
        confidence: BTreeMap::from([(LEFT, confidence)]),
    }
}

/// Averaging two distant outlines would give no object at all.
#[test]
fn nearer_of_two_disjoint_masks_is_kept() {
    let (a, b) = (walked(10.0, 15.0, 6.0, 0.8), walked(28.0, 15.0, 6.0, 0.8));
    assert_eq!(merged(&a, &b, 0.7).mask, a.mask);
    assert_eq!(merged(&a, &b, 0.3).mask, b.mask);
}

proptest! {
    /// Pixels in both passes stay, whatever the confidences, and the nearer pass counts more.
    #[test]
    fn merged_mask_lies_between_both_outlines(
        x in 12.0f32..20.0, y in 10.0f32..20.0, shift in 0.0f32..6.0, radius in 4.0f32..9.0, confidence in 0.0f32..1.0,
    ) {
        let (a, b) = (walked(x, y, radius, 0.8), walked(x + shift, y, radius, confidence));
        let region = |walked: &WalkedFrame| -> Region { walked.mask.region(LEFT) };
        let (in_a, in_b) = (region(&a), region(&b));
        for nearness in [0.1, 0.5, 0.9] {
            let met = region(&merged(&a, &b, nearness));
            for at in 0..met.inside.len() {
                prop_assert!(!(in_a.inside[at] && in_b.inside[at]) || met.inside[at]);
                prop_assert!(in_a.inside[at] || in_b.inside[at] || !met.inside[at]);
            }
        }
        let met = |nearness| region(&merged(&a, &b, nearness));
        prop_assert!(met(0.95).iou(&in_a) >= met(0.05).iou(&in_a));
        prop_assert!(met(0.05).iou(&in_b) >= met(0.95).iou(&in_b));
    }
}
