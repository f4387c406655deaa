//! Tests of the point inspector of the 3-D view and of clicks that isolate, measure and turn.
//!
//! The inspector lists the voters of a point and links points to image pixels and back.

use std::sync::Arc;

use egui::{Color32, Key, Modifiers, PointerButton, Pos2, Shape};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use ostra_app::{InspectedPoint, Panes};
use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{MaskVote, OntoOptions, ProjectViews, Voter, vote_onto};
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::LabelId;

use crate::desk::{Desk, click_at, labels, on_screen, press};

/// Returns the sample desk with its cloud labelled by its masks.
pub fn voted() -> Desk {
    let desk = Desk::sample();
    let masks = |frame: usize| {
        desk.project
            .mask_in_play(frame)
            .map(|runs| Arc::new(runs.decode()))
    };
    let views = ProjectViews {
        frames: &desk.project.frames,
        store: &FrameStore::new(0),
        masks: &masks,
    };
    let (cloud, options) = (desk.cloud.clone().unwrap(), OntoOptions::default());
    let fused = vote_onto(
        &cloud,
        &MaskVote {
            views: &views,
            tree: &desk.project.labels,
            options: &options,
        },
        &Progress::default(),
    )
    .unwrap();
    Desk {
        cloud: Some(Arc::new(fused.cloud)),
        votes: Some(Arc::new(fused.votes)),
        ..desk
    }
}

fn shown(panes: Panes) -> Harness<'static, Desk> {
    let mut desk = voted();
    desk.shell.view.prefs.panes = panes;
    desk.shell.view.prefs.frusta = false;
    desk.shown()
}

/// Waits for the background search until `is_true`, and fails with `what` if it never is.
fn until(harness: &mut Harness<'static, Desk>, what: &str, is_true: impl Fn(&Desk) -> bool) {
    for _ in 0..500 {
        harness.run_steps(2);
        if is_true(harness.state()) {
            return;
        }
        std::thread::park_timeout(std::time::Duration::from_millis(10));
    }
    panic!("{what}: {:?}", labels(harness));
}

/// Returns where the inspected point is marked in the 3-D view.
fn mark(harness: &Harness<'static, Desk>) -> Pos2 {
    let pane = harness.get_by_label("3-D view").rect();
    let arm = |shape: &Shape| match shape {
        Shape::LineSegment { points, stroke }
            if stroke.color == Color32::from_rgb(255, 235, 90) =>
        {
            Some(*points)
        }
        _ => None,
    };
    let arms = harness
        .output()
        .shapes
        .iter()
        .filter_map(|clipped| arm(&clipped.shape));
    let arms = arms.filter(|ends| ends.iter().all(|&end| pane.contains(end)));
    arms.flatten()
        .fold(egui::Rect::NOTHING, |all, at| {
            all.union(egui::Rect::from_pos(at))
        })
        .center()
}

/// Returns where a point lies in the 3-D view, and leaves no point inspected.
fn place_of(harness: &mut Harness<'static, Desk>, point: usize) -> Pos2 {
    let cloud = harness.state().cloud.clone().unwrap();
    harness.state_mut().shell.view.inspected_point = Some(InspectedPoint::new(&cloud, None, point));
    harness.run_steps(3);
    let at = mark(harness);
    harness.state_mut().shell.view.inspected_point = None;
    harness.run_steps(3);
    at
}

/// Returns a point on which frames disagree and which some see unlabelled, with its voters.
fn contested(desk: &Desk) -> (usize, Vec<Voter>) {
    let (cloud, votes) = (desk.cloud.as_ref().unwrap(), desk.votes.as_ref().unwrap());
    let is_contested = |point: &usize| {
        let voters = votes.voters(*point);
        let with = |wanted: &dyn Fn(LabelId) -> bool| {
            voters.iter().any(|voter| voter.label.is_some_and(wanted))
        };
        let own = cloud.labels[*point];
        with(&|label| label == own)
            && with(&|label| label != own)
            && voters.iter().any(|voter| voter.label.is_none())
    };
    let point = (0..cloud.len()).find(is_contested).unwrap();
    (point, votes.voters(point))
}

