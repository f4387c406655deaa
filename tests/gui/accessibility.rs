//! Tests of names, roles and the keyboard on every screen.

use egui::accesskit::Action as NodeAction;
use egui::{Key, Modifiers, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::DVec2;
use ostra_app::{Dialog, HelpPage};
use ostra_project::workflow::WorkflowStep;
use ostra_session::Command;

use crate::desk::{Desk, advanced_steps, on_screen, open_step, press};

const NONE: Modifiers = Modifiers::NONE;

/// Units, which egui takes as the name of a number that is followed by one.
const UNITS: [&str; 5] = ["px", "%", "s", "°", "frames per second"];

/// Returns the controls without a role or a name.
fn nameless(harness: &Harness<'_, Desk>) -> Vec<String> {
    let unnamed = harness.unnamed_widgets().into_iter();
    let nodes = harness.root().children_recursive();
    let other = nodes.filter_map(|node| {
        let node = node.accesskit_node();
        let data = node.data();
        let is_control = data.supports_action(NodeAction::Click);
        let has_role = !matches!(data.role(), Role::Unknown | Role::GenericContainer);
        let is_unit = node
            .label()
            .is_some_and(|name| UNITS.contains(&name.trim()));
        let has_name = node.label().is_some_and(|name| !name.trim().is_empty())
            || node.value().is_some_and(|value| !value.trim().is_empty())
            || data.placeholder().is_some();
        // Scroll bars of egui and splitters of egui_tiles have none, and the program cannot give them
        // any; keys scroll and resize by other controls.
        let is_thin = node
            .raw_bounds()
            .is_some_and(|rect| rect.width().min(rect.height()) <= 6.0);
        let is_foreign = data.role() == Role::ScrollBar || data.role() == Role::Unknown && is_thin;
        let is_concerned = is_control && !is_foreign && !node.is_hidden();
        let is_wrong = is_concerned && !(has_role && has_name && !is_unit);
        is_wrong.then(|| format!("{:?} at {:?}", data.role(), node.raw_bounds()))
    });
    unnamed.chain(other).collect()
}

fn check(harness: &Harness<'_, Desk>, screen: &str) {
    let count = harness
        .root()
        .children_recursive()
        .filter(|node| {
            node.accesskit_node()
                .data()
                .supports_action(NodeAction::Click)
        })
        .count();
    assert!(count > 8, "{screen} has controls: {count}");
    assert_eq!(nameless(harness), Vec::<String>::new(), "{screen}");
}

#[test]
fn every_control_of_every_screen_has_a_name_and_a_role() {
    let mut first = Desk::empty();
    first.recent = vec!["/projects/tiller".into()];
    let mut harness = first.shown();
    check(&harness, "first page");
    harness.state_mut().shell.view.dialog = Some(Dialog::NewProject);
    harness.run_steps(4);
    check(&harness, "new project");
    for (step, mut harness) in advanced_steps() {
        let view = &mut harness.state_mut().shell.view;
        view.reconstruct.max_side = Some(1600);
        view.fuse.voxel = Some(0.005);
        view.track.short_side = Some(480);
        harness.run_steps(4);
        check(&harness, &format!("{step:?}"));
    }
    let mut harness = Desk::sample().shown();
    open_step(&mut harness, WorkflowStep::Measure);
    harness.state_mut().shell.view.measures.open = true;
    harness.run_steps(4);
    check(&harness, "Measure");
    for dialog in [
        Dialog::Export,
        Dialog::Preferences,
        Dialog::Shortcuts,
        Dialog::Models,
        Dialog::Image,
        Dialog::Relocate,
        Dialog::AddFrames,
        Dialog::Palette,
        Dialog::Help(HelpPage::Guide),
        Dialog::Help(HelpPage::About),
    ] {
        let mut harness = Desk::sample().shown();
        harness.state_mut().shell.view.dialog = Some(dialog);
        harness.run_steps(4);
        check(&harness, &format!("{dialog:?}"));
    }
    let mut harness = Desk::sample().shown();
    harness.state_mut().shell.view.scene_select.in_hand = true;
    harness.run_steps(4);
    check(&harness, "selection of points");
    for menu in ["File", "Edit", "Range", "View", "Go", "Run", "Help"] {
        let mut harness = Desk::sample().shown();
        harness.get_all_by_label(menu).next().unwrap().click();
        harness.run_steps(4);
        check(&harness, menu);
    }
}

#[test]
fn menus_are_reached_and_used_by_keys_alone() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, NONE, Key::F10);
    let file = harness.get_all_by_label("File").next().unwrap();
    assert!(file.is_focused());
    press(&mut harness, NONE, Key::Enter);
    harness.run_steps(3);
    harness.get_by_label("New project…");
    press(&mut harness, NONE, Key::ArrowDown);
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(
        harness.state().shell.view.dialog,
        Some(Dialog::NewProject),
        "the first entry was performed"
    );
}

