//! Tests of point selection and correction in the 3-D view.

use std::sync::Arc;

use egui::{Event, Key, Modifiers, PointerButton, Pos2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ostra_app::SelectShape;
use ostra_cloud::fuse::Votes;
use ostra_cloud::select::{Eye, SeenRegion, SelectStep, Selection, Selector};
use ostra_masks::LabelId;
use ostra_project::ResultKind;
use ostra_session::{AttachRequest, CloudChange, CloudCorrection, Command};

use crate::desk::{Desk, drag, drag_fast, press};

fn desk() -> Harness<'static, Desk> {
    Desk {
        votes: Some(Arc::new(Votes::default())),
        ..Desk::sample()
    }
    .shown()
}

/// Returns the middle of the 3-D view.
fn middle(harness: &Harness<'_, Desk>) -> Pos2 {
    harness.get_by_label("3-D view").rect().center()
}

/// Draws along `places` with the primary button.
fn draw(harness: &mut Harness<'_, Desk>, places: &[Pos2], modifiers: Modifiers) {
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers,
    };
    harness.hover_at(places[0]);
    harness.run_steps(1);
    harness.event(button(places[0], true));
    harness.run_steps(1);
    for &place in &places[1..] {
        harness.hover_at(place);
        harness.run_steps(1);
    }
    harness.event_modifiers(button(places[places.len() - 1], false), modifiers);
    harness.run_steps(2);
}

fn around(middle: Pos2, reach: f32) -> [Pos2; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| middle + egui::vec2(x, y) * reach)
}

/// Returns the selection that a session would find.
fn find(harness: &mut Harness<'_, Desk>) -> Arc<Selection> {
    let desk = harness.state_mut();
    let selector = Selector::new(desk.cloud.clone().unwrap()).unwrap();
    let steps = &desk.shell.view.scene_select.steps;
    let progress = ostra_core::job::Progress::default();
    let found = selector
        .select(&desk.project.frames, &desk.project.labels, steps, &progress)
        .unwrap();
    let found = Arc::new(found);
    desk.chosen = Some(Arc::clone(&found));
    harness.run_steps(2);
    found
}

fn steps(harness: &Harness<'_, Desk>) -> Vec<SelectStep> {
    harness.state().shell.view.scene_select.steps.clone()
}

#[test]
fn lasso_in_the_view_requests_the_correction() {
    let mut harness = desk();
    assert!(harness.query_by_label("Lasso").is_none());
    harness.get_by_label("Select").click();
    harness.run_steps(4);
    assert!(
        harness
            .query_by_label("Draw around visible points")
            .is_some()
    );
    let at = middle(&harness);
    draw(&mut harness, &around(at, 40.0), Modifiers::NONE);
    let select = steps(&harness);
    let [
        SelectStep::Seen(SeenRegion {
            eye: Eye::Free { .. },
            points_px,
            remove: false,
            ..
        }),
    ] = &select[..]
    else {
        panic!("one lasso: {select:?}")
    };
    assert_eq!(points_px.len(), 4);
    let found = find(&mut harness);
    assert!(
        (4..300).contains(&found.points.len()),
        "a part of the cloud: {}",
        found.points.len()
    );
    assert!(
        harness
            .query_by_label_contains(&format!("{} points", found.points.len()))
            .is_some()
    );
    harness.state_mut().shell.view.label = Some(LabelId(3));
    harness.run_steps(2);
    harness.get_by_label("As keyframes").click();
    harness.run_steps(2);
    harness.get_by_label("Assign to pot").click();
    harness.run_steps(2);
    let correction = CloudCorrection {
        select,
        change: CloudChange::Assign(LabelId(3)),
        as_keyframes: true,
    };
    assert_eq!(
        harness.state().requested,
        [Command::CorrectCloud(correction)]
    );
    assert!(
        steps(&harness).is_empty(),
        "what was corrected is chosen no more"
    );
}

#[test]
fn lasso_keeps_its_shape_while_frames_are_slow() {
    let mut harness = desk();
    press(&mut harness, Modifiers::SHIFT, Key::S);
    let at = middle(&harness);
    for shape in [SelectShape::Lasso, SelectShape::Brush] {
        harness.state_mut().shell.view.scene_select.shape = shape;
        let around: Vec<Pos2> = (0..24)
            .map(|k| at + 60.0 * egui::Vec2::angled(std::f32::consts::TAU * k as f32 / 24.0))
            .collect();
        drag_fast(&mut harness, &around, PointerButton::Primary);
        let drawn = steps(&harness);
        let [SelectStep::Seen(SeenRegion { points_px, .. })] = &drawn[..] else {
            panic!("{shape:?}: {drawn:?}")
        };
        assert_eq!(
            points_px.len(),
            around.len(),
            "{shape:?}: a corner for each place"
        );
    }
}

