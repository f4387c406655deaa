use super::pyramid::Pyramid;
use super::register::OrientedCloud;
use super::scan::Scan;
use ostra_geometry::Pose;

/// Scans of a fragment that its cloud is made of, at most.
const SCANS: usize = 30;
/// The level of the views whose pixels become points.
const LEVEL: usize = 1;

/// Scans that odometry and loops tie together, and where they stand to each other.
#[derive(Debug, Clone)]
pub struct Fragment {
    /// Places of its scans, ascending.
    pub scans: Vec<usize>,
    /// Of each: the pose, in a world of the fragment's own.
    pub poses: Vec<Pose>,
}

impl Fragment {
    /// What its scans see, in its own world.
    #[must_use]
    pub fn cloud(&self, scans: &[Scan]) -> OrientedCloud {
        let mut cloud = OrientedCloud::default();
        let step = self.scans.len().div_ceil(SCANS).max(1);
        for (&scan, pose) in self.scans.iter().zip(&self.poses).step_by(step) {
            add(&mut cloud, &scans[scan], pose);
        }
        cloud
    }
}

fn add(cloud: &mut OrientedCloud, scan: &Scan, pose: &Pose) {
    let pyramid = Pyramid::new(&scan.view);
    let level = &pyramid.levels[LEVEL];
    let world_from_camera = pose.inverse();
    let (rotation, shift) = (
        world_from_camera.rotation.as_quat(),
        world_from_camera.translation.as_vec3(),
    );
    for (pixel, &depth) in level.depths.iter().enumerate() {
        if depth > 0.0 {
            let ray = level.ray(pixel % level.width, pixel / level.width);
            cloud.positions.push(rotation * (ray * depth) + shift);
            cloud.normals.push(rotation * level.normals[pixel]);
            cloud.intensities.push(level.grey[pixel]);
        }
    }
}
