use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3, Mat4, Vec3};

use super::{Eye, Likeness, SeenRegion, SelectStep, Selection, Selector};
use crate::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_geometry::{Camera, Pose};
use ostra_masks::{Label, LabelId, LabelTree};

const PLATE: LabelId = LabelId(1);
const WALL: LabelId = LabelId(2);
const STEP: f32 = 0.02;

/// Returns a plate of half a unit at z = 0 in front of a wall of two units at z = 1.
///
/// Both face a viewpoint at z = -3.
fn scene() -> LabelledCloud {
    let square = |side: i32, z: f32| {
        let at = move |i: i32| (i - side / 2) as f32 * STEP;
        (0..side * side).map(move |i| Vec3::new(at(i % side), at(i / side), z))
    };
    let positions: Vec<Vec3> = square(25, 0.0).chain(square(101, 1.0)).collect();
    let mut cloud = LabelledCloud::from_positions(positions);
    cloud.labels = cloud
        .positions
        .iter()
        .map(|x| if x.z < 0.5 { PLATE } else { WALL })
        .collect();
    cloud.normals.fill(Vec3::NEG_Z);
    for (id, name) in [(PLATE, "plate"), (WALL, "wall")] {
        cloud
            .tree
            .set(Label {
                id,
                name: name.into(),
                color: [id.0 as u8; 3],
                parent: None,
            })
            .unwrap();
    }
    cloud
}

fn eye() -> Eye {
    let camera = Camera::pinhole(400, 400, [400.0, 400.0], [200.0, 200.0]);
    Eye::Free {
        camera,
        camera_from_world: Pose {
            rotation: DQuat::IDENTITY,
            translation: DVec3::Z * 3.0,
        },
    }
}

fn lasso(corners: &[[f64; 2]]) -> SeenRegion {
    let points_px = corners.iter().map(|&at| DVec2::from_array(at)).collect();
    SeenRegion {
        eye: eye(),
        points_px,
        radius_px: 0.0,
        remove: false,
        hidden: Vec::new(),
        isolated: None,
        uncertain_below: None,
        cube_from_world: None,
    }
}

fn everything() -> SeenRegion {
    lasso(&[[0.0, 0.0], [400.0, 0.0], [400.0, 400.0], [0.0, 400.0]])
}

fn chosen(cloud: &LabelledCloud, steps: &[SelectStep]) -> Result<Selection, SceneError> {
    let selector = Selector::new(Arc::new(cloud.clone())).unwrap();
    selector.select(&[], &cloud.tree, steps, &Progress::default())
}

/// Counts the selected points of the plate and of the wall.
fn counts(cloud: &LabelledCloud, steps: &[SelectStep]) -> (usize, usize) {
    let points = chosen(cloud, steps).unwrap().points;
    let plate = points
        .iter()
        .filter(|&&point| cloud.labels[point as usize] == PLATE)
        .count();
    (plate, points.len() - plate)
}

/// Counts the points of the wall that the plate occludes.
fn shadowed(cloud: &LabelledCloud) -> usize {
    cloud
        .positions
        .iter()
        .filter(|x| x.z > 0.5 && x.x.abs() < 0.33 && x.y.abs() < 0.33)
        .count()
}

#[test]
fn occluded_points_are_not_selected() {
    let cloud = scene();
    let (plate, wall) = counts(&cloud, &[SelectStep::Seen(everything())]);
    assert_eq!(plate, 625, "all of the plate");
    let seen = 101 * 101 - shadowed(&cloud);
    assert!(
        wall.abs_diff(seen) < seen / 50,
        "{wall} of the wall, {seen} are next to the shadow"
    );
    let middle = lasso(&[
        [170.0, 170.0],
        [230.0, 170.0],
        [230.0, 230.0],
        [170.0, 230.0],
    ]);
    assert_eq!(
        counts(&cloud, &[SelectStep::Seen(middle)]).1,
        0,
        "nothing through the plate"
    );
}

#[test]
fn hidden_labels_do_not_occlude() {
    let cloud = scene();
    let hidden = SeenRegion {
        hidden: vec![PLATE],
        ..everything()
    };
    assert_eq!(counts(&cloud, &[SelectStep::Seen(hidden)]), (0, 101 * 101));
}

#[test]
fn filtered_and_clipped_points_do_not_occlude() {
    let cloud = scene();
    let isolated = SeenRegion {
        isolated: Some(WALL),
        ..everything()
    };
    assert_eq!(
        counts(&cloud, &[SelectStep::Seen(isolated)]),
        (0, 101 * 101)
    );
    // The vote on the plate was unanimous.
    let mut contested = scene();
    contested.confidence = contested
        .labels
        .iter()
        .map(|&id| if id == PLATE { 1.0 } else { 0.6 })
        .collect();
    let uncertain = SeenRegion {
        uncertain_below: Some(0.7),
        ..everything()
    };
    assert_eq!(
        counts(&contested, &[SelectStep::Seen(uncertain)]),
        (0, 101 * 101)
    );
    // From z = 0.5 to z = 1.5, without limits to the sides.
    let cube = Mat4::from_scale(Vec3::new(0.01, 0.01, 2.0)) * Mat4::from_translation(Vec3::NEG_Z);
    let cut = SeenRegion {
        cube_from_world: Some(cube),
        ..everything()
    };
    assert_eq!(counts(&cloud, &[SelectStep::Seen(cut)]), (0, 101 * 101));
}

