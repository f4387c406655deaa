//! Tests of the panels around the image.

use ostra_project::TrackerId;
use ostra_project::workflow::WorkflowStep;
use std::sync::Arc;

use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::{Panes, Severity, Shown};
use ostra_frames::{DepthSource, Orientation};
use ostra_masks::{Apartness, LabelId, PxBox};
use ostra_session::{Command, Reason, Suggestion, SurfaceKind, TrackSettings};

use crate::desk::{Desk, labels, open_advanced, open_step};

#[test]
fn empty_window_lists_recent_projects() {
    let mut desk = Desk::empty();
    desk.recent = vec!["/projects/rice".into()];
    let mut harness = desk.shown();
    assert!(harness.query_by_label("Frame 0, no mask").is_none());
    harness.get_by_label("Open rice").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().requested,
        [Command::Open("/projects/rice".into())]
    );
}

#[test]
fn filmstrip_shows_the_state_of_every_visible_frame() {
    let mut harness = Desk::sample().shown();
    for name in [
        "Frame 0, keyframe",
        "Frame 1, tracked",
        "Frame 2, stale",
        "Frame 3, no mask",
    ] {
        assert!(
            harness.query_by_label(name).is_some(),
            "{name} in {:?}",
            labels(&harness)
        );
    }
    harness.get_by_label("Frame 2, stale").click();
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.frame, 2);
}

#[test]
fn filmstrip_of_three_thousand_frames_builds_only_visible_tiles() {
    let mut desk = Desk::sample();
    let frames: Vec<_> = (0..3000)
        .map(|number| desk.project.frames[number % 12].clone())
        .collect();
    desk.project.frames = std::sync::Arc::new(frames);
    let mut harness = desk.shown();
    let tiles = |harness: &egui_kittest::Harness<'_, Desk>| {
        labels(harness)
            .iter()
            .filter(|label| label.starts_with("Frame "))
            .count()
    };
    assert!(tiles(&harness) < 40, "{}", tiles(&harness));
    harness.state_mut().shell.view.go_to(2900);
    harness.run_steps(3);
    assert!(
        harness.query_by_label("Frame 2900, no mask").is_some(),
        "the strip follows"
    );
}

#[test]
fn labels_are_added_renamed_hidden_and_removed() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("New label name").focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("panicle".into()));
    harness.run_steps(2);
    harness.get_by_label("Add").click();
    harness.run_steps(2);
    harness.get_by_label("Hide leaf").click();
    harness.run_steps(2);
    assert!(harness.state().shell.view.hidden.contains(&LabelId(2)));
    assert!(harness.query_by_label("Show leaf").is_some());
    harness.get_by_label("More for pot").click();
    harness.run_steps(3);
    harness.get_by_label("Remove").click();
    harness.run_steps(2);
    let requested = &harness.state().requested;
    let name = "panicle".to_owned();
    assert_eq!(
        requested[..],
        [
            Command::AddLabel {
                name,
                parent: None,
                color: None
            },
            Command::RemoveLabel(LabelId(3))
        ]
    );
}

#[test]
fn suggestions_appear_as_they_arrive_and_become_labels() {
    let mut harness = Desk::sample().shown();
    assert!(harness.query_by_label("Add suggestion 1").is_none());
    let (at_px, corner) = (glam::DVec2::new(50.5, 40.5), glam::DVec2::new(45.0, 35.0));
    let around_px = PxBox {
        min_px: corner,
        max_px: corner + 10.0,
    };
    let ring = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
        .map(|(x, y)| corner + glam::DVec2::new(x, y));
    let (rings_px, why) = ([ring.to_vec()].into(), Reason::Apart(Apartness::Moves));
    let one = Suggestion {
        frame: 5,
        at_px,
        around_px,
        rings_px,
        share: 0.03,
        why,
    };
    harness.state_mut().suggestions.push(one);
    open_step(&mut harness, WorkflowStep::Label);
    harness.run_steps(30);
    harness.get_by_label("Add suggestion 1").click();
    harness.run_steps(2);
    let [Command::AddLabel { .. }, Command::Prompt(request)] = &harness.state().requested[..]
    else {
        panic!("{:?}", harness.state().requested)
    };
    assert_eq!((request.frame, request.label), (5, LabelId(4)));
    assert_eq!(
        (request.prompt.clicks[0].at_px, &request.prompt.boxes[..]),
        (at_px, &[around_px][..])
    );
    assert_eq!(harness.state().shell.view.frame, 5);
}

