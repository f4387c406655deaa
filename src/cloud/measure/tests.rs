mod heights;

use glam::{DMat3, DVec3};
use rand::RngExt;
use rand_pcg::Pcg32;

use super::*;
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId, LabelTree};

/// Returns a cloud with labels 1, 2, … named `label 1`, `label 2`, ….
///
/// The parts are rotated, scaled from millimetres to metres, and translated.
pub(super) fn cloud(parts: &[Vec<DVec3>]) -> LabelledCloud {
    let turn = 0.001 * DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -0.7, 1.1);
    let mut cloud = LabelledCloud::default();
    for (k, part) in parts.iter().enumerate() {
        let id = LabelId(k as u16 + 1);
        let name = format!("label {}", id.0);
        cloud
            .tree
            .set(Label {
                id,
                name,
                color: LabelTree::color_for(id),
                parent: None,
            })
            .unwrap();
        cloud.positions.extend(
            part.iter()
                .map(|&x| (turn * x + DVec3::new(0.1, -0.2, 0.3)).as_vec3()),
        );
        cloud.labels.resize(cloud.positions.len(), id);
    }
    cloud.normals.resize(cloud.len(), glam::Vec3::ZERO);
    cloud.colors.resize(cloud.len(), [0; 3]);
    cloud.confidence.resize(cloud.len(), 1.0);
    cloud
}

/// Returns points about 1 mm apart on a patch of `size` mm, bent by `place`.
pub(super) fn patch(size: (f64, f64), place: impl Fn(f64, f64) -> DVec3) -> Vec<DVec3> {
    let mut dice = Pcg32::new(7, 1);
    let (columns, rows) = (size.0.round() as usize, size.1.round() as usize);
    (0..columns * rows)
        .map(|k| {
            let mut jitter = || dice.random_range(0.1..0.9);
            place(
                (k % columns) as f64 + jitter(),
                (k / columns) as f64 + jitter(),
            )
        })
        .collect()
}

/// Returns the part of a tube's surface over `arc` radians between two heights in mm.
pub(super) fn tube(radius: f64, arc: f64, (low, high): (f64, f64)) -> Vec<DVec3> {
    patch((arc * radius, high - low), |u, v| {
        DVec3::new(
            radius * (u / radius).cos(),
            radius * (u / radius).sin(),
            low + v,
        )
    })
}

fn rows(parts: &[Vec<DVec3>]) -> Vec<TraitRow> {
    measure(
        &cloud(parts),
        &MeasureOptions::default(),
        &Progress::default(),
    )
    .unwrap()
}

fn value(rows: &[TraitRow], label: &str, instance: usize, name: &str) -> Option<f64> {
    rows.iter()
        .find(|row| row.label == label && row.instance == instance && row.name == name)
        .map(|row| row.value)
}

#[track_caller]
fn assert_near(got: Option<f64>, truth: f64, share: f64) {
    let got = got.expect("the trait is there");
    assert!(
        (got / truth - 1.0).abs() <= share,
        "{got} instead of {truth}"
    );
}

#[test]
fn rod_has_length_diameter_and_area() {
    let rows = rows(&[tube(2.5, std::f64::consts::TAU, (0.0, 200.0))]);
    assert_near(value(&rows, "label 1", 1, "length"), 0.2, 0.02);
    assert_near(value(&rows, "label 1", 1, "diameter"), 0.005, 0.03);
    assert_near(
        value(&rows, "label 1", 1, "area"),
        std::f64::consts::TAU * 0.0025 * 0.2,
        0.05,
    );
    assert_near(
        value(&rows, "label 1", 0, "hull_volume"),
        std::f64::consts::PI * 0.0025_f64.powi(2) * 0.2,
        0.05,
    );
    assert_near(value(&rows, "label 1", 0, "size_long"), 0.2, 0.02);
    assert_eq!(value(&rows, "label 1", 0, "instances"), Some(1.0));
    assert_eq!(value(&rows, "label 1", 1, "width"), None);
}