#[test]
fn stroke_adds_points_and_lasso_removes_them() {
    let cloud = scene();
    let stroke = SeenRegion {
        radius_px: 8.0,
        ..lasso(&[[120.0, 200.0], [280.0, 200.0]])
    };
    let (plate, wall) = counts(&cloud, &[SelectStep::Seen(stroke.clone())]);
    assert!(
        (75..=175).contains(&plate) && wall > 0,
        "{plate} and {wall}"
    );
    let right = SeenRegion {
        remove: true,
        ..lasso(&[[200.5, 0.0], [400.0, 0.0], [400.0, 400.0], [200.5, 400.0]])
    };
    let points = chosen(&cloud, &[SelectStep::Seen(stroke), SelectStep::Seen(right)])
        .unwrap()
        .points;
    assert!(
        !points.is_empty()
            && points
                .iter()
                .all(|&point| cloud.positions[point as usize].x <= 0.01)
    );
}

#[test]
fn only_keeps_the_points_of_one_label() {
    let cloud = scene();
    assert_eq!(
        counts(
            &cloud,
            &[SelectStep::Seen(everything()), SelectStep::Only(PLATE)]
        ),
        (625, 0)
    );
    assert_eq!(counts(&cloud, &[SelectStep::Label(WALL)]), (0, 101 * 101));
}

#[test]
fn growth_stops_at_normal_and_colour_changes() {
    let mut cloud = scene();
    let seed = SelectStep::Seen(lasso(&[
        [195.0, 195.0],
        [205.0, 195.0],
        [205.0, 205.0],
        [195.0, 205.0],
    ]));
    let grown = |cloud: &LabelledCloud, likeness| {
        counts(cloud, &[seed.clone(), SelectStep::Grow(likeness)])
    };
    assert_eq!(
        grown(&cloud, Likeness::default()),
        (625, 0),
        "the whole plate, and nothing across the gap"
    );
    for (x, normal) in cloud.positions.iter().zip(&mut cloud.normals) {
        *normal = if x.x > 0.1 { Vec3::X } else { Vec3::NEG_Z };
    }
    let left = cloud
        .positions
        .iter()
        .filter(|x| x.z < 0.5 && x.x <= 0.1)
        .count();
    assert_eq!(grown(&cloud, Likeness::default()), (left, 0));
    assert_eq!(
        grown(
            &cloud,
            Likeness {
                normal_deg: 100.0,
                ..Likeness::default()
            }
        ),
        (625, 0)
    );
    for (x, color) in cloud.positions.iter().zip(&mut cloud.colors) {
        *color = if x.y > 0.1 { [200, 20, 20] } else { [192; 3] };
    }
    let corner = cloud
        .positions
        .iter()
        .filter(|x| x.z < 0.5 && x.x <= 0.1 && x.y <= 0.1)
        .count();
    assert_eq!(grown(&cloud, Likeness::default()), (corner, 0));
    let wrong = SelectStep::Grow(Likeness {
        normal_deg: 200.0,
        color: 1.0,
    });
    assert!(
        chosen(&cloud, &[wrong])
            .unwrap_err()
            .to_string()
            .contains("180")
    );
}

#[test]
fn components_are_ordered_by_size() {
    let cloud = scene();
    let all = [SelectStep::Label(PLATE), SelectStep::Label(WALL)];
    assert_eq!(chosen(&cloud, &all).unwrap().pieces, 2);
    let piece = |rank| {
        chosen(
            &cloud,
            &[all[0].clone(), all[1].clone(), SelectStep::Piece(rank)],
        )
    };
    assert_eq!(
        (
            piece(0).unwrap().points.len(),
            piece(1).unwrap().points.len()
        ),
        (101 * 101, 625)
    );
    assert!(piece(2).unwrap_err().to_string().contains("in 2"));
}

#[test]
fn missing_viewpoint_is_named_in_the_error() {
    let nowhere = SeenRegion {
        eye: Eye::Frame(7),
        ..everything()
    };
    let error = chosen(&scene(), &[SelectStep::Seen(nowhere)])
        .unwrap_err()
        .to_string();
    assert!(error.contains("frame 7"), "{error}");
    assert!(Selector::new(Arc::default()).is_err());
}

#[test]
fn selection_steps_survive_a_json_round_trip() {
    let text = r#"[{"seen":{"eye":{"frame":3},"points_px":[[1.0,2.0],[3.0,2.0],[3.0,4.0]]}},{"only":2},{"grow":{"color":5.0}},{"piece":0}]"#;
    let steps: Vec<SelectStep> = serde_json::from_str(text).unwrap();
    let again: Vec<SelectStep> =
        serde_json::from_str(&serde_json::to_string(&steps).unwrap()).unwrap();
    assert_eq!(steps, again);
    assert_eq!(
        steps[2],
        SelectStep::Grow(Likeness {
            color: 5.0,
            ..Likeness::default()
        })
    );
    let free = SelectStep::Seen(everything());
    assert_eq!(
        serde_json::from_str::<SelectStep>(&serde_json::to_string(&free).unwrap()).unwrap(),
        free
    );
}

#[test]
fn descendants_of_a_hidden_label_are_hidden() {
    let mut cloud = scene();
    let mut tree = LabelTree::default();
    for (id, parent) in [(5, None), (1, Some(5)), (2, None)] {
        let label = Label {
            id: LabelId(id),
            name: id.to_string(),
            color: [0; 3],
            parent: parent.map(LabelId),
        };
        tree.set(label).unwrap();
    }
    cloud.tree = tree;
    let hidden = SeenRegion {
        hidden: vec![LabelId(5)],
        ..everything()
    };
    assert_eq!(counts(&cloud, &[SelectStep::Seen(hidden)]), (0, 101 * 101));
}
