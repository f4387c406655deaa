//! Tests of the window of measurements and of the ruler.

use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::Vec3;
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{
    Dimension, GroundChoice, LengthUnit, MeasureOptions, TraitRow, measure,
};
use ostra_core::job::Progress;
use ostra_masks::LabelId;
use ostra_project::ExportRequest;
use ostra_session::Command;

use crate::desk::{Desk, press, tree};

/// Returns the traits of a flat leaf of 10 × 100 mm and a flat pot of 40 × 40 mm.
fn traits() -> Vec<TraitRow> {
    let patch = |width: u32, length: u32, z: f32| {
        (0..width * length)
            .map(move |k| Vec3::new((k % width) as f32, (k / width) as f32, z) * 0.001)
    };
    let (leaf, pot) = (patch(10, 100, 50.0), patch(40, 40, 0.0));
    let mut cloud = LabelledCloud::from_positions(leaf.chain(pot).collect());
    cloud.labels = [vec![LabelId(2); 1000], vec![LabelId(3); 1600]].concat();
    cloud.tree = tree();
    measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap()
}

fn shown() -> Harness<'static, Desk> {
    let mut harness = Desk {
        traits: Some(Arc::new(traits())),
        ..Desk::sample()
    }
    .shown();
    press(&mut harness, Modifiers::NONE, Key::F8);
    harness
}

/// Returns the labels of the rows from top to bottom.
fn order(harness: &Harness<'_, Desk>) -> Vec<String> {
    let named = |name: &&str| {
        harness
            .query_by_label(&format!("Measured {name}"))
            .map(|node| node.rect().top())
    };
    let mut rows: Vec<(f32, &str)> = ["plant", "leaf", "pot"]
        .iter()
        .filter_map(|name| Some((named(name)?, *name)))
        .collect();
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    rows.into_iter().map(|(_, name)| name.to_owned()).collect()
}

#[test]
fn measurements_are_listed_sorted_and_select_labels() {
    let mut harness = shown();
    assert_eq!(order(&harness), ["plant", "leaf", "pot"]);
    harness.get_by_label("Sort by Points").click();
    harness.run_steps(2);
    assert_eq!(order(&harness), ["pot", "plant", "leaf"], "the most first");
    for _ in 0..2 {
        harness.get_by_label("Sort by Width").click();
        harness.run_steps(2);
        assert_eq!(
            order(&harness).last().map(String::as_str),
            Some("pot"),
            "what has no width comes last"
        );
    }
    harness.get_by_label("Sort by label tree").click();
    harness.run_steps(2);
    assert_eq!(order(&harness), ["plant", "leaf", "pot"]);
    harness.get_by_label("Measured pot").click();
    harness.run_steps(2);
    assert_eq!(harness.state().shell.view.label, Some(LabelId(3)));
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
}

#[test]
fn cell_tooltip_shows_definition_and_point_count() {
    let mut harness = shown();
    let area = traits()
        .into_iter()
        .find(|row| row.id == LabelId(3) && row.name == "area")
        .unwrap();
    let text = LengthUnit::Metre.text(area.value, area.dimension);
    let cell = harness
        .query_all_by_label(&text)
        .next()
        .unwrap_or_else(|| panic!("{text}"));
    let at = cell.rect().center();
    harness.hover_at(at);
    harness.run_steps(60);
    let tip = format!("From {} points", area.points);
    for reported in [tip.as_str(), &area.definition] {
        assert!(
            harness
                .query_all_by_label_contains(reported)
                .next()
                .is_some(),
            "{reported}"
        );
    }
}

/// Returns a row with the angle of one instance of the leaf.
fn angle(instance: usize, degrees: f64) -> TraitRow {
    TraitRow {
        id: LabelId(2),
        label: "leaf".into(),
        path: "plant › leaf".into(),
        instance,
        name: "angle_to_pot".into(),
        value: degrees,
        dimension: Dimension::Angle,
        definition: "angle between leaf and pot".into(),
        points: 2345,
    }
}

/// Selects a label in a list.
fn choose(harness: &mut Harness<'_, Desk>, list: &str, label: &str) {
    harness.get_by_label(list).click();
    harness.run_steps(3);
    let lowest = |a: &egui_kittest::Node<'_>, b: &egui_kittest::Node<'_>| {
        a.rect().top().total_cmp(&b.rect().top())
    };
    let list = harness.get_by_label(list).rect();
    let entries = harness
        .query_all_by_label(label)
        .filter(|node| node.rect().top() > list.top());
    entries
        .filter(|node| node.rect().left() < list.right() && node.rect().right() > list.left())
        .min_by(lowest)
        .unwrap()
        .click();
    harness.run_steps(3);
}

