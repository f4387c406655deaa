//! Tests of the window of cameras and matches.

use std::collections::BTreeMap;
use std::sync::Arc;

use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};
use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
use ostra_project::ReconstructRequest;
use ostra_project::workflow::WorkflowStep;
use ostra_reconstruct::sfm::RegistrationStatus;
use ostra_session::{Command, SparseReconstruction};

use crate::desk::{Desk, open_advanced, press};

/// Returns a model in which frames 0, 1 and 3 share points and frame 2 has no camera.
fn sparse() -> SparseReconstruction {
    let point = |x: f64| SparsePoint {
        position: DVec3::new(x, 0.0, 0.0),
        color: [200, 80, 10],
        error_px: Some(0.4),
    };
    let sees = |from: u32, to: u32| -> Vec<SparseKeypoint> {
        let at = |i: u32| DVec2::new(2.0 + f64::from(i), 20.0);
        (from..to)
            .map(|i| SparseKeypoint {
                at_px: at(i),
                point: Some(i),
            })
            .collect()
    };
    let points = SparsePoints {
        points: (0..40).map(|i| point(f64::from(i) * 0.02)).collect(),
        keypoints: BTreeMap::from([(0, sees(0, 30)), (1, sees(10, 40)), (3, sees(25, 40))]),
    };
    let placed = |points| RegistrationStatus::Placed {
        points,
        error_px: 0.4,
    };
    let outcomes = BTreeMap::from([
        (0, placed(30)),
        (1, placed(30)),
        (
            2,
            RegistrationStatus::FewPoints {
                seen: 7,
                needed: 30,
                nearest: Some((1, 19)),
            },
        ),
        (3, placed(15)),
    ]);
    SparseReconstruction::new(points, outcomes, Vec::new())
}

fn with_sparse() -> Desk {
    let mut desk = Desk::sample();
    (desk.cloud, desk.sparse) = (None, Some(Arc::new(sparse())));
    desk
}

#[test]
fn window_explains_why_a_frame_has_no_camera_and_goes_to_it() {
    let mut harness = with_sparse().shown();
    press(&mut harness, egui::Modifiers::NONE, egui::Key::F6);
    harness.get_by_label("3 of 4 frames have a camera");
    harness.get_by_label_contains("no camera");
    assert_eq!(
        harness
            .get_all_by_label_contains("30 points  0.40 px")
            .count(),
        2
    );
    harness.get_by_label_contains("2  002.png").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.frame, 2);
    harness.get_by_label("Frame 2 has no match with another frame.");
}

#[test]
fn two_frames_are_shown_side_by_side_and_the_second_is_selectable() {
    let mut harness = with_sparse().shown();
    press(&mut harness, egui::Modifiers::NONE, egui::Key::F6);
    harness.get_by_label("Matches of frames 0 and 1");
    harness.get_by_value("frame 1: 20 shared points").click();
    harness.run_steps(3);
    harness.get_by_label("frame 3: 5 shared points").click();
    harness.run_steps(3);
    harness.get_by_label("Matches of frames 0 and 3");
    press(&mut harness, egui::Modifiers::NONE, egui::Key::F6);
    assert!(
        harness
            .query_by_label("Matches of frames 0 and 3")
            .is_none()
    );
}

#[test]
fn panel_sends_the_chosen_options() {
    let mut harness = with_sparse().shown();
    assert!(
        harness.query_by_label("Only labelled pixels").is_none(),
        "folded until it is wanted"
    );
    open_advanced(&mut harness, WorkflowStep::Geometry);
    harness.get_by_label("Only labelled pixels").click();
    harness
        .get_by_role_and_label(egui::Role::TextInput, "Pairs")
        .focus();
    harness.run_steps(2);
    harness
        .get_by_role_and_label(egui::Role::TextInput, "Pairs")
        .type_text("0,2 1");
    harness.run_steps(3);
    press(&mut harness, egui::Modifiers::NONE, egui::Key::Escape);
    press(&mut harness, egui::Modifiers::NONE, egui::Key::R);
    assert_eq!(
        harness.state().requested,
        [],
        "no pair is left out in silence"
    );
    assert!(
        harness
            .query_all_by_label_contains("'1' is not a pair of frames")
            .count()
            >= 1
    );
    harness
        .get_by_role_and_label(egui::Role::TextInput, "Pairs")
        .focus();
    harness.run_steps(2);
    harness
        .get_by_role_and_label(egui::Role::TextInput, "Pairs")
        .type_text(",3");
    harness.run_steps(3);
    press(&mut harness, egui::Modifiers::NONE, egui::Key::Escape);
    press(&mut harness, egui::Modifiers::NONE, egui::Key::R);
    let pairs = vec![[0, 2], [1, 3]];
    let request = ReconstructRequest {
        only_labelled: true,
        pairs,
        ..ReconstructRequest::default()
    };
    assert_eq!(harness.state().requested, [Command::Reconstruct(request)]);
}
