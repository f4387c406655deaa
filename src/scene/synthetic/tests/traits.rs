use super::*;
use crate::scene::measure::{MeasureOptions, TraitRow, measure};

fn find<'a>(rows: &'a [TraitRow], like: &TraitRow) -> Option<&'a TraitRow> {
    rows.iter().find(|row| (&row.label, row.instance, row.name) == (&like.label, like.instance, like.name))
}

/// Largest share by which a measured trait may be off.
fn tolerance(name: &str) -> f64 {
    match name {
        "length" => 0.03,
        "width_max" | "width" | "size_long" => 0.05,
        _ => 0.10,
    }
}

fn compare(scene: &Scene, min_views: usize, wanted: impl Fn(&TraitRow) -> bool) -> usize {
    let options = TruthOptions { spacing_m: 0.001, surroundings_m: None, min_views };
    let cloud = scene.cloud(&options, &Progress::default()).unwrap();
    let measured = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    let wanted: Vec<&TraitRow> = scene.traits().iter().filter(|row| wanted(row)).collect();
    for truth in &wanted {
        let found = find(&measured, truth).unwrap_or_else(|| panic!("{} of {} is missing", truth.name, truth.label));
        let off = (found.value - truth.value).abs();
        let allowed = if truth.name == "insertion_angle" { 6.5 } else { tolerance(truth.name) * truth.value };
        assert!(off <= allowed, "{} of {}: {} instead of {}", truth.name, truth.label, found.value, truth.value);
    }
    wanted.len()
}

#[test]
fn traits_measured_on_the_whole_surface_are_the_true_ones() {
    // At this spacing grains 1 mm apart cannot be told from one another.
    let compared = compare(&built(&small(1)), 0, |row| row.name != "instances");
    assert_eq!(compared, 3 * 2 + 8 * 9 + 1);
}

#[test]
fn traits_measured_on_what_the_cameras_see_are_the_true_ones() {
    // A third of each sheath faces away from every camera, so that its area cannot be measured.
    let hidden = |row: &TraitRow| row.name == "instances" || row.name == "area" && !row.label.ends_with("blade");
    let scene = built(&SceneOptions { views: 12, ..SceneOptions::default() });
    assert_eq!(compare(&scene, 2, |row| !hidden(row)), 3 * 2 + 8 * 7 + 1);
}

#[test]
fn bricks_have_their_sizes() {
    let scene = built(&SceneOptions { scene: SceneKind::Bricks, ..small(1) });
    let options = TruthOptions { spacing_m: 0.002, surroundings_m: None, min_views: 0 };
    let cloud = scene.cloud(&options, &Progress::default()).unwrap();
    let measured = measure(&cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
    let volumes: Vec<&TraitRow> = scene.traits().iter().filter(|row| row.name == "hull_volume").collect();
    assert_eq!(volumes.len(), 10 + 3);
    for truth in volumes {
        let found = find(&measured, truth).unwrap();
        assert!((found.value / truth.value - 1.0).abs() < 0.1, "{}: {} {}", truth.label, found.value, truth.value);
    }
}

#[test]
fn every_trait_has_a_definition() {
    for kind in [SceneKind::Tiller, SceneKind::Bricks] {
        let scene = built(&SceneOptions { scene: kind, ..small(1) });
        assert!(scene.traits().iter().all(|row| row.definition.len() > 10 && row.value > 0.0));
        assert!(scene.traits().iter().all(|row| row.path.contains(&row.label)));
    }
}
