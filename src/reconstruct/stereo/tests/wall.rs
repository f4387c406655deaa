use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec2, DVec3};

use crate::stereo::patchmatch::{PosedImage, Tones};
use ostra_frames::cameras::{SparseKeypoint, SparsePoint, SparsePoints};
use ostra_frames::{Frame, FrameCamera, ImageSource};
use ostra_geometry::{Camera, Pose};

/// Columns and rows of the images.
pub const SIZE: (u32, u32) = (160, 120);

/// Pixels at the borders that some view may not see.
pub const BORDER: usize = 24;

pub fn camera() -> Camera {
    Camera::pinhole(SIZE.0, SIZE.1, [150.0, 150.0], [80.0, 60.0])
}

/// Returns a camera to the side of the first, rotated a little.
pub fn pose(index: usize) -> Pose {
    let side = [0.0, 0.35, -0.35, 0.7][index];
    Pose {
        rotation: DQuat::from_rotation_y(0.1 * side),
        translation: DVec3::new(-side, 0.05 * side, 0.0),
    }
}

/// Returns the depth of the wall `z = 3 + 0.4 x − 0.3 y` (world space) along a ray from a centre.
fn along(centre: DVec3, ray: DVec3) -> f64 {
    (3.0 + 0.4 * centre.x - 0.3 * centre.y - centre.z) / (ray.z - 0.4 * ray.x + 0.3 * ray.y)
}

/// Returns where a pixel of a camera without distortion sees the wall, and its depth.
pub fn seen(pose: &Pose, at_px: DVec2) -> (DVec3, f64) {
    seen_by(&camera(), pose, at_px)
}

/// Returns where a camera's pixel sees the wall, and its depth.
pub fn seen_by(camera: &Camera, pose: &Pose, at_px: DVec2) -> (DVec3, f64) {
    let ray = camera.unproject(at_px).extend(1.0);
    let (centre, towards) = (pose.centre(), pose.rotation.conjugate() * ray);
    let depth = along(centre, towards);
    (centre + depth * towards, depth)
}

/// Returns the wall's grey, 0–255.
pub fn paint(x: DVec3) -> f32 {
    let wave = |kx: f64, ky: f64, phase: f64| (kx * x.x + ky * x.y + phase).sin();
    let sum = wave(17.0, 5.0, 0.3)
        + wave(-7.0, 19.0, 1.1)
        + wave(29.0, -23.0, 2.0)
        + wave(11.0, 31.0, 0.7);
    (127.5 + 30.0 * sum) as f32
}

pub fn grey(pose: &Pose) -> Tones {
    painted(&camera(), pose, |_, x| paint(x))
}

/// Renders an image in which each pixel shows the paint where it sees the wall.
pub fn painted(camera: &Camera, pose: &Pose, paint: impl Fn(usize, DVec3) -> f32) -> Tones {
    let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
    let at = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
    let luma = (0..width * height)
        .map(|i| paint(i, seen_by(camera, pose, at(i)).0))
        .collect();
    Tones {
        width,
        height,
        luma,
        chroma: Vec::new(),
    }
}

pub fn image(index: usize) -> Arc<PosedImage> {
    Arc::new(PosedImage::new(
        grey(&pose(index)),
        camera(),
        pose(index),
        60,
    ))
}

/// Returns a frame whose image is written into a folder.
pub fn frame(folder: &Path, index: usize, grey: &Tones) -> Frame {
    let name = format!("{index}.png");
    let bytes: Vec<u8> = grey
        .luma
        .iter()
        .flat_map(|&value| [(value + 0.5) as u8; 3])
        .collect();
    image::save_buffer(
        folder.join(&name),
        &bytes,
        SIZE.0,
        SIZE.1,
        image::ColorType::Rgb8,
    )
    .unwrap();
    Frame {
        image: ImageSource::File {
            path: folder.join(&name),
            orientation: Default::default(),
        },
        name,
        width: SIZE.0,
        height: SIZE.1,
        depth: None,
        camera: Some(FrameCamera::given(camera(), Some(pose(index.min(3))))),
    }
}

/// Returns points of the wall, seen by some frames.
pub fn sparse(frames: &[usize]) -> SparsePoints {
    let mut sparse = SparsePoints::default();
    for i in 0..80u32 {
        let at_px = DVec2::new(
            f64::from(i % 10) * 11.0 + 25.0,
            f64::from(i / 10) * 11.0 + 20.0,
        );
        let (position, _) = seen(&pose(0), at_px);
        sparse.points.push(SparsePoint {
            position,
            color: [0; 3],
            error_px: None,
        });
        for &frame in frames {
            let at_px = camera().project(pose(frame).transform(position)).unwrap();
            sparse
                .keypoints
                .entry(frame)
                .or_default()
                .push(SparseKeypoint {
                    at_px,
                    point: Some(i),
                });
        }
    }
    sparse
}