#[test]
fn label_with_children_cannot_be_removed() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("More for plant").click();
    harness.run_steps(3);
    assert!(
        harness
            .get_by_label("Remove")
            .accesskit_node()
            .is_disabled()
    );
}

#[test]
fn engine_lists_show_which_engines_are_installed() {
    let mut harness = Desk::sample().shown();
    open_advanced(&mut harness, WorkflowStep::Track);
    harness
        .get_by_role_and_label(egui::Role::ComboBox, "Tracker")
        .click();
    harness.run_steps(3);
    assert!(
        harness
            .get_by_label("xmem (not installed)")
            .accesskit_node()
            .is_disabled(),
        "{:?}",
        labels(&harness)
    );
    harness.get_by_label("geometry").click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().shell.view.track.tracker,
        TrackerId::Geometry
    );
}

#[test]
fn geometry_check_needs_depth_and_cameras() {
    let mut harness = Desk::sample().shown();
    open_advanced(&mut harness, WorkflowStep::Track);
    let name = "Check by geometry";
    assert!(
        harness.get_by_label(name).accesskit_node().is_disabled(),
        "the frames have no depth"
    );
    harness.get_by_label(name).hover();
    harness.run_steps(30);
    let tip = "Needs frames with depth and cameras: add them, or use Reconstruct first";
    assert!(
        harness.query_by_label(tip).is_some(),
        "{:?}",
        labels(&harness)
    );
    let mut frames = harness.state().project.frames.to_vec();
    let (unit, orientation) = (0.001, Orientation(1));
    frames[3].depth = Some(DepthSource::Sensor {
        path: "d.png".into(),
        unit,
        orientation,
        camera: None,
    });
    harness.state_mut().project.frames = Arc::new(frames);
    harness.run_steps(2);
    harness.get_by_label(name).click();
    harness.run_steps(2);
    assert!(harness.state().shell.view.track.constrain);
    harness.get_all_by_label("Track").last().unwrap().click();
    harness.run_steps(2);
    assert!(
        matches!(&harness.state().requested[..], [Command::Track(settings)] if settings.constrain)
    );
    harness.state_mut().shell.view.track.tracker = TrackerId::Geometry;
    harness.run_steps(2);
    assert!(harness.get_by_label(name).accesskit_node().is_disabled());
    assert!(
        !harness.state().shell.view.track.constrain,
        "'geometry' needs no such request"
    );
}

#[test]
fn buttons_request_undo_tracking_reconstruction_and_fusion() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Undo").click();
    harness.run_steps(2);
    for (step, name) in [
        (WorkflowStep::Track, "Track"),
        (WorkflowStep::Geometry, "Reconstruct"),
        (WorkflowStep::Cloud, "Fuse"),
    ] {
        open_step(&mut harness, step);
        let button = harness.get_all_by_label(name).last().unwrap();
        button.click();
        harness.run_steps(2);
    }
    let requested = &harness.state().requested;
    assert!(
        matches!(
            requested[..],
            [
                Command::Undo,
                Command::Track(_),
                Command::Reconstruct(_),
                Command::Fuse(_)
            ]
        ),
        "{requested:?}"
    );
}

#[test]
fn one_label_is_re_tracked_around_a_corrected_frame() {
    let mut harness = Desk::sample().shown();
    let name = "Re-track this label around this frame";
    harness.state_mut().shell.view.label = Some(LabelId(2));
    open_advanced(&mut harness, WorkflowStep::Track);
    harness.get_by_label("Replace other labels").click();
    harness.run_steps(2);
    harness.get_by_label(name).click();
    harness.run_steps(2);
    let settings = TrackSettings {
        from: Some(0),
        to: Some(11),
        labels: vec![LabelId(2)],
        replace: true,
        ..TrackSettings::default()
    };
    assert_eq!(harness.state().requested[..], [Command::Track(settings)]);
    harness.state_mut().shell.view.go_to(1);
    harness.run_steps(2);
    assert!(
        harness.get_by_label(name).accesskit_node().is_disabled(),
        "a tracked frame was not corrected"
    );
}

#[test]
fn network_input_size_can_be_chosen() {
    let mut harness = Desk::sample().shown();
    open_advanced(&mut harness, WorkflowStep::Track);
    assert!(
        harness.query_by_label("custom").is_none(),
        "our own trackers see images as they are"
    );
    harness.state_mut().shell.view.track.tracker = TrackerId::XMem;
    harness.run_steps(2);
    assert!(
        harness
            .query_by_label("Network image size in pixels")
            .is_none()
    );
    harness.get_by_label("custom").click();
    harness.run_steps(2);
    assert_eq!(
        harness
            .get_by_label("Network image size in pixels")
            .accesskit_node()
            .numeric_value(),
        Some(480.0)
    );
    assert_eq!(harness.state().shell.view.track.short_side, Some(480));
    harness.state_mut().shell.view.track.tracker = TrackerId::Flow;
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.track.short_side, None);
}

