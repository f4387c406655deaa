//! Tests of the keyboard shortcuts.

use std::time::Duration;

use egui::{Key, Modifiers, PointerButton};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use ostra_app::{Action, Dialog, Layers, Shortcuts};
use ostra_core::job::JobId;
use ostra_core::job::{Overview, ProgressReport};
use ostra_masks::{Direction, LabelId};
use ostra_session::Command;
use ostra_session::JobView;
use ostra_view::Layer;

use crate::desk::{Desk, choose_more, click_at, on_screen, press};

const CTRL: Modifiers = Modifiers {
    ctrl: true,
    command: true,
    ..Modifiers::NONE
};

#[test]
fn digits_select_labels_in_list_order() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::Num3);
    assert_eq!(harness.state().shell.view.label, Some(LabelId(3)));
    press(&mut harness, Modifiers::NONE, Key::Num2);
    assert_eq!(harness.state().shell.view.label, Some(LabelId(2)));
    press(&mut harness, Modifiers::NONE, Key::Num9);
    assert_eq!(
        harness.state().shell.view.label,
        Some(LabelId(2)),
        "there is no ninth"
    );
}

#[test]
fn shift_h_fills_holes_and_shift_k_removes_islands_of_the_size_in_the_tool_bar() {
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.prefs.tidy_px = 30;
    press(&mut harness, Modifiers::NONE, Key::Num2);
    press(&mut harness, Modifiers::SHIFT, Key::H);
    press(&mut harness, Modifiers::SHIFT, Key::K);
    choose_more(&mut harness, "Fill holes of label");
    let tidied: Vec<_> = harness
        .state()
        .requested
        .iter()
        .map(|command| match command {
            Command::Clean(request) => (
                request.frame,
                request.label,
                request.holes_below_px,
                request.islands_below_px,
            ),
            other => panic!("{other:?}"),
        })
        .collect();
    assert_eq!(
        tidied,
        [
            (0, LabelId(2), 30, 0),
            (0, LabelId(2), 0, 30),
            (0, LabelId(2), 30, 0)
        ]
    );
    harness.get_by_label("More image tools").click();
    harness.run_steps(3);
    harness.get_by_label("Size of holes and specks");
    press(&mut harness, Modifiers::NONE, Key::Escape);
    harness.state_mut().requested.clear();
    press(&mut harness, Modifiers::NONE, Key::End);
    press(&mut harness, Modifiers::SHIFT, Key::H);
    assert!(
        harness.state().requested.is_empty(),
        "a frame without a mask has nothing to tidy"
    );
}

#[test]
fn arrows_move_through_the_frames() {
    let mut harness = Desk::sample().shown();
    let mut at = |modifiers, key| {
        press(&mut harness, modifiers, key);
        harness.state().shell.view.frame
    };
    assert_eq!(at(Modifiers::NONE, Key::ArrowRight), 1);
    assert_eq!(at(Modifiers::SHIFT, Key::ArrowRight), 11);
    assert_eq!(at(Modifiers::NONE, Key::ArrowRight), 11);
    assert_eq!(at(Modifiers::NONE, Key::ArrowLeft), 10);
    assert_eq!(at(Modifiers::NONE, Key::Home), 0);
    assert_eq!(at(Modifiers::NONE, Key::End), 11);
}

#[test]
fn d_goes_to_stale_or_uncertain_frames() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::D);
    assert_eq!(harness.state().shell.view.frame, 2);
    press(&mut harness, Modifiers::NONE, Key::D);
    assert_eq!(harness.state().shell.view.frame, 5);
}

#[test]
fn undo_track_and_make_keyframe_by_key() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, CTRL, Key::Z);
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    press(&mut harness, Modifiers::NONE, Key::C);
    press(&mut harness, Modifiers::NONE, Key::F);
    let requested = &harness.state().requested;
    assert_eq!(requested[0], Command::Undo);
    assert_eq!(requested[1], Command::MakeKeyframe { frame: 1 });
    let Command::Track(settings) = &requested[2] else {
        panic!("{requested:?}")
    };
    assert_eq!(
        (settings.from, settings.direction),
        (Some(1), Direction::Forward)
    );
    press(&mut harness, CTRL | Modifiers::SHIFT, Key::Z);
    assert_eq!(
        harness.state().requested.len(),
        3,
        "there is nothing to redo"
    );
}

