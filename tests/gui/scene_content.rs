//! Tests of what the 3-D view shows and from where: depth points, first view, content out of view.

use std::sync::Arc;

use egui::{Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{Vec2, Vec3};
use ostra_app::Panes;
use ostra_cloud::LabelledCloud;
use ostra_frames::cameras::{SparsePoint, SparsePoints};
use ostra_session::{DepthPoints, SparseReconstruction};
use ostra_view::{Appearance, Clip, Orbit, PickRequest, pick_point};

use crate::desk::{Desk, click_at, drag, labels, press};
use crate::inspector::voted;

const ALL: &str = "Show whole cloud (A)";
const NOTE: &str = "No cameras yet: these are the points of the shown frame alone";

/// Returns a desk without results, but with cameras.
fn desk() -> Desk {
    let mut desk = Desk::sample();
    desk.cloud = None;
    desk.shell.view.prefs.panes = Panes::Scene;
    desk
}

/// Returns a square of points around a place.
fn square(place: Vec3, side: f32) -> Arc<LabelledCloud> {
    let at = |i: usize| {
        Vec3::new(
            (i % 20) as f32 / 19.0 - 0.5,
            (i / 20) as f32 / 19.0 - 0.5,
            0.0,
        )
    };
    let positions = (0..400).map(|i| place + side * at(i)).collect();
    Arc::new(LabelledCloud::from_positions(positions))
}

fn sparse() -> Arc<SparseReconstruction> {
    let point = |position: &Vec3| SparsePoint {
        position: position.as_dvec3(),
        color: [90; 3],
        error_px: None,
    };
    let points = SparsePoints {
        points: square(Vec3::new(0.0, 1.0, 5.0), 12.0)
            .positions
            .iter()
            .map(point)
            .collect(),
        ..SparsePoints::default()
    };
    Arc::new(SparseReconstruction::new(
        points,
        Default::default(),
        Vec::new(),
    ))
}

fn depth(place: Vec3, side: f32, has_all: bool) -> Option<Arc<DepthPoints>> {
    Some(Arc::new(DepthPoints {
        cloud: square(place, side),
        has_all,
        in_world: true,
    }))
}

fn orbit(harness: &Harness<'_, Desk>) -> Orbit {
    harness.state().shell.orbit().unwrap()
}

#[test]
fn first_view_does_not_depend_on_what_is_loaded_first() {
    let cloud = square(Vec3::ZERO, 1.0);
    let mut at_once = desk();
    (at_once.cloud, at_once.sparse) = (Some(Arc::clone(&cloud)), Some(sparse()));
    let at_once = orbit(&at_once.shown());
    let mut late = desk().shown();
    late.state_mut().sparse = Some(sparse());
    late.run_steps(2);
    assert_ne!(orbit(&late), at_once, "of the sparse points");
    late.state_mut().cloud = Some(Arc::clone(&cloud));
    late.run_steps(2);
    assert_eq!(orbit(&late), at_once);
    let mut early = desk();
    early.cloud = Some(cloud);
    let mut early = early.shown();
    early.state_mut().sparse = Some(sparse());
    early.run_steps(2);
    assert_eq!(orbit(&early), at_once);
    // A recording with depth: the shown frame is read first.
    let mut frames = desk().shown();
    frames.state_mut().depth_points = depth(Vec3::X, 0.5, false);
    frames.run_steps(2);
    frames.state_mut().depth_points = depth(Vec3::ZERO, 3.0, true);
    frames.run_steps(2);
    let mut all = desk();
    all.depth_points = depth(Vec3::ZERO, 3.0, true);
    assert_eq!(orbit(&frames), orbit(&all.shown()));
}

#[test]
fn view_moved_by_hand_stays_while_content_comes_and_goes() {
    let mut desk = desk();
    desk.depth_points = depth(Vec3::ZERO, 1.0, true);
    let mut harness = desk.shown();
    let middle = harness.get_by_label("3-D view").rect().center();
    drag(
        &mut harness,
        middle,
        middle + egui::vec2(40.0, 10.0),
        PointerButton::Primary,
    );
    let moved = orbit(&harness);
    for (cloud, depth_points) in [
        (None, None),
        (None, depth(Vec3::X, 2.0, true)),
        (Some(square(Vec3::ZERO, 1.0)), None),
        (None, None),
        (Some(square(Vec3::ZERO, 1.5)), None),
    ] {
        let desk = harness.state_mut();
        (desk.cloud, desk.depth_points) = (cloud, depth_points);
        harness.run_steps(2);
        assert_eq!(orbit(&harness), moved);
    }
    press(&mut harness, Modifiers::NONE, Key::A);
    harness.run_steps(2);
    assert_ne!(orbit(&harness), moved);
}

#[test]
fn button_brings_a_cloud_back_that_is_out_of_view() {
    let mut desk = desk();
    desk.cloud = Some(square(Vec3::ZERO, 1.0));
    let mut harness = desk.shown();
    harness.run_steps(3);
    assert!(harness.query_by_label(ALL).is_none(), "it is in view");
    // As after a fusion whose result has another scale than the view.
    harness.state_mut().cloud = Some(square(Vec3::new(50.0, 0.0, 0.0), 1.0));
    harness.run_steps(3);
    harness.get_by_label(ALL).click();
    harness.run_steps(4);
    assert!(
        harness.query_by_label(ALL).is_none(),
        "{:?}",
        labels(&harness)
    );
    assert!((orbit(&harness).target.x - 50.0).abs() < 1.0);
}

#[test]
fn button_brings_cameras_back_if_they_are_all_that_is_shown() {
    let mut desk = desk();
    desk.shell.view.prefs.frusta = true;
    let mut harness = desk.shown();
    let shown = "Show everything (A)";
    assert!(harness.query_by_label(shown).is_none());
    let middle = harness.get_by_label("3-D view").rect().center();
    for _ in 0..12 {
        drag(
            &mut harness,
            middle,
            middle + egui::vec2(250.0, 0.0),
            PointerButton::Secondary,
        );
    }
    harness.run_steps(3);
    harness.get_by_label(shown).click();
    harness.run_steps(4);
    assert!(harness.query_by_label(shown).is_none());
    harness.state_mut().shell.view.prefs.frusta = false;
    for _ in 0..12 {
        drag(
            &mut harness,
            middle,
            middle + egui::vec2(250.0, 0.0),
            PointerButton::Secondary,
        );
    }
    harness.run_steps(3);
    assert!(
        harness.query_by_label(shown).is_none(),
        "cameras are not shown"
    );
}

#[test]
fn button_shows_cameras_that_are_outside_the_view_of_a_cloud() {
    const CAMERAS: &str = "Show cameras";
    let mut desk = desk();
    desk.cloud = Some(square(Vec3::new(60.0, 0.0, 0.0), 1.0));
    desk.shell.view.prefs.frusta = true;
    let mut harness = desk.shown();
    harness.run_steps(3);
    let far = orbit(&harness).distance;
    harness.get_by_label(CAMERAS).click();
    harness.run_steps(4);
    assert!(harness.query_by_label(CAMERAS).is_none());
    assert!(
        harness.query_by_label(ALL).is_none(),
        "the cloud is still in view"
    );
    assert!(orbit(&harness).distance > 10.0 * far);
    press(&mut harness, Modifiers::NONE, Key::A);
    harness.run_steps(4);
    assert!(harness.query_by_label(CAMERAS).is_some());
    harness.state_mut().shell.view.prefs.frusta = false;
    harness.run_steps(2);
    assert!(
        harness.query_by_label(CAMERAS).is_none(),
        "cameras are switched off"
    );
}

#[test]
fn no_button_shows_cameras_while_their_edges_are_in_view() {
    let size = egui::Vec2::new(1296.0, 816.0);
    let mut harness = Desk::sample().shown_at(Harness::builder(), size);
    assert!(harness.state().shell.view.prefs.frusta);
    harness.run_steps(4);
    assert!(harness.query_by_label("Show cameras").is_none());
    // Frustums of no size are points, which lie outside the view.
    harness.state_mut().shell.view.prefs.scene.frustum = 0.0;
    harness.run_steps(4);
    harness.get_by_label("Show cameras");
}

#[test]
fn points_of_depth_maps_are_shown_until_there_is_a_cloud() {
    let mut desk = desk();
    desk.depth_points = Some(Arc::new(DepthPoints {
        cloud: square(Vec3::Z, 1.0),
        has_all: false,
        in_world: false,
    }));
    let mut frames = desk.project.frames.to_vec();
    for frame in &mut frames {
        frame.camera.as_mut().unwrap().camera_from_world = None;
    }
    desk.project.frames = Arc::new(frames);
    let mut harness = desk.shown();
    assert!(
        harness.query_by_label(NOTE).is_some(),
        "{:?}",
        labels(&harness)
    );
    assert!((orbit(&harness).target - Vec3::Z).length() < 0.1);
    // With cameras, the points move into the world and the view follows.
    let desk = harness.state_mut();
    desk.project = Desk::sample().project;
    desk.depth_points = depth(Vec3::new(9.0, 0.0, 0.0), 1.0, true);
    harness.run_steps(3);
    assert!(harness.query_by_label(NOTE).is_none());
    assert!((orbit(&harness).target.x - 9.0).abs() < 0.1);
    assert!(harness.query_by_label(ALL).is_none());
}

#[test]
fn points_with_few_votes_are_hidden_by_a_slider_and_not_picked() {
    let mut desk = voted();
    desk.shell.view.prefs.panes = Panes::Scene;
    let (cloud, votes) = (desk.cloud.clone().unwrap(), desk.votes.clone().unwrap());
    let mut harness = desk.shown();
    harness.get_by_label("Display").click();
    harness.run_steps(3);
    let slider = harness.get_by_label("Number of views").rect();
    assert_eq!(
        harness.state().shell.view.scene.least_views,
        0,
        "all are shown"
    );
    click_at(&mut harness, slider.center(), PointerButton::Primary);
    assert!(harness.state().shell.view.scene.least_views > 1, "{slider}");
    let camera = orbit(&harness).camera(400, 400);
    let most = (0..cloud.len())
        .max_by_key(|&point| votes.voted(point))
        .unwrap();
    let mut request = PickRequest {
        camera,
        appearance: Appearance {
            votes: Some(Arc::clone(&votes)),
            least_views: votes.voted(most),
            ..Appearance::default()
        },
        clip: Clip::default(),
        at_px: camera
            .project(cloud.positions[most])
            .map_or(Vec2::ZERO, |(px, _)| px),
        radius_px: 400.0,
    };
    let picked = pick_point(&cloud, &request).unwrap();
    assert_eq!(votes.voted(picked), votes.voted(most));
    request.appearance.least_views += 1;
    assert_eq!(pick_point(&cloud, &request), None);
}
