//! Tests of the grid of labels and frames, the heat strip, and changes over a range.

use egui::{Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ostra_app::Dialog;
use ostra_frames::FrameSet;
use ostra_masks::{Label, LabelId, LabelTree};
use ostra_project::Marks;
use ostra_session::{Command, RangeChange, RangeRequest};

use crate::desk::{Desk, click_at, drag, on_screen, press};

const LEAF: LabelId = LabelId(2);
const SHIFT: Modifiers = Modifiers::SHIFT;
const NONE: Modifiers = Modifiers::NONE;

/// Returns the middle of a frame's cell in the row of a label.
fn cell(harness: &Harness<'_, Desk>, label: &str, frame: usize) -> Pos2 {
    let rect = harness.get_by_label(&format!("Timeline of {label}")).rect();
    let (left, width) = (rect.left() + 120.0, (rect.width() - 120.0) / 12.0);
    Pos2::new(left + (frame as f32 + 0.5) * width, rect.center().y)
}

fn requested(harness: &Harness<'_, Desk>) -> RangeRequest {
    match harness.state().requested.last() {
        Some(Command::Range(request)) => request.clone(),
        other => panic!("{other:?}"),
    }
}

fn with_leaf() -> Harness<'static, Desk> {
    let mut harness = Desk::sample().shown();
    press(&mut harness, NONE, Key::Num2);
    harness
}

#[test]
fn button_deletes_the_label_in_the_dragged_range() {
    let mut harness = Desk::sample().shown();
    let (from, to) = (cell(&harness, "leaf", 7), cell(&harness, "leaf", 3));
    drag(&mut harness, from, to, PointerButton::Primary);
    let view = &harness.state().shell.view;
    assert_eq!((view.label, view.range), (Some(LEAF), Some((3, 7))));
    harness.get_by_label("Delete label in range").click();
    harness.run_steps(2);
    let request = requested(&harness);
    assert_eq!(
        (request.labels, request.from, request.to),
        (vec![LEAF], 3, 7)
    );
    assert_eq!(request.change, RangeChange::Delete);
}

#[test]
fn click_goes_to_label_and_frame_and_drops_the_range() {
    let mut harness = with_leaf();
    harness.state_mut().shell.view.range = Some((2, 4));
    let at = cell(&harness, "pot", 5);
    click_at(&mut harness, at, PointerButton::Primary);
    let view = &harness.state().shell.view;
    assert_eq!(
        (view.label, view.frame, view.range),
        (Some(LabelId(3)), 5, None)
    );
}

#[test]
fn range_is_set_and_changed_by_keys_alone() {
    let mut harness = with_leaf();
    press(&mut harness, NONE, Key::ArrowRight);
    press(&mut harness, NONE, Key::I);
    press(&mut harness, NONE, Key::ArrowRight);
    press(&mut harness, NONE, Key::ArrowRight);
    press(&mut harness, SHIFT, Key::I);
    assert_eq!(harness.state().shell.view.range, Some((1, 3)));
    for (key, change) in [(Key::K, RangeChange::Lock), (Key::H, RangeChange::Hide)] {
        press(&mut harness, NONE, key);
        let request = requested(&harness);
        assert_eq!((request.from, request.to, request.change), (1, 3, change));
    }
    let output = FrameSet::from(vec![(0, 5)]);
    harness.state_mut().project.marks.insert(
        LEAF,
        Marks {
            locked: output.clone(),
            hidden: output,
            ..Marks::default()
        },
    );
    for (key, change) in [(Key::K, RangeChange::Unlock), (Key::H, RangeChange::Show)] {
        press(&mut harness, NONE, key);
        assert_eq!(
            requested(&harness).change,
            change,
            "a second time takes it back"
        );
    }
}

#[test]
fn keys_delete_a_label_before_or_from_this_frame() {
    let mut harness = with_leaf();
    harness.state_mut().shell.view.go_to(5);
    press(&mut harness, NONE, Key::Comma);
    let request = requested(&harness);
    assert_eq!(
        (request.from, request.to, request.change),
        (1, 4, RangeChange::Delete),
        "frame 0 is a keyframe with it"
    );
    press(&mut harness, NONE, Key::Period);
    let request = requested(&harness);
    assert_eq!(
        (request.from, request.to, request.change),
        (5, 11, RangeChange::Delete)
    );
}