#[test]
fn q_and_e_click_at_the_pointer() {
    let mut harness = Desk::sample().shown();
    let at = on_screen(&harness, 30.5, 20.5);
    harness.hover_at(at);
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::E);
    let Command::Prompt(request) = &harness.state().requested[0] else {
        panic!()
    };
    assert!(!request.prompt.clicks[0].include);
}

#[test]
fn keys_type_text_while_a_field_has_focus() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("New label name").focus();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::ArrowRight);
    press(&mut harness, Modifiers::NONE, Key::F);
    assert_eq!(harness.state().shell.view.frame, 0);
    assert!(harness.state().requested.is_empty());
}

#[test]
fn shortcut_sheet_shows_no_conflicts_and_changes_keys() {
    assert_eq!(Shortcuts::default().conflicts(), []);
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::SHIFT, Key::Questionmark);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Shortcuts));
    harness.get_by_label("Shortcut of Fuse: U").scroll_to_me();
    harness.run_steps(4);
    harness.get_by_label("Shortcut of Fuse: U").click();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::F6);
    assert!(harness.query_by_label("Shortcut of Fuse: F6").is_some());
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert_eq!(harness.state().shell.view.dialog, None);
    press(&mut harness, Modifiers::NONE, Key::F6);
    assert!(matches!(harness.state().requested[..], [Command::Fuse(_)]));
}

#[test]
fn shortcut_sheet_names_the_action_that_lost_its_keys() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::SHIFT, Key::Questionmark);
    harness.get_by_label("Shortcut of Fuse: U").scroll_to_me();
    harness.run_steps(4);
    harness.get_by_label("Shortcut of Fuse: U").click();
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::D);
    assert!(
        harness
            .query_by_label("'Next frame to check' had this shortcut and has none now")
            .is_some()
    );
    assert!(
        harness
            .query_by_label("Shortcut of Next frame to check: ")
            .is_some()
    );
}

#[test]
fn palette_finds_and_runs_actions() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, CTRL, Key::P);
    harness.event(egui::Event::Text("reconstr".into()));
    harness.run_steps(2);
    press(&mut harness, Modifiers::NONE, Key::Enter);
    assert!(
        matches!(harness.state().requested[..], [Command::Reconstruct(_)]),
        "{:?}",
        harness.state().requested
    );
    assert_eq!(harness.state().shell.view.dialog, None);
}

#[test]
fn every_action_is_in_a_menu_or_has_keys() {
    for action in Action::all() {
        assert!(
            action.menu().is_some() || action.default_keys().is_some(),
            "{action:?}"
        );
    }
}

#[test]
fn click_after_undo_builds_on_the_current_prompt() {
    let mut harness = Desk::sample().shown();
    let at = on_screen(&harness, 30.5, 20.5);
    click_at(&mut harness, at, PointerButton::Primary);
    press(&mut harness, CTRL, Key::Z);
    click_at(&mut harness, at, PointerButton::Secondary);
    let Some(Command::Prompt(request)) = harness.state().requested.last() else {
        panic!()
    };
    assert_eq!(
        request.prompt.clicks.len(),
        1,
        "the click taken back does not come again"
    );
}