#[test]
fn click_lists_voters_with_contradicting_ones_first() {
    let mut harness = shown(Panes::Scene);
    let (point, voters) = contested(harness.state());
    let at = place_of(&mut harness, point);
    click_at(&mut harness, at, PointerButton::Primary);
    until(&mut harness, "it is asked about", |desk| {
        desk.shell.view.inspected_point.is_some()
    });
    // The rows are drawn in the next step.
    harness.run_steps(2);
    let own = harness.state().cloud.as_ref().unwrap().labels[point];
    assert!((mark(&harness) - at).length() < 1.0, "the very point");
    let top = |frame: usize| harness.get_by_label(&format!("frame {frame}")).rect().top();
    let rank = |voter: &Voter| match voter.label {
        Some(label) if label != own => 0,
        Some(_) => 1,
        None => 2,
    };
    // Rows further down only appear after scrolling.
    let rows: Vec<&Voter> = voters
        .iter()
        .filter(|voter| {
            harness
                .query_by_label(&format!("frame {}", voter.frame))
                .is_some()
        })
        .collect();
    assert!(rows.iter().any(|voter| rank(voter) == 0) && rows.iter().any(|voter| rank(voter) == 1));
    for pair in rows.iter().flat_map(|a| rows.iter().map(move |b| (a, b))) {
        assert!(
            rank(pair.0) >= rank(pair.1) || top(pair.0.frame) < top(pair.1.frame),
            "{pair:?}"
        );
    }
}

/// Returns the rectangle of the inspector window.
fn window(harness: &Harness<'static, Desk>) -> egui::Rect {
    let id = egui::Id::unique("point asked about");
    harness
        .ctx
        .memory(|memory| memory.area_rect(id))
        .expect("the window is there")
}

#[test]
fn inspector_is_in_the_side_panel_or_does_not_cover_its_point() {
    let mut harness = shown(Panes::Scene);
    let docked = harness.state().cloud.clone().unwrap();
    harness.state_mut().shell.view.inspected_point = Some(InspectedPoint::new(&docked, None, 0));
    harness.run_steps(4);
    let pane = harness.get_by_label("3-D view").rect();
    let close = harness.get_by_label("Close point").rect();
    assert!(close.left() > pane.right(), "{close} covers {pane}");
    harness.get_by_label("Close point").click();
    harness.run_steps(3);
    assert!(harness.state().shell.view.inspected_point.is_none());
    // Without the side panel it is a window.
    press(&mut harness, Modifiers::NONE, Key::Tab);
    let cloud = harness.state().cloud.clone().unwrap();
    let pane = harness.get_by_label("3-D view").rect();
    // The upper corners of the cloud, and its middle.
    for point in [0, 19, 0, 210] {
        harness.state_mut().shell.view.inspected_point =
            Some(InspectedPoint::new(&cloud, None, point));
        harness.run_steps(4);
        let (window, at) = (window(&harness), mark(&harness));
        assert!(
            pane.contains(at) && !window.expand(20.0).contains(at),
            "{window:?} covers {at}, point {point}"
        );
        assert!(pane.contains_rect(window), "{window:?} in {pane:?}");
    }
    // The inspector stays where the user drags it.
    let by = egui::Vec2::new(-30.0, 40.0);
    let from = window(&harness).center_top() + egui::Vec2::new(0.0, 12.0);
    crate::desk::drag(&mut harness, from, from + by, PointerButton::Primary);
    harness.run_steps(3);
    let moved = window(&harness).center_top() + egui::Vec2::new(0.0, 12.0) - from;
    assert!((moved - by).length() < 2.0, "{moved}");
}

#[test]
fn clicking_a_voter_opens_its_frame_at_the_pixel() {
    let mut harness = shown(Panes::Scene);
    let (point, voters) = contested(harness.state());
    let (cloud, votes) = (
        harness.state().cloud.clone().unwrap(),
        harness.state().votes.clone(),
    );
    harness.state_mut().shell.view.inspected_point =
        Some(InspectedPoint::new(&cloud, votes.as_ref(), point));
    harness.run_steps(3);
    let voter = voters
        .iter()
        .find(|voter| {
            voter
                .label
                .is_some_and(|label| label != cloud.labels[point])
        })
        .unwrap();
    harness
        .get_by_label(&format!("frame {}", voter.frame))
        .click();
    harness.run_steps(3);
    let view = &harness.state().shell.view;
    assert_eq!((view.frame, view.prefs.panes), (voter.frame, Panes::Both));
    assert_eq!(
        view.zoom.centre_px,
        DVec2::new(f64::from(voter.x) + 0.5, f64::from(voter.y) + 0.5)
    );
    assert!(
        view.inspected_point.is_some(),
        "the point stays asked about"
    );
}

