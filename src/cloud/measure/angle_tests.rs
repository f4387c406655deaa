//! Angles between labels, on shapes with exactly known angles.

use glam::{DQuat, DVec3};

use super::tests::{cloud, patch, tube};
use super::*;
use crate::SceneError;
use ostra_core::job::Progress;
use ostra_masks::{Label, LabelId};

fn turned(part: &[DVec3], about: DVec3, degrees: f64) -> Vec<DVec3> {
    let turn = DQuat::from_axis_angle(about, degrees.to_radians());
    part.iter().map(|&x| turn * x).collect()
}

fn angles(parts: &[Vec<DVec3>], pair: [u16; 2]) -> Result<Vec<TraitRow>, SceneError> {
    measure_angles(
        &cloud(parts),
        &[pair.map(LabelId)],
        &MeasureOptions::default(),
        &Progress::default(),
    )
}

fn whole_tube(radius: f64, low: f64, high: f64) -> Vec<DVec3> {
    tube(radius, std::f64::consts::TAU, (low, high))
}

#[track_caller]
fn assert_angle(row: &TraitRow, degrees: f64, within: f64) {
    assert!(
        (row.value - degrees).abs() < within,
        "{} instead of {degrees}: {row:?}",
        row.value
    );
}

#[test]
fn angle_between_two_rods_is_measured() {
    let stem = whole_tube(2.5, -80.0, 80.0);
    let twig = turned(&whole_tube(1.5, 4.0, 90.0), DVec3::X, 40.0);
    for (pair, name) in [([1, 2], "angle_to_label 2"), ([2, 1], "angle_to_label 1")] {
        let rows = angles(&[stem.clone(), twig.clone()], pair).unwrap();
        assert_eq!(rows.len(), 1);
        assert_angle(&rows[0], 40.0, 1.0);
        assert_eq!(
            (&*rows[0].name, rows[0].instance, rows[0].id.0),
            (name, 1, pair[0])
        );
        assert!(
            rows[0]
                .definition
                .contains("the axis of label 1 (a cylinder"),
            "{}",
            rows[0].definition
        );
        let all = stem.len() + twig.len();
        assert!(
            (all / 2..=all).contains(&rows[0].points),
            "{} of {all}",
            rows[0].points
        );
    }
}

#[test]
fn bent_rod_has_its_local_direction() {
    // An arc of radius 120 mm that meets the stem at a right angle and is turned by 90 degrees at
    // its end.
    let bent = patch((9.0, 180.0), |u, v| {
        let (sin, cos) = (v / 120.0).sin_cos();
        let ring = 1.5 * DVec3::new((u / 1.5).cos(), (u / 1.5).sin(), 0.0);
        DVec3::new(4.0, 0.0, 0.0)
            + 120.0 * DVec3::new(sin, 0.0, 1.0 - cos)
            + DVec3::new(-ring.x * sin, ring.y, ring.x * cos)
    });
    let rows = angles(&[bent, whole_tube(2.5, -80.0, 80.0)], [1, 2]).unwrap();
    // Over the first 30 mm, the chord of the arc leans by half of what the arc turns.
    assert_angle(&rows[0], 90.0 - (15.0_f64 / 120.0).to_degrees(), 2.0);
}

#[test]
fn angle_of_a_sheet_on_a_rod_is_the_insertion_angle() {
    let stem = whole_tube(2.5, 0.0, 150.0);
    let (sin, cos) = 35_f64.to_radians().sin_cos();
    let blade = patch((10.0, 100.0), |u, v| {
        DVec3::new(2.5 + v * sin, u - 5.0, 60.0 + v * cos)
    });
    let parts = [stem, blade];
    let inserted = measure(
        &cloud(&parts),
        &MeasureOptions::default(),
        &Progress::default(),
    )
    .unwrap();
    let inserted = inserted
        .iter()
        .find(|row| row.name == "insertion_angle")
        .unwrap();
    for pair in [[1, 2], [2, 1]] {
        let rows = angles(&parts, pair).unwrap();
        assert_angle(&rows[0], 35.0, 2.0);
        assert!(
            (rows[0].value - inserted.value).abs() < 1e-9,
            "{} and {}",
            rows[0].value,
            inserted.value
        );
        assert!(
            rows[0].definition.contains("where label 2 leaves it"),
            "{}",
            rows[0].definition
        );
        assert!(!rows[0].definition.contains("do not meet"));
    }
}

#[test]
fn each_instance_is_measured_against_the_closest_one() {
    let aside = |part: &[DVec3]| {
        part.iter()
            .map(|&x| x + 200.0 * DVec3::X)
            .collect::<Vec<_>>()
    };
    let leaning = turned(&whole_tube(2.5, -60.0, 60.0), DVec3::X, 20.0);
    let stems = [whole_tube(2.5, -80.0, 80.0), aside(&leaning)].concat();
    let [steep, flat] = [30.0, 70.0]
        .map(|degrees| turned(&whole_tube(1.5, 4.0, 50.0 + degrees), DVec3::X, degrees));
    // The second, longer twig grows from the leaning stem.
    let rows = angles(&[[steep, aside(&flat)].concat(), stems], [1, 2]).unwrap();
    assert_eq!(
        rows.iter().map(|row| row.instance).collect::<Vec<_>>(),
        [1, 2]
    );
    assert_angle(&rows[0], 50.0, 1.0);
    assert_angle(&rows[1], 30.0, 1.0);
}

