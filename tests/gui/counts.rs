//! Tests of the counts of confirmed frames and of frames to check.

use std::collections::BTreeMap;

use egui::{Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_cloud::conflicts::FrameConflict;

use crate::desk::{Desk, press};

#[test]
fn frames_to_check_are_counted_and_a_click_goes_to_the_next_one() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("1 of 12 frames confirmed ·");
    for expected in [2, 5, 2] {
        harness.get_by_label("2 to check").click();
        harness.run_steps(3);
        assert_eq!(harness.state().shell.view.frame, expected);
    }
    let percentage = harness.query_by_label_contains("mean tracker");
    assert!(
        percentage.is_none(),
        "it would praise masks that are not checked"
    );
}

#[test]
fn tooltip_says_why_this_frame_and_the_next_are_to_be_checked() {
    let mut desk = Desk::sample();
    let conflict = FrameConflict {
        compared: 100,
        against: 40,
    };
    desk.conflicts = BTreeMap::from([(1, conflict)]);
    let mut harness = desk.shown();
    harness.state_mut().shell.view.go_to(1);
    harness.run_steps(2);
    harness.get_by_label("3 to check").hover();
    harness.run_steps(8);
    harness.get_by_label("This frame: 40 % in conflict with the 3-D vote");
    harness.get_by_label("Frame 2: stale: made from inputs that changed since");
    harness.get_by_label_contains("(D)");
}

#[test]
fn nothing_to_check_is_said_with_a_reason() {
    let mut harness = Desk::sample().shown();
    let masks = &mut harness.state_mut().project.masks;
    masks.remove(&2);
    masks.remove(&5);
    harness.run_steps(3);
    let node = harness.get_by_label("0 to check");
    assert!(node.accesskit_node().is_disabled());
    node.hover();
    harness.run_steps(8);
    harness.get_by_label_contains("No tracked mask is stale");
    press(&mut harness, Modifiers::NONE, Key::D);
    assert_eq!(harness.state().shell.view.frame, 0);
}

#[test]
fn limit_of_confidence_decides_which_frames_are_to_be_checked() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.prefs.flag_below = 0.1;
    harness.run_steps(2);
    harness.get_by_label("1 to check");
    harness.state_mut().shell.view.prefs.flag_below = 0.95;
    harness.run_steps(2);
    harness.get_by_label("3 to check");
}