#[test]
fn image_pixel_is_found_in_3d() {
    let mut harness = shown(Panes::Image);
    let votes = harness.state().votes.clone().unwrap();
    let (point, x, y) = votes
        .observations(0)
        .find(|&(_, x, y)| (20..44).contains(&x) && (15..33).contains(&y))
        .unwrap();
    let at = on_screen(&harness, x as f32 + 0.5, y as f32 + 0.5);
    harness.hover_at(at);
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::Z);
    let desk = harness.state();
    assert_eq!(
        desk.shell.view.prefs.panes,
        Panes::Both,
        "the 3-D view opens"
    );
    let seen = desk
        .shell
        .view
        .inspected_point
        .as_ref()
        .and_then(|requested| requested.seen_in(0))
        .unwrap();
    assert!(
        seen.distance(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)) < 1.0,
        "{seen} of point {point}"
    );
    harness.run_steps(3);
    let middle = harness.get_by_label("3-D view").rect().center();
    let at = mark(&harness);
    assert!(
        (at - middle).length() < 3.0,
        "it is in the middle of the view: {at} and {middle}"
    );
}

#[test]
fn inspected_point_follows_its_votes_and_ends_with_the_cloud() {
    let mut harness = shown(Panes::Scene);
    let (cloud, votes) = (
        harness.state().cloud.clone().unwrap(),
        harness.state().votes.clone(),
    );
    let point = (0..cloud.len())
        .find(|&point| cloud.labels[point] == LabelId(2))
        .unwrap();
    harness.state_mut().shell.view.inspected_point =
        Some(InspectedPoint::new(&cloud, votes.as_ref(), point));
    harness.run_steps(3);
    assert!(
        harness.query_all_by_label("pot").count() == 1,
        "in the list of labels only"
    );
    let labelled = LabelledCloud {
        labels: vec![LabelId(3); cloud.len()],
        ..(*cloud).clone()
    };
    harness.state_mut().cloud = Some(Arc::new(labelled));
    harness.run_steps(3);
    assert!(
        harness.query_all_by_label("pot").count() == 2,
        "{:?}",
        labels(&harness)
    );
    harness.state_mut().cloud = Some(Arc::new(cloud.select(&[0, 1, 2])));
    harness.state_mut().votes = None;
    harness.run_steps(3);
    assert!(harness.state().shell.view.inspected_point.is_none());
}

#[test]
fn clicks_isolate_measure_and_turn_about_the_point_they_hit() {
    let mut harness = shown(Panes::Scene);
    let cloud = harness.state().cloud.clone().unwrap();
    let point = (0..cloud.len())
        .find(|&point| cloud.labels[point] == LabelId(2))
        .unwrap();
    let at = place_of(&mut harness, point);
    harness.event(egui::Event::ModifiersChanged(Modifiers::ALT));
    click_at(&mut harness, at, PointerButton::Primary);
    harness.event(egui::Event::ModifiersChanged(Modifiers::NONE));
    until(&mut harness, "it is isolated", |desk| {
        desk.shell.view.scene.isolated == Some(LabelId(2))
    });
    harness.state_mut().shell.view.scene.isolated = None;
    harness.state_mut().shell.view.ruler.in_hand = true;
    // The ruler's row makes the view smaller, so places are computed after it is shown.
    let both = [point, point + 3].map(|point| place_of(&mut harness, point));
    for (count, at) in (1..).zip(both) {
        click_at(&mut harness, at, PointerButton::Primary);
        until(&mut harness, "it is measured", |desk| {
            desk.shell.view.ruler.points.len() == count
        });
    }
    assert_eq!(
        harness.state().shell.view.ruler.points,
        [cloud.positions[point], cloud.positions[point + 3]]
    );
    harness.state_mut().shell.view.ruler.in_hand = false;
    let at = place_of(&mut harness, point);
    harness.hover_at(at);
    harness.run_steps(1);
    // Both clicks fall within one frame: two frames take longer than a double click allows.
    let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
    let press = |pressed| egui::Event::PointerButton {
        pos: at,
        button,
        pressed,
        modifiers,
    };
    harness
        .input_mut()
        .events
        .extend([true, false, true, false].map(press));
    harness.step();
    let middle = harness.get_by_label("3-D view").rect().center();
    for round in 0.. {
        harness.run_steps(2);
        if (place_of(&mut harness, point) - middle).length() < 3.0 {
            break;
        }
        let now = place_of(&mut harness, point);
        assert!(
            round < 300,
            "it comes into the middle: it was at {at} and is at {now}, the middle {middle}"
        );
        std::thread::park_timeout(std::time::Duration::from_millis(10));
    }
}
