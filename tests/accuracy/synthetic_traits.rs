//! Tests of the traits of the synthetic plant, measured on its finely sampled surface.

use std::sync::OnceLock;

use ostra_cloud::LabelledCloud;
use ostra_cloud::measure::{MeasureOptions, TraitRow, measure, measure_angles};
use ostra_core::job::Progress;
use ostra_eval::synthetic::{Scene, SceneOptions, TruthOptions};

/// Returns options for a few small views of the tiller of a seed.
fn small(seed: u64) -> SceneOptions {
    SceneOptions {
        views: 4,
        width: 240,
        height: 320,
        seed,
        ..SceneOptions::default()
    }
}

fn built(options: &SceneOptions) -> Scene {
    Scene::build(options).unwrap()
}

/// A plant in front of twelve cameras, and the points that at least two of them see.
struct SeenPlant {
    scene: Scene,
    cloud: LabelledCloud,
}

impl SeenPlant {
    fn of_seed(seed: u64) -> Self {
        let scene = built(&SceneOptions {
            views: 12,
            seed,
            ..SceneOptions::default()
        });
        let options = TruthOptions {
            spacing_m: 0.001,
            surroundings_m: None,
            min_views: 2,
        };
        let cloud = scene.cloud(&options, &Progress::default()).unwrap();
        Self { scene, cloud }
    }

    fn default_seed() -> &'static Self {
        static PLANT: OnceLock<SeenPlant> = OnceLock::new();
        PLANT.get_or_init(|| Self::of_seed(SceneOptions::default().seed))
    }
}

fn find<'a>(rows: &'a [TraitRow], like: &TraitRow) -> Option<&'a TraitRow> {
    rows.iter().find(|row| {
        (&row.label, row.instance, &row.name) == (&like.label, like.instance, &like.name)
    })
}

/// Returns the maximum relative error of a measured trait.
///
/// It is larger for the area of a sheath, whose overlapping borders lie on one another.
fn tolerance(truth: &TraitRow) -> f64 {
    match &*truth.name {
        "length" => 0.02,
        "area" if truth.label.ends_with("sheath") => 0.10,
        "width_max" | "width" | "size_long" | "area" => 0.05,
        _ => 0.10,
    }
}

/// Maximum error of an angle in degrees, also where cameras see only one side of the collar.
const ANGLE_DEG: f64 = 1.5;

fn compare(plant: &SeenPlant, wanted: impl Fn(&TraitRow) -> bool) -> usize {
    let SeenPlant { scene, cloud } = plant;
    let measured = measure(cloud, &MeasureOptions::default(), &Progress::default()).unwrap();
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

/// Returns only the points of a label and its sublabels.
fn of_label(cloud: &LabelledCloud, name: &str) -> LabelledCloud {
    let id = cloud.tree.by_name(name).unwrap().id;
    let below = |k: &u32| cloud.tree.path(cloud.labels[*k as usize]).contains(&id);
    cloud.select(&(0..cloud.len() as u32).filter(below).collect::<Vec<_>>())
}

/// Returns the number of instances of a label measured on the whole surface.
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

fn traits_of_visible_points_equal_ground_truth() {
    // A third of each sheath faces away from every camera, so its area cannot be measured.
    let hidden = |row: &TraitRow| {
        row.name == "instances" || row.name == "area" && !row.label.ends_with("blade")
    };
    let plant = SeenPlant::default_seed();
    assert_eq!(compare(plant, |row| !hidden(row)), 3 * 2 + 8 * 7 + 1);
}

fn insertion_angles_hold_for_other_plants() {
    for seed in [4, 6] {
        let plant = SeenPlant::of_seed(seed);
        assert_eq!(compare(&plant, |row| row.name == "insertion_angle"), 8);
    }
}

/// Maximum error in degrees of the angle between chosen labels.
const CHOSEN_DEG: f64 = 3.0;

fn angles_between_a_leaf_and_the_stems_are_its_insertion_angle() {
    let SeenPlant { scene, cloud } = SeenPlant::default_seed();
    let id = |name: &str| scene.tree().by_name(name).unwrap().id;
    let truths: Vec<&TraitRow> = scene
        .traits()
        .iter()
        .filter(|row| row.name == "insertion_angle")
        .collect();
    assert_eq!(truths.len(), 8);
    for truth in truths {
        let leaf = truth.label.trim_end_matches(" blade");
        // The blade only, then the leaf with its sheath, against all stems; the leaf's own stem is
        // nearest.
        for name in [&truth.label, leaf] {
            let pair = [id(name), id("stem")];
            let rows = measure_angles(
                cloud,
                &[pair],
                &MeasureOptions::default(),
                &Progress::default(),
            )
            .unwrap();
            assert!(
                (rows[0].value - truth.value).abs() < CHOSEN_DEG,
                "{name}: {} instead of {}",
                rows[0].value,
                truth.value
            );
        }
    }
}

fn grains_leaves_and_stems_are_counted() {
    for seed in [1, 3] {
        let scene = built(&small(seed));
        let grains = scene
            .traits()
            .iter()
            .find(|row| row.name == "instances")
            .unwrap()
            .value;
        // Grains lie 1 mm apart; points within three spacings are connected.
        assert_eq!(count(&scene, "panicle grains", 0.000_2), grains);
        assert_eq!(
            (count(&scene, "leaf", 0.001), count(&scene, "stem", 0.001)),
            (8.0, 3.0)
        );
    }
}

crate::registry::tests! {
    Nothing =>
        traits_of_visible_points_equal_ground_truth,
        insertion_angles_hold_for_other_plants,
        angles_between_a_leaf_and_the_stems_are_its_insertion_angle,
        grains_leaves_and_stems_are_counted;
}
