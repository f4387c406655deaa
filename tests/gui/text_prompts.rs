//! Tests of finding objects by text.

use egui_kittest::kittest::{NodeT, Queryable};
use glam::DVec2;
use ostra_masks::PxBox;
use ostra_project::SegmenterId;
use ostra_project::workflow::WorkflowStep;
use ostra_session::{Command, EngineKind, FindByTextRequest, FoundThing, Grounding, TakeRequest};

use crate::desk::{Desk, open_step, press};

/// Returns a desk with or without an installed grounder.
fn desk(installed: bool) -> Desk {
    let mut desk = Desk::sample();
    for engine in desk
        .engines
        .iter_mut()
        .filter(|engine| engine.kind == EngineKind::Grounder)
    {
        engine.installed = installed;
    }
    desk
}

#[test]
fn search_by_text_is_disabled_without_a_network() {
    let mut harness = desk(false).shown();
    open_step(&mut harness, WorkflowStep::Label);
    let is_disabled = |label| harness.get_by_label(label).accesskit_node().is_disabled();
    assert!(is_disabled("Find"));
    assert!(
        !is_disabled("Text to find"),
        "typed while a network is being installed"
    );
}

#[test]
fn enter_searches_nothing_without_a_network() {
    let mut harness = desk(false).shown();
    open_step(&mut harness, WorkflowStep::Label);
    harness.get_by_label("Text to find").focus();
    harness.run_steps(2);
    harness.get_by_label("Text to find").type_text("leaf");
    harness.run_steps(2);
    press(&mut harness, egui::Modifiers::NONE, egui::Key::Enter);
    assert!(harness.state().requested.is_empty());
}

#[test]
fn found_objects_are_taken_one_by_one_or_all_at_once() {
    let mut harness = desk(true).shown();
    open_step(&mut harness, WorkflowStep::Label);
    harness.get_by_label("Text to find").focus();
    harness.run_steps(2);
    harness
        .get_by_label("Text to find")
        .type_text("leaf; stem ;");
    harness.run_steps(2);
    harness.get_by_label("Find").click();
    harness.run_steps(2);
    let phrases = vec!["leaf".to_owned(), "stem".to_owned()];
    let ground = FindByTextRequest {
        frame: 0,
        phrases,
        threshold: Some(0.1),
        grounder: ostra_project::GrounderId::Auto,
    };
    assert_eq!(harness.state().requested, [Command::Ground(ground)]);

    let extent = |x: f64| PxBox {
        min_px: DVec2::new(x, 2.0),
        max_px: DVec2::new(x + 8.0, 20.0),
    };
    let thing = |phrase: &str, score, x| FoundThing {
        phrase: phrase.into(),
        extent: extent(x),
        score,
    };
    let things = vec![
        thing("leaf", 0.9, 3.0),
        thing("stem", 0.4, 20.0),
        thing("leaf", 0.2, 40.0),
    ];
    harness.state_mut().grounding = Some(Grounding {
        frame: 0,
        grounder: "yolox",
        things,
    });
    harness.run_steps(2);
    assert!(
        harness.query_by_label("Add leaf 3").is_none(),
        "not as sure as asked for"
    );
    harness.get_by_label("Add stem 2").click();
    harness.run_steps(2);
    harness.get_by_label("Add all").click();
    harness.run_steps(2);
    let take = |things| {
        Command::TakeFound(TakeRequest {
            frame: 0,
            things,
            segmenter: SegmenterId::Auto,
        })
    };
    let stem = ("stem".to_owned(), extent(20.0));
    let all = vec![("leaf".to_owned(), extent(3.0)), stem.clone()];
    assert_eq!(
        harness.state().requested[1..],
        [take(vec![stem]), take(all)]
    );
    harness.state_mut().shell.view.text_prompt.least = 0.1;
    harness.run_steps(2);
    assert!(harness.query_by_label("Add leaf 3").is_some());
    harness.state_mut().shell.view.go_to(1);
    harness.run_steps(2);
    assert!(harness.query_by_label("Add all").is_none(), "another frame");
}