#[test]
fn merge_asks_for_the_other_label_and_a_key_chooses_it() {
    let mut harness = with_leaf();
    press(&mut harness, NONE, Key::J);
    assert!(matches!(
        harness.state().shell.view.dialog,
        Some(Dialog::Into(_))
    ));
    press(&mut harness, NONE, Key::Num3);
    assert_eq!(
        requested(&harness).change,
        RangeChange::Merge { into: LabelId(3) }
    );
    assert_eq!(harness.state().shell.view.dialog, None);
    assert_eq!(
        harness.state().shell.view.label,
        Some(LEAF),
        "the key did not choose another label"
    );
}

#[test]
fn fragment_under_the_pointer_is_split_off() {
    let mut harness = with_leaf();
    let at = on_screen(&harness, 30.0, 20.0);
    harness.hover_at(at);
    harness.run_steps(2);
    press(&mut harness, SHIFT, Key::J);
    harness.get_by_label("Give to pot").click();
    harness.run_steps(2);
    let RangeChange::Split {
        frame: 0,
        at_px,
        into: LabelId(3),
    } = requested(&harness).change
    else {
        panic!()
    };
    assert!(
        at_px.distance(glam::DVec2::new(30.0, 20.0)) < 1.0,
        "{at_px}"
    );
}

#[test]
fn mask_is_copied_from_frame_to_frame() {
    let mut harness = with_leaf();
    press(&mut harness, SHIFT, Key::C);
    press(&mut harness, NONE, Key::End);
    press(&mut harness, SHIFT, Key::V);
    let request = requested(&harness);
    assert_eq!(
        (request.from, request.to, request.change),
        (11, 11, RangeChange::Copy { frame: 0 })
    );
}

#[test]
fn click_on_the_heat_strip_goes_to_its_frame() {
    let mut harness = Desk::sample().shown();
    let strip = harness.get_by_label("Confidence over frames").rect();
    let at = strip.left_center() + Vec2::new(strip.width() * 5.5 / 12.0, 0.0);
    click_at(&mut harness, at, PointerButton::Primary);
    assert_eq!(harness.state().shell.view.frame, 5);
}

#[test]
fn frame_where_a_label_is_lost_is_a_frame_to_check() {
    let mut harness = with_leaf();
    let project = &mut harness.state_mut().project;
    let seen = project.masks[&1].clone();
    let empty = ostra_project::FrameMask {
        runs: std::sync::Arc::new(ostra_masks::RunMask::empty(
            seen.runs.width,
            seen.runs.height,
        )),
        confidence: Default::default(),
        ..seen.clone()
    };
    project.masks.insert(2, seen);
    project.masks.insert(3, empty);
    press(&mut harness, NONE, Key::D);
    assert_eq!(harness.state().shell.view.frame, 3);
    let absent = FrameSet::from(vec![(3, 11)]);
    harness.state_mut().project.marks.insert(
        LEAF,
        Marks {
            absent,
            ..Marks::default()
        },
    );
    press(&mut harness, NONE, Key::Home);
    press(&mut harness, NONE, Key::D);
    assert_eq!(
        harness.state().shell.view.frame,
        5,
        "what is known to be gone is not lost"
    );
}

#[test]
fn timeline_is_as_high_as_the_rows_of_the_project_and_never_grows_by_itself() {
    let tree = |count: u16| {
        let mut tree = LabelTree::default();
        for id in (1..=count).map(LabelId) {
            tree.set(Label {
                id,
                name: format!("part {}", id.0),
                color: LabelTree::color_for(id),
                parent: None,
            })
            .unwrap();
        }
        tree
    };
    let height = |harness: &Harness<'_, Desk>| {
        let strip = harness.get_by_label("Confidence over frames").rect();
        strip.top() - harness.get_by_label("Image 000.png").rect().bottom()
    };
    let mut heights = Vec::new();
    for count in [0, 2, 3, 5, 40] {
        let mut desk = Desk::sample();
        desk.project.masks.clear();
        desk.project.labels = tree(count);
        desk.size = Vec2::new(1400.0, 1440.0);
        let mut harness = desk.shown();
        heights.push(height(&harness));
        harness.state_mut().project.labels = tree(41);
        harness.run_steps(5);
        assert_eq!(height(&harness), heights[heights.len() - 1], "{count}");
    }
    let rows: Vec<f32> = heights.iter().map(|height| height - heights[0]).collect();
    assert_eq!(
        rows,
        [0.0, 0.0, 24.0, 72.0, 72.0],
        "this window shows 5 rows at most"
    );
}
