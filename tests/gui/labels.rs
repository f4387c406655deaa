//! Tests of the label list with many labels.

use egui::{Event, Key, Modifiers, Rect};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use ostra_masks::{Label, LabelId, LabelTree};

use crate::desk::{Desk, press};

const NONE: Modifiers = Modifiers::NONE;
const LONG: &str = "secondary inflorescence branch of the third whorl";

/// Returns a desk with 40 labels in a window of common size.
fn forty() -> Harness<'static, Desk> {
    let mut desk = Desk::sample();
    let mut tree = LabelTree::default();
    for id in 1..=40 {
        let name = match id {
            12 => LONG.into(),
            _ => format!("organ {id}"),
        };
        let parent = (id == 40).then_some(LabelId(5));
        let color = LabelTree::color_for(LabelId(id));
        let id = LabelId(id);
        tree.set(Label {
            id,
            name,
            color,
            parent,
        })
        .unwrap();
    }
    desk.project.labels = tree;
    desk.size = egui::vec2(1280.0, 800.0);
    desk.shown()
}

fn filter(harness: &mut Harness<'_, Desk>, text: &str) {
    harness.get_by_label("Find label").focus();
    harness.run_steps(2);
    harness.event(Event::Text(text.into()));
    harness.run_steps(3);
}

#[test]
fn filter_lists_only_labels_with_its_text() {
    let harness = Desk::sample().shown();
    assert!(
        harness.query_by_label("Find label").is_none(),
        "three labels need no filter"
    );
    let mut harness = forty();
    filter(&mut harness, "ORGAN 3");
    let is_listed = |harness: &Harness<'_, Desk>, name: &str| {
        harness
            .query_by_label(&format!("More for {name}"))
            .is_some()
    };
    assert!(is_listed(&harness, "organ 3") && is_listed(&harness, "organ 37"));
    assert!(!is_listed(&harness, "organ 4") && !is_listed(&harness, LONG));
    harness.get_by_label("Show all names").click();
    harness.run_steps(3);
    assert!(is_listed(&harness, "organ 4"));
    filter(&mut harness, "organ 40");
    assert!(is_listed(&harness, "organ 40"));
    assert!(
        is_listed(&harness, "organ 5"),
        "the parent of a found label is listed"
    );
    press(&mut harness, NONE, Key::Enter);
    assert_eq!(harness.state().shell.view.label, Some(LabelId(40)));
    harness.get_by_label("Show all names").click();
    harness.run_steps(2);
    filter(&mut harness, "xyz");
    harness.get_by_label("No label has this text in its name");
}

#[test]
fn tools_below_forty_labels_stay_in_sight() {
    let harness = forty();
    let window = egui::Rect::from_min_size(egui::Pos2::ZERO, harness.state().size);
    for name in ["New label name", "Add"] {
        let rect = harness.get_all_by_label(name).next().unwrap().rect();
        assert!(window.contains_rect(rect), "{name}: {rect}");
    }
    let step = harness.get_all_by_label_contains("Measure & export: ");
    let rect = step.into_iter().next().unwrap().rect();
    assert!(window.contains_rect(rect), "the last step: {rect}");
}

#[test]
fn selected_label_is_scrolled_into_sight() {
    let mut harness = forty();
    let place = |harness: &Harness<'_, Desk>| harness.get_by_label("More for organ 39").rect();
    let field = |harness: &Harness<'_, Desk>| harness.get_by_label("New label name").rect();
    assert!(place(&harness).top() > field(&harness).top());
    harness.state_mut().shell.view.label = Some(LabelId(39));
    harness.run_steps(30);
    assert!(place(&harness).bottom() <= field(&harness).top() + 1.0);
}

#[test]
fn long_name_is_cut_and_shown_whole_under_the_pointer() {
    let mut harness = forty();
    harness.state_mut().shell.view.label = Some(LabelId(12));
    harness.run_steps(30);
    let has_whole = |harness: &Harness<'_, Desk>| {
        harness
            .query_all_by_label_contains(&format!("{LONG}\n"))
            .next()
            .is_some()
    };
    assert!(!has_whole(&harness));
    let at = harness
        .get_by_role_and_label(egui::Role::Button, LONG)
        .rect()
        .center();
    harness.hover_at(at);
    harness.run_steps(6);
    assert!(has_whole(&harness));
}

#[test]
fn only_the_selected_label_is_shown_on_request() {
    let mut harness = Desk::sample().shown();
    assert_eq!(harness.state().shell.view.shown_label(), None);
    press(&mut harness, NONE, Key::Num2);
    press(&mut harness, Modifiers::SHIFT, Key::M);
    assert_eq!(harness.state().shell.view.shown_label(), Some(LabelId(2)));
    press(&mut harness, Modifiers::SHIFT, Key::M);
    assert_eq!(harness.state().shell.view.shown_label(), None);
    harness.get_by_label("More for pot").click();
    harness.run_steps(3);
    harness.get_by_label("Show only this label").click();
    harness.run_steps(3);
    assert_eq!(harness.state().shell.view.shown_label(), Some(LabelId(3)));
}

#[test]
fn new_labels_begin_with_magenta_cyan_and_orange() {
    let colors = [1, 2, 3].map(|id| LabelTree::color_for(LabelId(id)));
    let [magenta, cyan, orange] = colors;
    assert!(magenta[0] > 200 && magenta[1] < 100 && magenta[2] > 180);
    assert!(cyan[0] < 100 && cyan[1] > 150 && cyan[2] > 200);
    assert!(orange[0] > 240 && (100..180).contains(&orange[1]) && orange[2] < 80);
}

#[test]
fn zoom_to_label_shows_the_label_with_its_children() {
    let mut harness = Desk::sample().shown();
    let shown = |harness: &Harness<'_, Desk>| {
        let map = harness.state().shell.view.canvas_map.unwrap();
        let corners = [(20.0, 10.0), (40.0, 30.0)];
        let [a, b] = corners.map(|(x, y)| map.to_screen(DVec2::new(x, y)));
        (map, Rect::from_two_pos(a, b))
    };
    // Of the plant, only its leaf is on the frame.
    harness.state_mut().shell.view.label = Some(LabelId(1));
    let (whole, _) = shown(&harness);
    press(&mut harness, Modifiers::SHIFT, Key::Z);
    harness.run_steps(2);
    let (map, leaf) = shown(&harness);
    assert!(map.scale > 1.2 * whole.scale, "{}", map.scale);
    assert!(map.pane.contains_rect(leaf), "{leaf} in {}", map.pane);
    assert!((leaf.center() - map.pane.center()).length() < 1.0);

    harness.state_mut().shell.view.label = Some(LabelId(3));
    press(&mut harness, Modifiers::SHIFT, Key::Z);
    harness.run_steps(2);
    assert_eq!(shown(&harness).0, map, "the pot is not on the frame");
}
