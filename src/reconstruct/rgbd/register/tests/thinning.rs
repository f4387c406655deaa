use glam::Vec3;

use crate::rgbd::register::OrientedCloud;

#[test]
fn voxels_hold_means_in_their_order() {
    let cloud = OrientedCloud {
        positions: vec![Vec3::X * 2.5, Vec3::X * 0.25, Vec3::NAN, Vec3::X * 0.75],
        normals: vec![Vec3::ZERO, Vec3::X, Vec3::X, Vec3::Y],
        intensities: vec![0.5, 0.0, 0.9, 1.0],
    };
    let thin = cloud.thinned(1.0);
    assert_eq!(thin.positions, [Vec3::X * 0.5, Vec3::X * 2.5]);
    assert_eq!(
        thin.normals,
        [Vec3::new(0.5, 0.5, 0.0).normalize(), Vec3::ZERO]
    );
    assert_eq!(thin.intensities, [0.5, 0.5]);
}
