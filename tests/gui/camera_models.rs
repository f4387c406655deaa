//! Tests of the list of models that images without connection fall into.

use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_project::workflow::WorkflowStep;
use ostra_project::{Coordinates, ResultEngine, ResultKind, ResultRecord, SparseModelRecord};
use ostra_session::Command;

use crate::desk::{Desk, open_step};

/// Returns a desk with cameras of the first of two models, and no cloud.
pub fn with_models() -> Desk {
    let mut desk = Desk::sample();
    let model = |version, frames, points| SparseModelRecord {
        version,
        frames,
        points,
        settings: String::new(),
        coordinates: Coordinates::chosen_with(version, false),
        scaled: None,
    };
    let models = vec![model(4, 12, 1200), model(5, 7, 640)];
    let record = ResultRecord {
        engine: ResultEngine::Sfm,
        frames: 12,
        version: 4,
        coordinates: Some(models[0].coordinates),
        models,
        ..ResultRecord::default()
    };
    desk.project.results.insert(ResultKind::Cameras, record);
    desk.cloud = None;
    desk
}

const FIRST: &str = "Model 1: 12 images, 1 200 points";
const SECOND: &str = "Model 2: 7 images, 640 points";

fn is_chosen(harness: &Harness<'_, Desk>, label: &str) -> bool {
    let node = harness.get_by_label(label);
    node.accesskit_node().toggled() == Some(egui::accesskit::Toggled::True)
}

#[test]
fn models_are_listed_and_a_click_uses_another_one() {
    let mut harness = with_models().shown();
    open_step(&mut harness, WorkflowStep::Geometry);
    harness.get_by_label("Models");
    assert!(is_chosen(&harness, FIRST) && !is_chosen(&harness, SECOND));
    harness.get_by_label(FIRST).click();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [], "it is in use already");
    harness.get_by_label(SECOND).click();
    harness.run_steps(2);
    assert_eq!(
        harness.state().requested,
        [Command::SelectModel { model: 2 }]
    );
    let records = &mut harness.state_mut().project.results;
    let record = records.get_mut(&ResultKind::Cameras).unwrap();
    *record = record.with_model(&record.models[1]);
    harness.run_steps(2);
    assert!(!is_chosen(&harness, FIRST) && is_chosen(&harness, SECOND));
}

#[test]
fn one_model_needs_no_list() {
    let mut desk = with_models();
    let record = desk.project.results.get_mut(&ResultKind::Cameras).unwrap();
    record.models.clear();
    let mut harness = desk.shown();
    open_step(&mut harness, WorkflowStep::Geometry);
    assert!(harness.query_by_label("Models").is_none());
}

#[test]
fn cloud_of_another_model_is_named() {
    let note = "The cloud is of another model. Reconstruct and fuse again.";
    let mut desk = with_models();
    desk.cloud = Desk::sample().cloud;
    let world = desk.project.coordinates();
    let cloud = |coordinates| ResultRecord {
        engine: ResultEngine::Fuse,
        version: 6,
        coordinates: Some(coordinates),
        ..ResultRecord::default()
    };
    desk.project.results.insert(ResultKind::Cloud, cloud(world));
    let mut harness = desk.shown();
    open_step(&mut harness, WorkflowStep::Geometry);
    assert!(harness.query_by_label(note).is_none());
    let other = Coordinates::chosen_with(5, false);
    let project = &mut harness.state_mut().project;
    project.results.insert(ResultKind::Cloud, cloud(other));
    harness.run_steps(2);
    harness.get_by_label(note);
}

#[test]
fn models_cannot_be_changed_while_cameras_are_computed() {
    let mut desk = with_models();
    desk.jobs = vec![crate::running::reconstruction()];
    let mut harness = desk.shown();
    open_step(&mut harness, WorkflowStep::Geometry);
    let second = harness.get_by_label(SECOND);
    assert!(second.accesskit_node().is_disabled());
}