#[test]
fn half_visible_rod_is_joined_across_gaps() {
    let mut part = tube(2.5, 3.4, (0.0, 60.0));
    part.extend(tube(2.5, 3.4, (130.0, 180.0)));
    part.extend(tube(2.5, 3.4, (250.0, 270.0)));
    let adjacent: Vec<DVec3> = tube(2.5, 3.4, (0.0, 120.0))
        .into_iter()
        .map(|x| x + 40.0 * DVec3::X)
        .collect();
    let rows = rows(&[[part, adjacent].concat()]);
    assert_eq!(value(&rows, "label 1", 0, "instances"), Some(2.0));
    let lengths: Vec<f64> = rows
        .iter()
        .filter(|row| row.name == "length")
        .map(|row| row.value)
        .collect();
    assert!(
        lengths.iter().any(|length| (length - 0.270).abs() < 0.006),
        "{lengths:?}"
    );
    assert_near(value(&rows, "label 1", 1, "diameter"), 0.005, 0.05);
}

/// Returns the surface of a spheroid about the z axis, in mm, with points about 0.2 mm apart.
fn spheroid(half_length: f64, half_width: f64, middle: f64) -> Vec<DVec3> {
    let count = 1500;
    let point = |k: i32| {
        let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
        let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
        let ring = half_width * (1.0 - z * z).sqrt();
        DVec3::new(ring * cos, ring * sin, middle + half_length * z)
    };
    (0..count).map(point).collect()
}

#[test]
fn grains_in_a_row_are_not_joined() {
    let rows = rows(&[(0..4)
        .flat_map(|k| spheroid(3.5, 1.5, 8.0 * f64::from(k)))
        .collect()]);
    assert_eq!(value(&rows, "label 1", 0, "instances"), Some(4.0));
    assert_near(value(&rows, "label 1", 1, "length"), 0.007, 0.05);
}

#[test]
fn ribbon_has_length_width_and_area() {
    let bent =
        |u: f64, v: f64| DVec3::new(u - 5.0, 80.0 * (v / 80.0).cos(), 80.0 * (v / 80.0).sin());
    let rows = rows(&[patch((10.0, 200.0), bent)]);
    assert_near(value(&rows, "label 1", 1, "length"), 0.2, 0.02);
    assert_near(value(&rows, "label 1", 1, "width"), 0.01, 0.06);
    assert_near(value(&rows, "label 1", 1, "area"), 0.002, 0.06);
    assert_eq!(value(&rows, "label 1", 1, "diameter"), None);
}

#[test]
fn square_sheet_has_no_width() {
    let rows = rows(&[patch((40.0, 40.0), |u, v| DVec3::new(u, v, 0.0))]);
    assert_eq!(value(&rows, "label 1", 1, "width"), None);
    assert_near(value(&rows, "label 1", 1, "area"), 0.0016, 0.06);
}

#[test]
fn instances_are_counted_without_crumbs() {
    let shifted = |by: f64, count: f64| patch((8.0, count), move |u, v| DVec3::new(u + by, v, 0.0));
    let rows = rows(&[[shifted(0.0, 90.0), shifted(30.0, 50.0), shifted(60.0, 3.0)].concat()]);
    assert_eq!(value(&rows, "label 1", 0, "instances"), Some(2.0));
    assert_near(value(&rows, "label 1", 1, "length"), 0.09, 0.06);
    assert_near(value(&rows, "label 1", 2, "length"), 0.05, 0.08);
    assert_eq!(value(&rows, "label 1", 0, "points"), Some(8.0 * 143.0));
}

#[test]
fn insertion_angle_of_a_blade_on_a_stem_is_measured() {
    let stem = tube(2.5, std::f64::consts::TAU, (0.0, 150.0));
    let (sin, cos) = 35_f64.to_radians().sin_cos();
    let blade = patch((10.0, 100.0), |u, v| {
        DVec3::new(2.5 + v * sin, u - 5.0, 60.0 + v * cos)
    });
    let rows = rows(&[stem, blade]);
    let angle = value(&rows, "label 2", 1, "insertion_angle").unwrap();
    assert!((angle - 35.0).abs() < 2.0, "{angle}");
    let reported = rows
        .iter()
        .find(|row| row.name == "insertion_angle")
        .unwrap();
    assert!(
        reported.definition.contains("(label 1)"),
        "{}",
        reported.definition
    );
    assert_eq!(value(&rows, "label 1", 1, "insertion_angle"), None);
}