#[test]
fn angle_between_two_chosen_labels_is_shown_and_explained() {
    let mut harness = shown();
    harness.get_by_label("Add angle").click();
    harness.run_steps(2);
    harness.get_by_label("Choose two labels");
    choose(&mut harness, "First label of angle 1", "leaf");
    choose(&mut harness, "Second label of angle 1", "pot");
    harness.get_by_label("Not measured");
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());
    let pair = [LabelId(2), LabelId(3)];
    assert_eq!(
        harness
            .state()
            .shell
            .view
            .measures
            .pairs()
            .collect::<Vec<_>>(),
        [pair]
    );

    harness
        .state_mut()
        .angles
        .insert(pair, Ok(vec![angle(1, 34.52), angle(2, 61.0)]));
    harness.run_steps(2);
    let at = harness.get_by_label("34.5°").rect().center();
    harness.hover_at(at);
    harness.run_steps(60);
    for reported in [
        "angle between leaf and pot",
        "From 2345 points",
        "Largest of 2 parts: 34.5°, 61.0°",
    ] {
        assert!(
            harness
                .query_all_by_label_contains(reported)
                .next()
                .is_some(),
            "{reported}"
        );
    }
    harness
        .state_mut()
        .angles
        .insert(pair, Err("no angle can be computed for 'pot'".into()));
    harness.run_steps(2);
    harness.get_by_label("no angle can be computed for 'pot'");

    harness.get_by_label("Export CSV…").click();
    harness.run_steps(3);
    harness.get_by_label("Table file").focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("/out/traits.csv".into()));
    harness.run_steps(2);
    harness.get_by_label("Save").click();
    harness.run_steps(2);
    let request = ExportRequest {
        traits: Some("/out/traits.csv".into()),
        angles: vec![pair],
        ..ExportRequest::default()
    };
    assert_eq!(harness.state().requested, [Command::Export(request)]);

    harness.get_by_label("Remove angle 1").click();
    harness.run_steps(2);
    assert!(harness.query_by_label("First label of angle 1").is_none());
    assert_eq!(harness.state().shell.view.measures.pairs().count(), 0);
}

#[test]
fn measurements_are_exported_as_shown() {
    let mut harness = shown();
    let label = GroundChoice::Label(LabelId(3));
    harness.state_mut().shell.view.measures.settings.ground = label;
    harness.state_mut().shell.view.measures.settings.level = Some(2);
    harness.run_steps(2);
    harness.get_by_label("Export CSV…").click();
    harness.run_steps(3);
    harness.get_by_label("Table file").focus();
    harness.run_steps(2);
    harness.event(egui::Event::Text("/out/traits.csv".into()));
    harness.run_steps(2);
    harness.get_by_label("Save").click();
    harness.run_steps(2);
    let request = ExportRequest {
        traits: Some("/out/traits.csv".into()),
        level: Some(2),
        ground: label,
        ..ExportRequest::default()
    };
    assert_eq!(harness.state().requested, [Command::Export(request)]);
}

#[test]
fn empty_table_says_so_and_escape_closes_it() {
    let mut harness = Desk::sample().shown();
    press(&mut harness, Modifiers::NONE, Key::F8);
    harness.get_by_label("No label has enough points to measure.");
    press(&mut harness, Modifiers::NONE, Key::Escape);
    assert!(!harness.state().shell.view.measures.open);
}

#[test]
fn ruler_measures_lines_and_angles_and_undoes_clicks() {
    let mut harness = Desk::sample().shown();
    harness.get_by_label("Ruler").click();
    harness.run_steps(2);
    harness.get_by_label("Click the first point");
    for at in [Vec3::ZERO, 0.3 * Vec3::X, Vec3::new(0.3, 0.4, 0.0)] {
        harness.state_mut().shell.view.ruler.click(at);
    }
    harness.run_steps(2);
    let reads =
        |harness: &Harness<'_, Desk>, text: &str| harness.query_all_by_label(text).next().is_some();
    assert!(
        reads(&harness, "0.7000 m"),
        "{:?}",
        crate::desk::labels(&harness)
    );
    harness.get_by_label("Ruler unit").click();
    harness.run_steps(3);
    harness.get_by_label("cm").click();
    harness.run_steps(3);
    assert!(
        reads(&harness, "70.00 cm"),
        "{:?}",
        crate::desk::labels(&harness)
    );
    press(&mut harness, Modifiers::NONE, Key::Backspace);
    assert!(reads(&harness, "30.00 cm"));
    harness.get_by_label("Set scale");
    harness.get_by_label("Undo click").click();
    harness.run_steps(2);
    harness.get_by_label("Click the next point");
    harness.get_by_label("Angle").click();
    harness.run_steps(2);
    for at in [Vec3::X, Vec3::ZERO, Vec3::Y] {
        harness.state_mut().shell.view.ruler.click(at);
    }
    harness.run_steps(2);
    assert!(reads(&harness, "90.0°"));
}