#[test]
fn many_warnings_are_folded_and_all_of_them_can_be_read() {
    let mut harness = Desk::sample().shown();
    let texts: Vec<String> = (0..7).map(|n| format!("{n}.jpg has no camera")).collect();
    for text in &texts {
        let notices = &mut harness.state_mut().shell.view.notices;
        notices.tell(Severity::Warning, text.as_str());
    }
    harness.run_steps(3);
    let drawn = |harness: &egui_kittest::Harness<'_, Desk>| -> Vec<bool> {
        let is_there = |text: &String| harness.query_by_label(text).is_some();
        texts.iter().map(is_there).collect()
    };
    assert_eq!(
        drawn(&harness),
        [false, false, false, false, true, true, true]
    );
    harness.get_by_label("7 messages");
    harness.get_by_label("Show all").click();
    harness.run_steps(3);
    assert_eq!(drawn(&harness), [true; 7]);
    harness.get_by_label("Show the last ones").click();
    harness.run_steps(3);
    assert!(!drawn(&harness)[0]);
    harness.get_by_label("Dismiss all").click();
    harness.run_steps(3);
    assert_eq!(drawn(&harness), [false; 7]);
    assert!(harness.state().shell.view.notices.shown().is_empty());
}

#[test]
fn errors_are_shown_once_and_can_be_dismissed() {
    let mut harness = Desk::sample().shown();
    for _ in 0..2 {
        harness
            .state_mut()
            .shell
            .view
            .notices
            .tell(Severity::Error, "The disk is full; free some space");
    }
    harness.run_steps(3);
    assert_eq!(
        harness
            .get_all_by_label("The disk is full; free some space")
            .count(),
        1
    );
    harness
        .get_by_label("Dismiss Error: The disk is full; free some space")
        .click();
    harness.run_steps(2);
    assert!(
        harness
            .query_by_label("The disk is full; free some space")
            .is_none()
    );
}

#[test]
fn inspecting_a_cloud_shows_only_the_3d_view_and_its_labels() {
    let mut desk = Desk::empty();
    desk.cloud = Desk::sample().cloud;
    desk.inspected = Some("/clouds/plant.ply".into());
    let harness = desk.shown();
    assert!(harness.query_by_label("3-D view").is_some());
    assert!(harness.query_by_label("Hide leaf").is_some());
    assert!(harness.query_by_label("Reconstruct").is_none());
}

#[test]
fn surface_can_be_shown_as_mesh_wireframe_or_voxels() {
    assert!(
        Desk::sample()
            .shown()
            .query_by_label("Shown model")
            .is_none(),
        "a cloud alone has no other form"
    );
    let mut desk = Desk::sample();
    desk.surface = Some(Arc::default());
    let mut harness = desk.shown();
    let forms = [
        ("Mesh", Shown::Mesh, Some(SurfaceKind::Mesh)),
        ("Wireframe", Shown::Wireframe, Some(SurfaceKind::Mesh)),
        ("Voxels", Shown::Voxels, Some(SurfaceKind::Voxels)),
        ("Points", Shown::Points, None),
    ];
    for (name, shown, needed) in forms {
        harness.get_by_label("Shown model").click();
        harness.run_steps(2);
        harness.get_all_by_label(name).last().unwrap().click();
        harness.run_steps(2);
        let now = harness.state().shell.view.shown;
        assert_eq!((now, now.surface()), (shown, needed));
    }
}

#[test]
fn panes_are_shown_side_by_side_or_alone() {
    let mut harness = Desk::sample().shown();
    for (panes, image, scene) in [
        (Panes::Both, true, true),
        (Panes::Image, true, false),
        (Panes::Scene, false, true),
    ] {
        harness.state_mut().shell.view.prefs.panes = panes;
        harness.run_steps(2);
        assert_eq!(
            harness.query_by_label("Image 000.png").is_some(),
            image,
            "{panes:?}"
        );
        assert_eq!(
            harness.query_by_label("3-D view").is_some(),
            scene,
            "{panes:?}"
        );
    }
}

#[test]
fn every_control_has_a_name() {
    let harness = Desk::sample().shown();
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
}