#[test]
fn insertion_angle_is_accurate_with_half_of_rod_and_sheet_hidden() {
    // The view is from +y. Above the collar at 60 mm, the sheet leaves towards +x and hides less of
    // the stem with increasing height; below the collar it hides all of it.
    let stem = patch((8.0, 90.0), |u, v| {
        let first = (1.3 - 0.035 * v).max(0.0);
        let angle = first + (std::f64::consts::PI - first) * u / 8.0;
        DVec3::new(2.5 * angle.cos(), 2.5 * angle.sin(), 60.0 + v)
    });
    // The blade is bent about the stem at the collar and flat from 20 mm on; up to 12 mm its far
    // half is hidden.
    let (sin, cos) = 28_f64.to_radians().sin_cos();
    let blade = patch((10.0, 120.0), |u, v| {
        let (bend, aside) = ((0.4 * (1.0 - v / 20.0)).max(1e-3), u - 5.0);
        let in_bend = (1.0 - (bend * aside).cos()) / bend;
        DVec3::new(
            2.5 + v * sin - in_bend * cos,
            (bend * aside).sin() / bend,
            60.0 + v * cos + in_bend * sin,
        )
    });
    let seen = blade
        .into_iter()
        .filter(|x| x.y > -0.5 || x.z > 60.0 + 12.0 * cos)
        .collect();
    let angle = value(&rows(&[stem, seen]), "label 2", 1, "insertion_angle").unwrap();
    assert!((angle - 28.0).abs() < 0.5, "{angle}");
}

#[test]
fn rod_of_two_thicknesses_has_mean_and_maximum_diameter() {
    let thin = tube(2.0, std::f64::consts::TAU, (0.0, 100.0));
    let thick = tube(3.0, std::f64::consts::TAU, (100.0, 200.0));
    let rows = rows(&[[thin, thick].concat()]);
    assert_near(value(&rows, "label 1", 1, "diameter_mean"), 0.005, 0.04);
    assert_near(value(&rows, "label 1", 1, "diameter_max"), 0.006, 0.04);
}

#[test]
fn ball_has_its_volume_and_area() {
    let count = 20_000;
    let ball = (0..count).map(|k| {
        let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(count);
        let (sin, cos) = (2.399_963 * f64::from(k)).sin_cos();
        25.0 * ((1.0 - z * z).sqrt() * DVec3::new(cos, sin, 0.0) + z * DVec3::Z)
    });
    let rows = rows(&[ball.collect()]);
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 0.025_f64.powi(3);
    assert_near(value(&rows, "label 1", 0, "voxel_volume"), exact, 0.03);
    assert_near(value(&rows, "label 1", 0, "hull_volume"), exact, 0.01);
    assert_near(
        value(&rows, "label 1", 0, "area"),
        4.0 * std::f64::consts::PI * 0.025_f64.powi(2),
        0.03,
    );
    for name in ["box_x", "box_y", "box_z", "size_long", "size_short"] {
        assert_near(value(&rows, "label 1", 0, name), 0.05, 0.01);
    }
}

/// Compares the traits of a label's points with and without a distant speck of noise.
#[test]
fn distant_speck_does_not_change_traits() {
    let rod = tube(2.5, std::f64::consts::TAU, (0.0, 200.0));
    let speck =
        (0..12).map(|k| DVec3::new(900.0 + f64::from(k % 3), 700.0 + f64::from(k / 3), -800.0));
    let ground = GroundChoice::Plane {
        normal: [0.0, 0.0, 1.0],
        offset: 0.0,
    };
    let clean = measured_above(&cloud(std::slice::from_ref(&rod)), ground).unwrap();
    let noisy = measured_above(&cloud(&[rod.into_iter().chain(speck).collect()]), ground).unwrap();
    let sizes = [
        "hull_volume",
        "voxel_volume",
        "area",
        "size_long",
        "size_short",
        "box_x",
        "box_y",
        "box_z",
    ];
    for name in sizes.into_iter().chain(["height_max", "height_min"]) {
        assert_near(
            value(&noisy, "label 1", 0, name),
            value(&clean, "label 1", 0, name).unwrap(),
            0.01,
        );
        let row = |rows: &[TraitRow]| {
            rows.iter()
                .find(|row| (row.instance, &*row.name) == (0, name))
                .unwrap()
                .clone()
        };
        let (clean, noisy) = (row(&clean), row(&noisy));
        assert!(
            noisy.definition.ends_with("outlying points left out"),
            "{}",
            noisy.definition
        );
        assert!(!clean.definition.contains("stray"), "{}", clean.definition);
    }
    assert_eq!(value(&noisy, "label 1", 0, "instances"), Some(1.0));
}