#[test]
fn key_shows_depth_normals_and_confidence_instead_of_the_image() {
    let mut desk = Desk::sample();
    let (reported, requested) = std::sync::mpsc::channel();
    desk.layers = Some(Layers::new(
        move |key: &(usize, Layer)| {
            reported.send(*key).unwrap();
            Ok(None)
        },
        || {},
    ));
    let mut harness = desk.shown();
    let shown = |harness: &Harness<'_, Desk>| harness.state().shell.view.layer;
    for layer in [Layer::Depth, Layer::Normals, Layer::Confidence] {
        press(&mut harness, Modifiers::NONE, Key::F7);
        assert_eq!(shown(&harness), layer);
        harness.get_by_role_and_label(egui::Role::ComboBox, "Shown layer");
        assert_eq!(
            requested
                .recv_timeout(std::time::Duration::from_secs(60))
                .unwrap(),
            (0, layer),
            "it is drawn"
        );
    }
    press(&mut harness, Modifiers::NONE, Key::F7);
    assert_eq!(shown(&harness), Layer::Image);
}

/// Returns a job that has run for three minutes.
fn long_job() -> JobView {
    let report = ProgressReport {
        stage: "match".into(),
        done: 56,
        total: 100,
    };
    JobView {
        id: JobId(7),
        title: "Reconstruct".into(),
        task: Some(ostra_session::JobTask::Reconstruct),
        report,
        overview: Overview::default(),
        elapsed: Duration::from_secs(180),
    }
}

fn busy() -> Desk {
    Desk {
        jobs: vec![long_job()],
        ..Desk::sample()
    }
}

#[test]
fn escape_never_stops_a_job() {
    let mut harness = busy().shown();
    let escape = |harness: &mut Harness<'_, Desk>, what: &str| {
        press(harness, Modifiers::NONE, Key::Escape);
        harness.run_steps(4);
        assert!(
            harness.state().requested.is_empty(),
            "{what}: {:?}",
            harness.state().requested
        );
    };
    escape(&mut harness, "nothing is open");
    for menu in ["Edit", "View", "Run"] {
        harness.get_all_by_label(menu).next().unwrap().click();
        harness.run_steps(4);
        escape(&mut harness, menu);
    }
    for dialog in [
        Dialog::Export,
        Dialog::Models,
        Dialog::Shortcuts,
        Dialog::Palette,
        Dialog::Image,
    ] {
        harness.state_mut().shell.view.dialog = Some(dialog);
        harness.run_steps(4);
        escape(&mut harness, &format!("{dialog:?}"));
        assert_eq!(harness.state().shell.view.dialog, None, "{dialog:?}");
    }
    harness
        .get_by_role_and_label(egui::Role::ComboBox, "Shown layer")
        .click();
    harness.run_steps(4);
    escape(&mut harness, "a list");
    harness.get_by_label("New label name").focus();
    harness.run_steps(2);
    escape(&mut harness, "a text field");
    for key in [Key::F6, Key::F8] {
        press(&mut harness, Modifiers::NONE, key);
        escape(&mut harness, "a window");
    }
    (0..3).for_each(|_| escape(&mut harness, "again and again"));
}

#[test]
fn escape_that_closes_a_menu_keeps_the_unfinished_polygon() {
    let mut harness = busy().shown();
    press(&mut harness, Modifiers::NONE, Key::G);
    for (x, y) in [(10.0, 10.0), (30.0, 12.0), (24.0, 30.0)] {
        let at = on_screen(&harness, x, y);
        click_at(&mut harness, at, PointerButton::Primary);
    }
    assert!(
        harness.state().shell.view.draft.is_half_made(),
        "{:?}",
        harness.state().shell.view.tool
    );
    harness.get_all_by_label("Edit").next().unwrap().click();
    harness.run_steps(4);
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(
        harness.state().shell.view.draft.is_half_made(),
        "the menu is closed, and no more"
    );
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(!harness.state().shell.view.draft.is_half_made());
    assert!(
        harness.state().requested.is_empty(),
        "{:?}",
        harness.state().requested
    );
}

#[test]
fn button_and_keys_stop_a_job() {
    let mut harness = busy().shown();
    press(&mut harness, CTRL, Key::Period);
    assert_eq!(harness.state().requested, [Command::Stop]);
    harness.get_by_label("Stop running job").click();
    harness.run_steps(2);
    assert_eq!(harness.state().requested, [Command::Stop, Command::Stop]);
}
