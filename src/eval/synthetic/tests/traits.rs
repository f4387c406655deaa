use super::*;
use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{MeasureOptions, TraitRow, measure};

fn find<'a>(rows: &'a [TraitRow], like: &TraitRow) -> Option<&'a TraitRow> {
    rows.iter().find(|row| {
        (&row.label, row.instance, &row.name) == (&like.label, like.instance, &like.name)
    })
}

/// Returns the tolerated relative error of a measured trait.
///
/// It is larger for the area of a sheath, whose margins overlap.
fn tolerance(truth: &TraitRow) -> f64 {
    match &*truth.name {
        "length" => 0.02,
        "area" if truth.label.ends_with("sheath") => 0.10,
        "width_max" | "width" | "size_long" | "area" => 0.05,
        _ => 0.10,
    }
}

/// Tolerated error of an angle in degrees, also where cameras see only one side of the collar.
const ANGLE_DEG: f64 = 1.5;

fn compare(scene: &Scene, min_views: usize, wanted: impl Fn(&TraitRow) -> bool) -> usize {
    let options = TruthOptions {
        spacing_m: 0.001,
        surroundings_m: None,
        min_views,
    };
    let cloud = scene.cloud(&options, &Progress::default()).unwrap();
    let measured = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    let wanted: Vec<&TraitRow> = scene.traits().iter().filter(|row| wanted(row)).collect();
    for truth in &wanted {
        let found = find(&measured, truth)
            .unwrap_or_else(|| panic!("{} of {} is missing", truth.name, truth.label));
        let off = (found.value - truth.value).abs();
        let allowed = if truth.name == "insertion_angle" {
            ANGLE_DEG
        } else {
            tolerance(truth) * truth.value
        };
        assert!(
            off <= allowed,
            "{} of {}: {} instead of {}",
            truth.name,
            truth.label,
            found.value,
            truth.value
        );
    }
    wanted.len()
}

#[test]
fn traits_measured_on_the_whole_surface_match_the_ground_truth() {
    // At this spacing, grains that are 1 mm apart cannot be separated.
    let compared = compare(&built(&small(1)), 0, |row| row.name != "instances");
    assert_eq!(compared, 3 * 2 + 8 * 9 + 1);
}

/// Returns the points of a label and its descendants.
fn of_label(cloud: &LabelledCloud, name: &str) -> LabelledCloud {
    let id = cloud.tree.by_name(name).unwrap().id;
    let below = |k: &u32| cloud.tree.path(cloud.labels[*k as usize]).contains(&id);
    cloud.select(&(0..cloud.len() as u32).filter(below).collect::<Vec<_>>())
}

/// Returns the number of instances of a label that are counted on the whole surface.
fn count(scene: &Scene, label: &str, spacing_m: f64) -> f64 {
    let options = TruthOptions {
        spacing_m,
        surroundings_m: None,
        min_views: 0,
    };
    let cloud = of_label(&scene.cloud(&options, &Progress::default()).unwrap(), label);
    let rows = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    rows.iter()
        .find(|row| row.label == label && row.name == "instances")
        .unwrap()
        .value
}

#[test]
fn leaves_and_stems_of_a_small_scene_are_counted() {
    let scene = built(&small(1));
    assert_eq!(
        (count(&scene, "leaf", 0.001), count(&scene, "stem", 0.001)),
        (8.0, 3.0)
    );
}

#[test]
fn measured_brick_volumes_match_the_ground_truth() {
    let scene = built(&SceneOptions {
        scene: SceneKind::Bricks,
        ..small(1)
    });
    let options = TruthOptions {
        spacing_m: 0.002,
        surroundings_m: None,
        min_views: 0,
    };
    let cloud = scene.cloud(&options, &Progress::default()).unwrap();
    let measured = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    let volumes: Vec<&TraitRow> = scene
        .traits()
        .iter()
        .filter(|row| row.name == "hull_volume")
        .collect();
    assert_eq!(volumes.len(), 6 + 4 + 5);
    for truth in volumes {
        let found = find(&measured, truth).unwrap();
        assert!(
            (found.value / truth.value - 1.0).abs() < 0.1,
            "{}: {} {}",
            truth.label,
            found.value,
            truth.value
        );
    }
}

#[test]
fn every_trait_has_a_definition() {
    for kind in [SceneKind::Tiller, SceneKind::Bricks] {
        let scene = built(&SceneOptions {
            scene: kind,
            ..small(1)
        });
        assert!(
            scene
                .traits()
                .iter()
                .all(|row| row.definition.len() > 10 && row.value > 0.0)
        );
        assert!(
            scene
                .traits()
                .iter()
                .all(|row| row.path.contains(&row.label))
        );
    }
}