#[test]
fn every_row_has_a_point_count() {
    let rows = rows(&[tube(2.5, std::f64::consts::TAU, (0.0, 150.0))]);
    let points = value(&rows, "label 1", 0, "points").unwrap() as usize;
    assert!(
        rows.iter()
            .all(|row| (points / 4..=points).contains(&row.points)),
        "{rows:?}"
    );
}

/// Returns two rods that stand on a table (label 3), and a larger unlabelled wall next to them.
fn standing() -> LabelledCloud {
    let rod = |x: f64, high: f64| -> Vec<DVec3> {
        tube(2.5, std::f64::consts::TAU, (2.0, high))
            .into_iter()
            .map(|at| at + x * DVec3::X)
            .collect()
    };
    let table = patch((120.0, 120.0), |u, v| DVec3::new(u - 60.0, v - 60.0, 0.0));
    let wall = patch((150.0, 150.0), |u, v| DVec3::new(u - 75.0, 200.0, v));
    let mut cloud = cloud(&[rod(0.0, 100.0), rod(30.0, 60.0), table, wall]);
    cloud
        .labels
        .iter_mut()
        .filter(|label| label.0 == 4)
        .for_each(|label| *label = LabelId::NONE);
    cloud
}

fn measured_above(
    cloud: &LabelledCloud,
    ground: GroundChoice,
) -> Result<Vec<TraitRow>, SceneError> {
    measure(
        cloud,
        &MeasureOptions {
            ground,
            ..MeasureOptions::default()
        },
        &Progress::default(),
    )
}

#[test]
fn level_includes_descendant_labels() {
    let mut cloud = cloud(&[
        Vec::new(),
        tube(2.5, 6.2, (0.0, 60.0)),
        tube(2.5, 6.2, (90.0, 150.0)),
    ]);
    for id in [2, 3] {
        let label = cloud.tree.get(LabelId(id)).unwrap().clone();
        cloud
            .tree
            .set(Label {
                parent: Some(LabelId(1)),
                ..label
            })
            .unwrap();
    }
    let at = |level| {
        let options = MeasureOptions {
            level,
            ..MeasureOptions::default()
        };
        measure(&cloud, &options, &Progress::default()).unwrap()
    };
    let labels = |rows: &[TraitRow]| {
        rows.iter()
            .map(|row| row.path.clone())
            .collect::<std::collections::BTreeSet<_>>()
    };
    assert_eq!(
        labels(&at(Some(1))).into_iter().collect::<Vec<_>>(),
        ["label 1"]
    );
    assert_near(value(&at(Some(1)), "label 1", 1, "length"), 0.15, 0.03);
    assert_eq!(labels(&at(Some(2))).len(), 2);
    assert_eq!(labels(&at(None)).len(), 3);
}

#[test]
fn degenerate_clouds_give_finite_values_or_errors() {
    let measured = |points: Vec<DVec3>| {
        measure(
            &cloud(&[points]),
            &MeasureOptions::default(),
            &Progress::default(),
        )
    };
    for odd in [
        vec![DVec3::ONE],
        vec![DVec3::ONE; 200],
        vec![DVec3::NAN, DVec3::ZERO, DVec3::X],
    ] {
        let rows = measured(odd).unwrap();
        assert!(rows.iter().all(|row| row.value.is_finite()), "{rows:?}");
    }
    let line = (0..200).map(|k| f64::from(k) * DVec3::X).collect();
    assert!(
        measured(line)
            .unwrap()
            .iter()
            .all(|row| row.value.is_finite())
    );
    assert!(matches!(measured(Vec::new()), Err(SceneError::Request(_))));
    let options = MeasureOptions {
        link: 0.0,
        ..MeasureOptions::default()
    };
    let refused = measure(
        &cloud(&[vec![DVec3::ONE; 9]]),
        &options,
        &Progress::default(),
    );
    assert!(refused.unwrap_err().to_string().contains("link"));
}

#[test]
fn stop_request_ends_the_measurement() {
    let progress = Progress::default();
    progress.stop();
    let stopped = measure(
        &cloud(&[tube(2.5, 6.0, (0.0, 50.0))]),
        &MeasureOptions::default(),
        &progress,
    );
    assert!(matches!(stopped, Err(SceneError::Stopped(_))));
}
