//! Tests of the window of measurements and of the ruler.

use std::sync::Arc;

use egui::{Key, Modifiers};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use glam::Vec3;
use ostra_app::{Dialog, InspectedPoint};
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{
    Dimension, GroundChoice, LengthUnit, MeasureOptions, TraitRow, measure,
};
use ostra_core::job::Progress;
use ostra_masks::LabelId;
use ostra_project::workflow::WorkflowStep;
use ostra_project::{Coordinates, ExportRequest, ResultKind, ResultRecord, ScaleEnd, ScaleRequest};
use ostra_session::Command;

use crate::desk::{Desk, open_step, press, tree};

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

/// Returns a desk whose scale is unknown, with the cloud of the sample.
fn without_scale() -> Desk {
    let mut desk = Desk::sample();
    desk.unit = LengthUnit::World;
    let record = ResultRecord {
        coordinates: Some(Coordinates {
            world: 1,
            scale: 1.0,
            unit: LengthUnit::World,
        }),
        ..ResultRecord::default()
    };
    desk.project.results.insert(ResultKind::Cameras, record);
    desk.traits = Some(Arc::new(traits()));
    desk
}

#[test]
fn true_length_sets_the_scale_and_the_bar_keeps_its_size() {
    let mut harness = without_scale().shown();
    harness.get_by_label("Ruler").click();
    harness.run_steps(2);
    let places = |harness: &Harness<'_, Desk>| {
        ["3-D view", "Set scale", "True length", "Clear"]
            .map(|name| harness.get_all_by_label(name).last().unwrap().rect())
    };
    let before = places(&harness);
    let is_off = |harness: &Harness<'_, Desk>| {
        let button = harness.get_by_label("Set scale");
        button.accesskit_node().is_disabled()
    };
    assert!(is_off(&harness));
    for at in [Vec3::ZERO, 0.4 * Vec3::X] {
        harness.state_mut().shell.view.ruler.click(at);
        harness.run_steps(2);
        assert_eq!(places(&harness), before);
    }
    assert!(is_off(&harness), "the true length is not given");
    harness.get_by_label("Ruler point 1");
    harness.get_by_label("Ruler point 2");
    harness.get_by_label("Ruler: 0.4000 units");
    assert_eq!(harness.unnamed_widgets(), Vec::<String>::new());

    harness.state_mut().shell.view.ruler.length = 20.0;
    harness.run_steps(2);
    assert_eq!(places(&harness), before);
    harness.get_by_label("Set scale").click();
    harness.run_steps(2);
    let request = ScaleRequest {
        ends: [Vec3::ZERO, 0.4 * Vec3::X].map(|end| ScaleEnd::World(end.as_dvec3())),
        length: 0.2,
    };
    assert_eq!(harness.state().requested, [Command::Scale(request)]);

    // The window scales the points with the scene.
    let desk = harness.state_mut();
    desk.unit = LengthUnit::Metre;
    desk.shell.scale_by(0.5);
    harness.run_steps(2);
    harness.get_by_label("Ruler: 0.2000 m");
}

#[test]
fn unknown_scale_is_reported_next_to_every_measure_until_it_is_set() {
    let bar = "Scale unknown – measure a length";
    let button = "Measure a known length";
    let starts = |harness: &mut Harness<'_, Desk>, button: &str| {
        harness.get_by_label(button).click();
        harness.run_steps(4);
        let view = &mut harness.state_mut().shell.view;
        assert!(view.ruler.in_hand, "{button}");
        assert_eq!(view.dialog, None);
        view.ruler.in_hand = false;
        harness.run_steps(2);
    };
    let mut harness = without_scale().shown();
    starts(&mut harness, bar);
    open_step(&mut harness, WorkflowStep::Label);
    press(&mut harness, Modifiers::NONE, Key::F8);
    starts(&mut harness, button);
    press(&mut harness, Modifiers::NONE, Key::F8);
    open_step(&mut harness, WorkflowStep::Measure);
    starts(&mut harness, button);
    open_step(&mut harness, WorkflowStep::Label);
    harness.state_mut().shell.view.dialog = Some(Dialog::Export);
    harness.run_steps(3);
    harness.get_by_label("Plant traits").click();
    harness.run_steps(3);
    starts(&mut harness, button);
    let desk = harness.state_mut();
    let point = InspectedPoint::new(desk.cloud.as_ref().unwrap(), None, 3);
    desk.shell.view.inspected_point = Some(point);
    harness.run_steps(4);
    starts(&mut harness, button);

    harness.state_mut().unit = LengthUnit::Metre;
    open_step(&mut harness, WorkflowStep::Measure);
    assert!(harness.query_by_label_contains("Scale unknown").is_none());
    assert!(harness.query_by_label(button).is_none());
    let results = &mut harness.state_mut().project.results;
    results.remove(&ResultKind::Cameras);
    harness.run_steps(4);
    harness.get_by_label("Given cameras are taken as metres");
    starts(&mut harness, button);
}

#[test]
fn cloud_older_than_the_scale_has_no_unit_and_asks_to_fuse() {
    let mut desk = without_scale();
    let cameras = desk.project.results.get_mut(&ResultKind::Cameras).unwrap();
    cameras.coordinates.as_mut().unwrap().unit = LengthUnit::Metre;
    desk.shell.view.ruler.points = vec![Vec3::ZERO, 0.4 * Vec3::X];
    desk.shell.view.ruler.in_hand = true;
    desk.shell.view.ruler.length = 20.0;
    desk.shell.view.measures.unit = Some(LengthUnit::Centimetre);
    let harness = desk.shown();
    harness.get_by_label("Older than the scale – fuse again");
    harness.get_by_label("Ruler: 0.4000 units");
    let button = harness.get_by_label("Set scale");
    assert!(button.accesskit_node().is_disabled());
}

#[test]
fn volume_is_that_of_the_solid_and_missing_for_an_open_surface() {
    let count = 4000;
    let ball = (0..count).map(|k| {
        let z = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
        let (sin, cos) = (2.399_963 * k as f32).sin_cos();
        0.05 * Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
    });
    let leaf = (0..1000).map(|k| Vec3::new((k % 10) as f32, (k / 10) as f32, 50.0) * 0.01);
    let mut cloud = LabelledCloud::from_positions(ball.chain(leaf).collect());
    cloud.labels = [vec![LabelId(3); count], vec![LabelId(2); 1000]].concat();
    cloud.tree = tree();
    let rows = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    let volume = |id: u16| {
        rows.iter()
            .find(|row| row.id == LabelId(id) && row.name == "volume" && row.instance == 0)
    };
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.05_f64.powi(3);
    let of_ball = volume(3).unwrap();
    assert!((of_ball.value / exact - 1.0).abs() < 0.02, "{of_ball:?}");
    assert_eq!(volume(2), None);
    let text = LengthUnit::Metre.text(of_ball.value, Dimension::Volume);
    let mut harness = Desk {
        traits: Some(Arc::new(rows)),
        ..Desk::sample()
    }
    .shown();
    press(&mut harness, Modifiers::NONE, Key::F8);
    harness.get_by_label("Sort by Volume").click();
    harness.run_steps(2);
    assert_eq!(order(&harness)[0], "pot");
    assert!(harness.query_all_by_label(&text).next().is_some(), "{text}");
}
