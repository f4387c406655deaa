use glam::{DVec3, Vec3};
use rayon::prelude::*;

use ostra_frames::FrameCamera;

/// For each point, how many cameras have it inside their picture (whether or not something hides it).
#[must_use]
pub fn inside_frusta(points: &[Vec3], cameras: &[FrameCamera]) -> Vec<u32> {
    let count = |point: &Vec3| {
        cameras
            .iter()
            .filter(|camera| sees(camera, point.as_dvec3()))
            .count() as u32
    };
    points.par_iter().map(count).collect()
}

fn sees(camera: &FrameCamera, x_in_world: DVec3) -> bool {
    let Some(pose) = &camera.camera_from_world else {
        return false;
    };
    let (width, height) = (
        f64::from(camera.intrinsics.width),
        f64::from(camera.intrinsics.height),
    );
    let at = camera.intrinsics.project(pose.transform(x_in_world));
    at.is_some_and(|px| px.x >= 0.0 && px.y >= 0.0 && px.x < width && px.y < height)
}
