use std::fmt::Write as _;
use std::path::Path;

use super::SparsePoint;
use super::attach::stored_camera;
use super::colmap_model::model_and_parameters;
use crate::frames::{Frame, FrameError};
use crate::geometry::{Camera, Pose};

/// Writes `cameras.txt`, `images.txt` and `points3D.txt` of a COLMAP text model into `folder`, which is made: all frames
/// that have intrinsics and a pose, for the pictures as stored (turned back), equal cameras once. Numbers are written so
/// that reading gives the same bits.
///
/// # Errors
/// [`FrameError::Io`] where a file cannot be written; [`FrameError::Geometry`] for a mirrored picture.
pub fn write_colmap_model(folder: &Path, frames: &[Frame], points: &[SparsePoint]) -> Result<(), FrameError> {
    std::fs::create_dir_all(folder).map_err(|source| FrameError::Io { path: folder.to_owned(), source })?;
    let mut cameras: Vec<Camera> = Vec::new();
    let mut images = String::from(
        "# Image list: IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME; then a line for POINTS2D[]\n",
    );
    let mut count = 0;
    for frame in frames {
        let stored =
            stored_camera(frame).map_err(|source| FrameError::Geometry { path: folder.join(&frame.name), source })?;
        let Some((camera, pose)) = stored else { continue };
        count += 1;
        let known = cameras.iter().rposition(|&other| other == camera);
        let camera = known.unwrap_or_else(|| {
            cameras.push(camera);
            cameras.len() - 1
        });
        write_image(&mut images, count, camera + 1, &pose, &frame.name);
    }
    write(&folder.join("cameras.txt"), &camera_list(&cameras))?;
    write(&folder.join("images.txt"), &images)?;
    write(&folder.join("points3D.txt"), &point_list(points))
}

fn write_image(images: &mut String, id: usize, camera: usize, pose: &Pose, name: &str) {
    let (q, t) = (pose.rotation, pose.translation);
    let _ = writeln!(images, "{id} {} {} {} {} {} {} {} {camera} {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
}

fn camera_list(cameras: &[Camera]) -> String {
    let mut text = String::from("# Camera list: CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for (i, camera) in cameras.iter().enumerate() {
        let (model, parameters) = model_and_parameters(camera);
        let _ = write!(text, "{} {model} {} {}", i + 1, camera.width, camera.height);
        for parameter in parameters {
            let _ = write!(text, " {parameter}");
        }
        text.push('\n');
    }
    text
}

fn point_list(points: &[SparsePoint]) -> String {
    let mut text = String::from("# 3D point list: POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n");
    for (i, SparsePoint { position: x, color: [r, g, b] }) in points.iter().enumerate() {
        let _ = writeln!(text, "{} {} {} {} {r} {g} {b} -1", i + 1, x.x, x.y, x.z);
    }
    text
}

fn write(path: &Path, text: &str) -> Result<(), FrameError> {
    std::fs::write(path, text).map_err(|source| FrameError::Io { path: path.to_owned(), source })
}