/// Returns the names of the controls that Shift+Tab reaches, until one comes again.
fn tour(harness: &mut Harness<'_, Desk>) -> Vec<String> {
    let mut seen = Vec::new();
    for _ in 0..400 {
        press(harness, Modifiers::SHIFT, Key::Tab);
        let nodes = harness.root().children_recursive();
        let focused = nodes.into_iter().find(egui_kittest::Node::is_focused);
        let Some(focused) = focused else { continue };
        let node = focused.accesskit_node();
        let name = format!("{:?} {}", node.id(), node.label().unwrap_or_default());
        if seen.contains(&name) {
            break;
        }
        seen.push(name);
    }
    seen
}

#[test]
fn tab_reaches_every_kind_of_control() {
    let mut harness = Desk::sample().shown();
    let reached = tour(&mut harness);
    for name in [
        "File",
        "Brush",
        "leaf",
        "Hide leaf",
        "More for leaf",
        "New label name",
        "Export…",
        "Image 000.png",
        "Brightness and contrast",
        "3-D view",
    ] {
        assert!(
            reached.iter().any(|one| one.ends_with(name)),
            "{name} is not among {reached:?}"
        );
    }
}

/// Returns the rectangles of rings: strokes of two points without a fill.
fn rings(harness: &Harness<'_, Desk>) -> Vec<egui::Rect> {
    let shapes = harness.output().shapes.iter();
    shapes
        .filter_map(|shape| match &shape.shape {
            egui::Shape::Rect(rect) if rect.stroke.width == 2.0 => Some(rect.rect),
            _ => None,
        })
        .collect()
}

#[test]
fn ring_marks_the_control_that_tab_reaches() {
    let mut harness = Desk::sample().shown();
    let before = rings(&harness).len();
    press(&mut harness, NONE, Key::F10);
    let file = harness.get_all_by_label("File").next().unwrap().rect();
    let around = |harness: &Harness<'_, Desk>| {
        rings(harness)
            .iter()
            .any(|ring| ring.contains_rect(file) && ring.area() < 2.0 * file.area())
    };
    assert!(around(&harness));
    press(&mut harness, NONE, Key::Tab);
    assert!(!around(&harness), "it moves with the keyboard");
    assert_eq!(rings(&harness).len(), before + 1);
    harness.hover_at(egui::pos2(700.0, 450.0));
    harness.drag_at(egui::pos2(700.0, 450.0));
    harness.run_steps(2);
    assert_eq!(rings(&harness).len(), before, "the pointer needs no ring");
}

/// Returns the places and kinds of the clicks that were requested.
fn clicks(harness: &Harness<'_, Desk>) -> Vec<(DVec2, bool)> {
    let prompts = harness.state().requested.iter();
    let clicks = prompts.filter_map(|command| match command {
        Command::Prompt(request) => request.prompt.clicks.last().copied(),
        _ => None,
    });
    clicks.map(|click| (click.at_px, click.include)).collect()
}

#[test]
fn objects_are_labelled_by_keys_alone() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Image 000.png").focus();
    harness.run_steps(2);
    let middle = DVec2::new(32.5, 24.5);
    assert_eq!(harness.state().shell.view.pointer_px, Some(middle));
    press(&mut harness, Modifiers::SHIFT, Key::ArrowRight);
    press(&mut harness, Modifiers::SHIFT, Key::ArrowUp);
    assert_eq!(harness.state().shell.view.frame, 0, "the frame stays");
    let diagonal = middle + DVec2::new(1.0, -1.0);
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(clicks(&harness), [(diagonal, true)]);
    press(&mut harness, NONE, Key::ArrowLeft);
    let far = harness.state().shell.view.pointer_px.unwrap();
    assert!(far.x < diagonal.x && far.y == diagonal.y, "{far}");
    press(&mut harness, NONE, Key::E);
    assert_eq!(clicks(&harness).last(), Some(&(far, false)));
    for _ in 0..100 {
        press(&mut harness, NONE, Key::ArrowLeft);
    }
    let edge = DVec2::new(0.5, far.y);
    assert_eq!(harness.state().shell.view.pointer_px, Some(edge));
    assert_eq!(harness.state().shell.view.frame, 0, "the frame stays");

    press(&mut harness, NONE, Key::Escape);
    press(&mut harness, NONE, Key::ArrowRight);
    assert_eq!(harness.state().shell.view.frame, 1, "the image let it go");
    assert_eq!(harness.state().shell.view.pointer_px, None);
}

#[test]
fn mouse_takes_the_pointer_back_from_the_keys() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Image 000.png").focus();
    harness.run_steps(2);
    press(&mut harness, NONE, Key::ArrowLeft);
    let at = on_screen(&harness, 10.5, 40.5);
    harness.hover_at(at);
    harness.run_steps(2);
    let pointer = harness.state().shell.view.pointer_px.unwrap();
    assert!(pointer.distance(DVec2::new(10.5, 40.5)) < 0.1, "{pointer}");
    press(&mut harness, Modifiers::SHIFT, Key::ArrowRight);
    let moved = harness.state().shell.view.pointer_px.unwrap();
    assert_eq!(moved, DVec2::new(11.5, 40.5), "keys go on from there");
}
