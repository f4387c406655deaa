//! Tests of the menus, the palette, and the reasons of disabled controls.

use egui::{Event, Key, Modifiers, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use ostra_app::{Action, Dialog, MenuName};
use ostra_masks::{Label, LabelId};
use ostra_session::Command;

use crate::desk::{Desk, advanced_steps, press};

const CTRL: Modifiers = Modifiers {
    ctrl: true,
    command: true,
    ..Modifiers::NONE
};
const NONE: Modifiers = Modifiers::NONE;

/// Largest number of entries of a menu.
const MOST: usize = 15;

fn open_menu(harness: &mut Harness<'_, Desk>, name: &str) {
    harness.get_all_by_label(name).next().unwrap().click();
    harness.run_steps(4);
}

/// Returns the number of buttons and switches.
fn controls(harness: &Harness<'_, Desk>) -> usize {
    let is_control = |role| matches!(role, Role::Button | Role::CheckBox);
    harness
        .root()
        .children_recursive()
        .filter(|node| is_control(node.accesskit_node().role()))
        .count()
}

#[test]
fn menus_have_at_most_fifteen_entries() {
    for menu in MenuName::BAR {
        let mut harness = Desk::sample().shown();
        let before = controls(&harness);
        open_menu(&mut harness, menu.text());
        let entries = controls(&harness) - before;
        assert!((1..=MOST).contains(&entries), "{menu:?}: {entries}");
    }
    for action in Action::all() {
        let Some(menu) = action.menu() else { continue };
        let entries = Action::all().filter(|other| other.menu() == Some(menu));
        assert!(entries.count() <= MOST, "{menu:?}");
        assert!(MenuName::BAR.contains(&menu.top()), "{action:?}");
    }
}

#[test]
fn entries_of_submenus_perform_their_actions() {
    let mut harness = Desk::sample().shown();
    open_menu(&mut harness, "View");
    open_menu(&mut harness, "Layout");
    harness
        .get_by_role_and_label(Role::CheckBox, "Image only")
        .click();
    harness.run_steps(3);
    assert_eq!(
        harness.state().shell.view.prefs.panes,
        ostra_app::Panes::Image
    );
}

fn desks() -> [Desk; 3] {
    let mut without_frames = Desk::empty();
    without_frames.root = Some("/projects/new".into());
    [Desk::empty(), without_frames, Desk::sample()]
}

#[test]
fn unavailable_actions_say_why_and_do_nothing() {
    for desk in desks() {
        let mut harness = desk.shown();
        harness.state_mut().shell.view.dialog = Some(Dialog::Palette);
        harness.run_steps(3);
        let mut unavailable = 0;
        for action in Action::all().filter(|action| *action != Action::Palette) {
            let text = match action {
                Action::Undo => continue,
                _ => action.text(),
            };
            // Other controls may have the same name; rows of the palette are the widest.
            let row = harness
                .get_all_by_role_and_label(Role::Button, &text)
                .max_by(|a, b| a.rect().width().total_cmp(&b.rect().width()))
                .unwrap();
            let node = row.accesskit_node();
            if !node.is_disabled() {
                continue;
            }
            unavailable += 1;
            let reason = node.description().unwrap_or_default();
            assert!(reason.len() > 8, "{action:?} is disabled without a reason");
            assert_ne!(reason, action.tip(), "{action:?}");
        }
        assert!(unavailable > 5, "some actions need what is not there");
        press(&mut harness, NONE, Key::Escape);
        harness.state_mut().requested.clear();
        press(&mut harness, CTRL | Modifiers::SHIFT, Key::Z);
        assert!(harness.state().requested.is_empty(), "nothing to redo");
    }
}

#[test]
fn disabled_entry_shows_its_reason_under_the_pointer() {
    let mut harness = Desk::sample().shown();
    open_menu(&mut harness, "Edit");
    assert!(
        harness
            .query_by_label("There is no undone step to redo")
            .is_none()
    );
    let at = harness
        .get_all_by_label("Redo")
        .max_by(|a, b| a.rect().top().total_cmp(&b.rect().top()))
        .unwrap()
        .rect()
        .center();
    harness.hover_at(at);
    harness.run_steps(6);
    harness.get_by_label("There is no undone step to redo");
}

/// Returns names and places of the disabled controls that are in sight.
fn disabled(harness: &Harness<'_, Desk>) -> Vec<(String, egui::Pos2)> {
    let window = egui::Rect::from_min_size(egui::Pos2::ZERO, harness.state().size);
    harness
        .root()
        .children_recursive()
        .filter(|node| node.accesskit_node().is_disabled())
        .filter(|node| node.accesskit_node().role() != Role::Label)
        .map(|node| {
            let name = node.accesskit_node().label().unwrap_or_default();
            (name, node.rect().center())
        })
        .filter(|(_, at)| window.contains(*at))
        .collect()
}

/// Returns all texts in sight.
fn texts(harness: &Harness<'_, Desk>) -> usize {
    let is_text = |role| matches!(role, Role::Label | Role::Tooltip);
    let nodes = harness.root().children_recursive();
    nodes
        .filter(|node| is_text(node.accesskit_node().role()))
        .count()
}

fn assert_all_explained(harness: &mut Harness<'_, Desk>, screen: &str) -> usize {
    let found = disabled(harness);
    for (name, at) in &found {
        harness.hover_at(egui::Pos2::new(1.0, 899.0));
        harness.run_steps(3);
        let before = texts(harness);
        harness.hover_at(*at);
        harness.run_steps(6);
        assert!(
            texts(harness) > before,
            "{screen}: '{name}' is disabled and does not say why"
        );
    }
    found.len()
}

#[test]
fn every_disabled_control_says_why() {
    let mut count = 0;
    for (step, mut harness) in advanced_steps() {
        count += assert_all_explained(&mut harness, &format!("{step:?}"));
    }
    for dialog in [
        Dialog::NewProject,
        Dialog::Export,
        Dialog::Image,
        Dialog::Relocate,
        Dialog::Preferences,
        Dialog::Shortcuts,
        Dialog::Models,
    ] {
        let mut harness = Desk::sample().shown();
        harness.state_mut().shell.view.dialog = Some(dialog);
        harness.run_steps(4);
        // What is behind the dialog does not answer to the pointer.
        let behind: Vec<_> = disabled(&Desk::sample().shown());
        let names: Vec<String> = behind.into_iter().map(|(name, _)| name).collect();
        let found = disabled(&harness);
        for (name, at) in found.iter().filter(|(name, _)| !names.contains(name)) {
            let before = texts(&harness);
            harness.hover_at(*at);
            harness.run_steps(6);
            assert!(texts(&harness) > before, "{dialog:?}: {name}");
            harness.hover_at(egui::Pos2::new(1.0, 899.0));
            harness.run_steps(3);
            count += 1;
        }
    }
    assert!(count > 10, "there are disabled controls to test: {count}");
}

#[test]
fn switches_in_menus_have_a_tick_while_they_are_on() {
    let mut harness = Desk::sample().shown();
    for (menus, name) in [
        (&["View"][..], "Show masks"),
        (&["View"], "Dark theme"),
        (&["View", "3-D view"], "Orthographic"),
        (&["View", "Layout"], "Stack panes"),
        (&["Edit", "Tools"], "Brush tool"),
    ] {
        let mut is_ticked = || {
            menus.iter().for_each(|menu| open_menu(&mut harness, menu));
            let entry = harness.get_by_role_and_label(Role::CheckBox, name);
            let toggled = entry.accesskit_node().toggled();
            entry.click();
            harness.run_steps(4);
            press(&mut harness, NONE, Key::Escape);
            toggled == Some(egui::accesskit::Toggled::True)
        };
        let before = is_ticked();
        assert_ne!(is_ticked(), before, "{name}");
    }
}

fn open_palette(harness: &mut Harness<'_, Desk>, typed: &str) {
    press(harness, CTRL, Key::P);
    harness.event(Event::Text(typed.into()));
    harness.run_steps(2);
}

#[test]
fn arrow_keys_move_through_the_palette() {
    let mut harness = Desk::sample().shown();
    open_palette(&mut harness, "10 frames");
    press(&mut harness, NONE, Key::ArrowUp);
    for _ in 0..9 {
        press(&mut harness, NONE, Key::ArrowDown);
    }
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Palette));
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(harness.state().shell.view.dialog, None);
    assert_eq!(
        harness.state().shell.view.frame,
        10,
        "'10 frames forward' is the last row"
    );
    open_palette(&mut harness, "10 frames");
    press(&mut harness, NONE, Key::ArrowDown);
    press(&mut harness, NONE, Key::ArrowUp);
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(harness.state().shell.view.frame, 0, "'10 frames back'");
}