#[test]
fn crumb_next_to_the_rod_is_ignored() {
    let twig = turned(&whole_tube(1.5, 4.0, 90.0), DVec3::X, 40.0);
    let crumb = patch((8.0, 8.0), |u, v| {
        DVec3::new(u - 4.0, -4.0 + 0.01 * v, v + 4.5)
    });
    let stem = [whole_tube(2.5, -80.0, 0.0), crumb].concat();
    assert_angle(&angles(&[twig, stem], [1, 2]).unwrap()[0], 40.0, 1.5);
}

#[test]
fn block_has_an_axis_and_cube_has_none() {
    let solid = |x: f64, y: f64, z: f64| -> Vec<DVec3> {
        let count = (x * y * z / 8.0) as u32;
        let share = |k: u32, by: f64| (f64::from(k) * by).fract() - 0.5;
        (0..count)
            .map(|k| {
                DVec3::new(
                    x * share(k, 0.819_172_5),
                    y * share(k, 0.671_043_6),
                    z * share(k, 0.549_700_5),
                )
            })
            .collect()
    };
    let block = turned(&solid(30.0, 28.0, 50.0), DVec3::X, 25.0);
    let rod: Vec<DVec3> = whole_tube(2.5, -80.0, 80.0)
        .into_iter()
        .map(|x| x + 20.0 * DVec3::X)
        .collect();
    let rows = angles(&[block.clone(), rod], [1, 2]).unwrap();
    assert_angle(&rows[0], 25.0, 3.0);
    assert!(
        rows[0]
            .definition
            .contains("longest principal axis of label 1"),
        "{}",
        rows[0].definition
    );
    let cube = solid(30.0, 30.0, 30.0)
        .into_iter()
        .map(|x| x + 60.0 * DVec3::X)
        .collect();
    let refused = angles(&[block, cube], [1, 2]).unwrap_err();
    assert!(
        refused
            .to_string()
            .contains("'label 2': it has no clear direction"),
        "{refused}"
    );
}

#[test]
fn definition_states_that_parts_do_not_meet() {
    let far = whole_tube(2.5, -80.0, 80.0)
        .into_iter()
        .map(|x| x + 300.0 * DVec3::X)
        .collect();
    let rows = angles(
        &[turned(&whole_tube(2.5, 0.0, 90.0), DVec3::X, 40.0), far],
        [1, 2],
    )
    .unwrap();
    assert_angle(&rows[0], 40.0, 1.0);
    assert!(
        rows[0].definition.ends_with("; they do not meet"),
        "{}",
        rows[0].definition
    );
}

#[test]
fn pairs_without_an_angle_are_errors() {
    let parts = [
        whole_tube(2.5, 0.0, 80.0),
        vec![DVec3::ONE; 30],
        Vec::new(),
        whole_tube(2.5, 100.0, 180.0),
    ];
    let mut cloud = cloud(&parts);
    let below = Label {
        parent: Some(LabelId(1)),
        ..cloud.tree.get(LabelId(4)).unwrap().clone()
    };
    cloud.tree.set(below).unwrap();
    let refused = |a: u16, b: u16| {
        let pair = [LabelId(a), LabelId(b)];
        measure_angles(
            &cloud,
            &[pair],
            &MeasureOptions::default(),
            &Progress::default(),
        )
        .unwrap_err()
        .to_string()
    };
    assert!(
        refused(1, 1).contains("'label 1' was given twice"),
        "{}",
        refused(1, 1)
    );
    assert!(
        refused(1, 4).contains("'label 4' is a part of 'label 1'"),
        "{}",
        refused(1, 4)
    );
    assert!(
        refused(4, 1).contains("'label 4' is a part of 'label 1'"),
        "{}",
        refused(4, 1)
    );
    assert!(
        refused(4, 2).contains("'label 2': none of its parts has 50 points"),
        "{}",
        refused(4, 2)
    );
    assert!(
        refused(4, 3).contains("'label 3': it has no points"),
        "{}",
        refused(4, 3)
    );
    assert!(refused(4, 9).contains("no label 9"), "{}", refused(4, 9));
}

#[test]
fn stop_request_ends_the_measurement() {
    let progress = Progress::default();
    progress.stop();
    let cloud = cloud(&[whole_tube(2.5, 0.0, 50.0), whole_tube(2.5, 60.0, 110.0)]);
    let stopped = measure_angles(
        &cloud,
        &[[LabelId(1), LabelId(2)]],
        &MeasureOptions::default(),
        &progress,
    );
    assert!(matches!(stopped, Err(SceneError::Stopped(_))));
}
