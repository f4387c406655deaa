use glam::Vec3;

use super::room::{SyntheticRoom, VOXEL, moved};
use crate::rgbd::register::fpfh::describe;
use crate::rgbd::register::{DescribedCloud, OrientedCloud};
use ostra_core::job::Progress;

#[test]
fn descriptors_are_invariant_to_rigid_motion_and_distinguish_places() {
    let (source, _, pose) = SyntheticRoom::pair(3, 300.0);
    let cloud = source.thinned(VOXEL);
    let here = describe(&cloud, VOXEL, &Progress::default()).unwrap();
    let there = describe(&moved(&cloud, &pose), VOXEL, &Progress::default()).unwrap();
    let distance =
        |a: &[f32; 33], b: &[f32; 33]| -> f32 { a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum() };
    let pairs: Vec<_> = here.iter().flatten().zip(there.iter().flatten()).collect();
    assert!(pairs.len() > 1000 && here.iter().flatten().count() == there.iter().flatten().count());
    // Rounding puts single angles into the next bin.
    let same = pairs.iter().filter(|(a, b)| distance(a, b) < 8.0).count();
    assert!(same * 100 > pairs.len() * 98, "{same} of {}", pairs.len());
    let others: f32 = pairs
        .windows(2)
        .map(|two| distance(two[0].0, two[1].0))
        .sum();
    assert!(others / pairs.len() as f32 > 60.0);
}

#[test]
fn bins_of_each_angle_have_a_fixed_sum() {
    let cloud = SyntheticRoom::new(1).scan(0.0, 1.0, 200.0).thinned(VOXEL);
    for descriptor in describe(&cloud, VOXEL, &Progress::default())
        .unwrap()
        .iter()
        .flatten()
    {
        for group in descriptor.chunks(11) {
            assert!((group.iter().sum::<f32>() - 200.0).abs() < 0.1, "{group:?}");
        }
    }
}

#[test]
fn points_without_normal_or_neighbours_have_no_descriptor() {
    let mut cloud = SyntheticRoom::new(1).scan(0.0, 1.0, 200.0).thinned(VOXEL);
    cloud.normals[5] = Vec3::ZERO;
    cloud.positions[9] = Vec3::splat(50.0);
    let found = describe(&cloud, VOXEL, &Progress::default()).unwrap();
    assert!(found[5].is_none() && found[9].is_none() && found[20].is_some());
}

#[test]
fn invalid_clouds_are_refused_and_a_stop_ends_the_work() {
    let progress = Progress::default();
    let lopsided = OrientedCloud {
        positions: vec![Vec3::ONE],
        ..OrientedCloud::default()
    };
    assert!(DescribedCloud::new(&lopsided, VOXEL, &progress).is_err());
    assert!(DescribedCloud::new(&OrientedCloud::default(), 0.0, &progress).is_err());
    assert!(DescribedCloud::new(&OrientedCloud::default(), VOXEL, &progress).is_ok());
    progress.stop();
    assert!(
        DescribedCloud::new(
            &SyntheticRoom::new(1).scan(0.0, 1.0, 50.0),
            VOXEL,
            &progress
        )
        .is_err()
    );
}
