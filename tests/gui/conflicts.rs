//! Tests of the conflicts panel and of the label of an inspected point.

use std::collections::BTreeMap;

use egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable;
use ostra_app::InspectedPoint;
use ostra_cloud::conflicts::FrameConflict;
use ostra_masks::LabelId;
use ostra_project::workflow::WorkflowStep;
use ostra_session::Command;

use crate::desk::{Desk, open_step};

#[test]
fn worst_masks_are_listed_and_the_vote_can_be_accepted() {
    let mut desk = Desk::sample();
    let conflict = |against| FrameConflict {
        compared: 1000,
        against,
    };
    desk.conflicts = BTreeMap::from([(2, conflict(400)), (5, conflict(3)), (7, conflict(120))]);
    let mut harness = desk.shown();
    open_step(&mut harness, WorkflowStep::Cloud);
    assert!(
        harness.query_by_label(" 0.3 %  frame 5").is_none(),
        "noise at borders is not listed"
    );
    harness.get_by_label("12.0 %  frame 7").click();
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.frame, 7);
    harness.key_press_modifiers(Modifiers::SHIFT, Key::D);
    harness.run_steps(2);
    assert_eq!(
        harness.state().shell.view.frame,
        2,
        "from the end of the list to the worst"
    );
    harness.key_press_modifiers(Modifiers::SHIFT, Key::A);
    harness.run_steps(2);
    let label = LabelId(2);
    harness.state_mut().shell.view.label = Some(label);
    harness.get_by_label("Only this label").click();
    harness.run_steps(2);
    let accept = |labels| Command::AcceptVote { frame: 2, labels };
    assert_eq!(
        harness.state().requested,
        [accept(Vec::new()), accept(vec![label])]
    );
}

#[test]
fn inspected_point_shows_its_label() {
    let desk = Desk::sample();
    let cloud = desk.cloud.clone().unwrap();
    let mut harness = desk.shown();
    assert!(harness.query_by_label("Point").is_none());
    harness.state_mut().shell.view.inspected_point = Some(InspectedPoint::new(&cloud, None, 2));
    harness.run_steps(3);
    let path = harness.state().project.labels.path(cloud.labels[2]);
    let name = |id: &LabelId| {
        harness
            .state()
            .project
            .labels
            .get(*id)
            .unwrap()
            .name
            .clone()
    };
    let text = path.iter().map(name).collect::<Vec<_>>().join(" › ");
    assert!(harness.query_all_by_label(&text).next().is_some(), "{text}");
    assert!(
        harness
            .query_by_label("No frame with a mask shows this point.")
            .is_some()
    );
}
