use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3};

use super::StereoEngine;
use crate::stereo::patchmatch::{DepthSearch, PatchMatchOptions, PlaneMap, PosedImage, Tones};
use ostra_core::job::Progress;
use ostra_geometry::{Camera, Pose};

/// Range of depths that is searched.
pub const RANGE: [f64; 2] = [1.2, 6.0];

/// The coarsest level's longer side.
const COARSEST_PX: u32 = 40;

/// Returns a slanted textured wall with a board in front of it, from one of several positions; any size.
pub fn image(index: usize, size: (u32, u32)) -> Arc<PosedImage> {
    partly_flat(index, size, |_| false)
}

/// Returns the same without texture in some places.
pub fn partly_flat(
    index: usize,
    (width, height): (u32, u32),
    is_flat: fn(DVec3) -> bool,
) -> Arc<PosedImage> {
    let focal = 0.95 * f64::from(width);
    let camera = Camera::pinhole(
        width,
        height,
        [focal, 1.01 * focal],
        [0.5 * f64::from(width), 0.5 * f64::from(height)],
    );
    let side = 0.35 * index.div_ceil(2) as f64 * if index.is_multiple_of(2) { -1.0 } else { 1.0 };
    let pose = Pose {
        rotation: DQuat::from_rotation_y(0.1 * side),
        translation: DVec3::new(-side, 0.05 * side, 0.0),
    };
    let at = |i: u32| DVec2::new(f64::from(i % width) + 0.5, f64::from(i / width) + 0.5);
    let (luma, chroma) = (0..width * height)
        .map(|i| paint(&camera, &pose, at(i), is_flat))
        .unzip();
    let tones = Tones {
        width: width as usize,
        height: height as usize,
        luma,
        chroma,
    };
    Arc::new(PosedImage::new(tones, camera, pose, COARSEST_PX))
}

/// Returns grey and chroma.
fn paint(
    camera: &Camera,
    pose: &Pose,
    at_px: DVec2,
    is_flat: fn(DVec3) -> bool,
) -> (f32, [f32; 2]) {
    let (centre, ray) = (
        pose.centre(),
        pose.rotation.conjugate() * camera.unproject(at_px).extend(1.0),
    );
    let board = centre + ray * ((2.0 - centre.z) / ray.z);
    let is_board = board.x.abs() < 0.25 && board.y.abs() < 0.3;
    let wall =
        (3.0 + 0.4 * centre.x - 0.3 * centre.y - centre.z) / (ray.z - 0.4 * ray.x + 0.3 * ray.y);
    let x = if is_board { board } else { centre + wall * ray };
    if is_flat(x) {
        return (110.0, [0.0; 2]);
    }
    let wave = |kx: f64, ky: f64, phase: f64| (kx * x.x + ky * x.y + phase).sin();
    let sum = wave(17.0, 5.0, 0.3)
        + wave(-7.0, 19.0, 1.1)
        + wave(29.0, -23.0, 2.0)
        + wave(11.0, 31.0, 0.7);
    let grey = 127.5 + if is_board { -30.0 } else { 30.0 } * sum;
    (
        grey as f32,
        [
            20.0 * wave(3.0, 8.0, 0.5),
            if is_board { 40.0 } else { -25.0 },
        ]
        .map(|part| part as f32),
    )
}

/// Returns images of one size.
pub fn images(count: usize, size: (u32, u32)) -> Vec<Arc<PosedImage>> {
    (0..count).map(|index| image(index, size)).collect()
}

/// Returns the search of the first image against the others.
pub fn task<'a>(images: &'a [Arc<PosedImage>], allowed: Option<&'a [bool]>) -> DepthSearch<'a> {
    let (reference, sources) = (&images[0], &images[1..]);
    DepthSearch {
        reference,
        sources,
        depth_range: RANGE,
        seeds: &[(40, 30, 3.1), (41, 60, 2.9)],
        allowed,
    }
}

/// Returns the processor's result for each image against the others.
pub fn found(images: &[Arc<PosedImage>]) -> Vec<Arc<PlaneMap>> {
    let one = |index: usize| {
        let mut order = images.to_vec();
        order.swap(0, index);
        StereoEngine::Cpu
            .search(
                &task(&order, None),
                &PatchMatchOptions::default(),
                &Progress::default(),
            )
            .unwrap()
            .into()
    };
    (0..images.len()).map(one).collect()
}