#[test]
fn palette_keeps_open_at_an_unavailable_action() {
    let mut harness = Desk::sample().shown();
    open_palette(&mut harness, "redo");
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(harness.state().shell.view.dialog, Some(Dialog::Palette));
    assert!(harness.state().requested.is_empty());
    harness.event(Event::Text("xyz".into()));
    harness.run_steps(2);
    harness.get_by_label("No action contains these words");
}

#[test]
fn renaming_a_label_replaces_its_old_name() {
    let mut harness = Desk::sample().shown();
    let leaf = harness.state().project.labels.by_name("leaf").unwrap();
    let (id, name) = (leaf.id, leaf.name.clone());
    let renamed = Label {
        name: "blade".into(),
        ..leaf.clone()
    };
    harness.state_mut().shell.view.labels.rename(id, &name);
    harness.run_steps(3);
    harness.event(Event::Text("blade".into()));
    harness.run_steps(2);
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(harness.state().requested, [Command::EditLabel(renamed)]);
}

#[test]
fn key_switches_between_the_last_two_labels() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, NONE, Key::Num3);
    press(&mut harness, NONE, Key::Num2);
    let mut back = || {
        press(&mut harness, NONE, Key::Minus);
        harness.state().shell.view.label
    };
    assert_eq!(back(), Some(LabelId(3)));
    assert_eq!(back(), Some(LabelId(2)));
    assert_eq!(back(), Some(LabelId(3)));
}
