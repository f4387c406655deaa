use glam::Vec3;
use proptest::prelude::*;

use super::*;
use ostra_core::job::Progress;

/// Returns points on a sphere.
///
/// The spacing is about 1 for `count` = 4 π r².
fn sphere(centre: Vec3, radius: f32, count: usize) -> Vec<Vec3> {
    (0..count)
        .map(|k| {
            let z = 1.0 - 2.0 * (k as f32 + 0.5) / count as f32;
            let angle = k as f32 * 2.399_963;
            let ring = (1.0 - z * z).sqrt();
            centre + radius * Vec3::new(ring * angle.cos(), ring * angle.sin(), z)
        })
        .collect()
}

fn found(points: &[Vec3], options: &InstanceOptions) -> Instances {
    find_instances(points, options, &Progress::default()).unwrap()
}

#[test]
fn separate_objects_are_two_instances_by_size() {
    let points = [
        sphere(Vec3::ZERO, 8.0, 800),
        sphere(Vec3::X * 30.0, 10.0, 1250),
    ]
    .concat();
    let instances = found(&points, &InstanceOptions::default());
    assert_eq!(instances.sizes, [1250, 800]);
    assert!(instances.of_points[..800].iter().all(|&number| number == 2));
    assert!(instances.of_points[800..].iter().all(|&number| number == 1));
}

#[test]
fn isolated_points_do_not_join_two_objects() {
    let mut points = [
        sphere(Vec3::ZERO, 8.0, 800),
        sphere(Vec3::X * 30.0, 8.0, 800),
    ]
    .concat();
    points.extend((0..6).map(|k| Vec3::X * (9.0 + 2.2 * k as f32)));
    assert_eq!(found(&points, &InstanceOptions::default()).sizes.len(), 2);
    let chained = InstanceOptions {
        min_neighbours: 1,
        ..InstanceOptions::default()
    };
    assert_eq!(
        found(&points, &chained).sizes.len(),
        1,
        "every point links where one neighbour is enough"
    );
}

#[test]
fn specks_are_not_instances() {
    let points = [
        sphere(Vec3::ZERO, 8.0, 800),
        sphere(Vec3::X * 30.0, 1.2, 20),
        vec![Vec3::Y * 90.0],
    ]
    .concat();
    let instances = found(&points, &InstanceOptions::default());
    assert_eq!(instances.sizes, [800]);
    assert!(instances.of_points[800..].iter().all(|&number| number == 0));
    assert_eq!(
        found(
            &points,
            &InstanceOptions {
                min_points: 5,
                ..InstanceOptions::default()
            }
        )
        .sizes,
        [800, 20]
    );
}

#[test]
fn non_finite_points_and_empty_clouds_have_no_instances() {
    assert_eq!(
        found(&[], &InstanceOptions::default()),
        Instances::default()
    );
    let mut points = sphere(Vec3::ZERO, 8.0, 800);
    points[3] = Vec3::NAN;
    assert_eq!(found(&points, &InstanceOptions::default()).of_points[3], 0);
}

#[test]
fn options_out_of_range_are_errors() {
    let options = InstanceOptions {
        radius: 0.0,
        ..InstanceOptions::default()
    };
    let error = find_instances(&[Vec3::ZERO], &options, &Progress::default()).unwrap_err();
    assert!(error.to_string().contains("radius"), "{error}");
}

proptest! {
    #[test]
    fn instances_do_not_depend_on_point_order(
        raw in prop::collection::vec(prop::array::uniform3(-6i8..6), 2..150).prop_shuffle(),
        turn in 1usize..100,
    ) {
        let points: Vec<Vec3> = raw.iter().map(|x| Vec3::from_array(x.map(f32::from))).collect();
        let mut moved = points.clone();
        moved.rotate_left(turn % points.len());
        let options = InstanceOptions { radius: 1.5, min_neighbours: 3, min_points: 2 };
        let (first, second) = (found(&points, &options), found(&moved, &options));
        prop_assert_eq!(&first.sizes, &second.sizes);
        let mut again = second.of_points;
        again.rotate_right(turn % points.len());
        prop_assert_eq!(first.of_points, again);
    }
}
