//! Heights above the ground.

use super::*;

#[test]
fn heights_are_above_the_fitted_labelled_or_given_ground() {
    let mut cloud = standing();
    let rows = measured_above(&cloud, GroundChoice::Label(LabelId(3))).unwrap();
    assert_near(value(&rows, "label 1", 0, "height_max"), 0.1, 0.01);
    assert_near(value(&rows, "label 2", 1, "height_max"), 0.06, 0.01);
    assert!(
        rows.iter()
            .any(|row| row.name == "height_max" && row.definition.contains("label chosen"))
    );

    cloud
        .labels
        .iter_mut()
        .filter(|label| label.0 == 3)
        .for_each(|label| *label = LabelId::NONE);
    let rows = measured_above(&cloud, GroundChoice::Fitted).unwrap();
    assert_near(value(&rows, "label 1", 0, "height_max"), 0.1, 0.01);
    assert!(
        rows.iter()
            .any(|row| row.name == "height_max" && row.definition.contains("fitted"))
    );

    let given = GroundChoice::Plane {
        normal: [0.0, 0.0, 2.0],
        offset: 2.0,
    };
    let rows = measured_above(&cloud, given).unwrap();
    let highest = cloud
        .positions
        .iter()
        .zip(&cloud.labels)
        .filter(|(_, label)| label.0 == 1)
        .map(|(x, _)| x.z);
    assert_near(
        value(&rows, "label 1", 0, "height_max"),
        f64::from(highest.fold(f32::MIN, f32::max)) - 1.0,
        0.001,
    );

    cloud.positions.truncate(
        cloud
            .labels
            .iter()
            .position(|&label| label == LabelId::NONE)
            .unwrap(),
    );
    cloud.labels.truncate(cloud.positions.len());
    let rows = measured_above(&cloud, GroundChoice::Fitted).unwrap();
    assert_eq!(
        value(&rows, "label 1", 0, "height_max"),
        None,
        "nothing to stand on"
    );
    let refused = measured_above(&cloud, GroundChoice::Label(LabelId(3))).unwrap_err();
    assert!(
        refused.to_string().contains("'label 3' has no points"),
        "{refused}"
    );
    let refused = measured_above(
        &cloud,
        GroundChoice::Plane {
            normal: [0.0; 3],
            offset: 1.0,
        },
    )
    .unwrap_err();
    assert!(refused.to_string().contains("normal"), "{refused}");
}