#[test]
fn selection_ends_when_the_cloud_is_removed() {
    let mut harness = desk();
    press(&mut harness, Modifiers::SHIFT, Key::S);
    let at = middle(&harness);
    draw(&mut harness, &around(at, 40.0), Modifiers::NONE);
    harness.get_by_label("Selecting…");
    harness.state_mut().cloud = None;
    harness
        .state_mut()
        .project
        .results
        .remove(&ResultKind::Cloud);
    harness.run_steps(3);
    assert!(harness.query_by_label("Selecting…").is_none());
    harness.get_by_label_contains("There is no cloud");
}

#[test]
fn modifiers_add_and_subtract_and_escape_undoes_step_by_step() {
    let mut harness = desk();
    press(&mut harness, Modifiers::SHIFT, Key::S);
    let at = middle(&harness);
    draw(&mut harness, &around(at, 60.0), Modifiers::NONE);
    let whole = find(&mut harness).points.len();
    harness.state_mut().shell.view.scene_select.shape = SelectShape::Box;
    let ctrl = Modifiers {
        ctrl: true,
        command: true,
        ..Modifiers::NONE
    };
    draw(
        &mut harness,
        &[at - egui::vec2(70.0, 70.0), at + egui::vec2(0.0, 70.0)],
        ctrl,
    );
    let half = find(&mut harness).points.len();
    assert!(half > 0 && half < whole, "{half} of {whole}");
    assert_eq!(steps(&harness).len(), 2);
    harness.get_by_label("Undo selection").click();
    harness.run_steps(2);
    assert_eq!(steps(&harness).len(), 1);
    drag(
        &mut harness,
        at,
        at + egui::vec2(30.0, 0.0),
        PointerButton::Primary,
    );
    assert_eq!(
        steps(&harness).len(),
        1,
        "a new one takes the place of the old"
    );
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(steps(&harness).is_empty() && harness.state().shell.view.scene_select.in_hand);
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(!harness.state().shell.view.scene_select.in_hand);
    assert!(harness.state().requested.is_empty());
}

#[test]
fn selection_grows_and_is_split_and_cleared() {
    let mut harness = desk();
    press(&mut harness, Modifiers::SHIFT, Key::S);
    let at = middle(&harness);
    harness.state_mut().shell.view.scene_select.shape = SelectShape::Brush;
    draw(
        &mut harness,
        &[at, at + egui::vec2(20.0, 0.0)],
        Modifiers::NONE,
    );
    let few = find(&mut harness).points.len();
    harness.get_by_label("Grow").click();
    harness.run_steps(2);
    let grown = find(&mut harness).points.len();
    assert!(few > 0 && grown > few, "{few} to {grown}");
    harness.state_mut().shell.view.label = Some(LabelId(2));
    harness.run_steps(2);
    harness.get_by_label("Only leaf").click();
    harness.run_steps(2);
    find(&mut harness);
    press(&mut harness, Modifiers::SHIFT, Key::Backspace);
    let requested = &harness.state().requested;
    let [
        Command::CorrectCloud(CloudCorrection {
            select,
            change: CloudChange::Clear,
            as_keyframes: false,
        }),
    ] = &requested[..]
    else {
        panic!("{requested:?}")
    };
    assert!(matches!(
        select[..],
        [
            SelectStep::Seen(_),
            SelectStep::Grow(_),
            SelectStep::Only(LabelId(2))
        ]
    ));
}

#[test]
fn loose_fragments_are_attached_only_with_known_votes() {
    let requested = |mut harness: Harness<'_, Desk>| {
        press(
            &mut harness,
            Modifiers {
                ctrl: true,
                ..Modifiers::COMMAND
            },
            Key::P,
        );
        harness.event(Event::Text("attach".into()));
        harness.run_steps(2);
        press(&mut harness, Modifiers::NONE, Key::Enter);
        harness.state().requested.clone()
    };
    assert_eq!(
        requested(desk()),
        [Command::Attach(AttachRequest::default())]
    );
    assert_eq!(
        requested(
            Desk {
                votes: None,
                ..Desk::sample()
            }
            .shown()
        ),
        []
    );
}
