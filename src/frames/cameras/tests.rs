//! Tests of camera formats, broken files and matching, on files written by the tests.

mod broken;
mod colmap;
mod formats;
mod matching;

use std::path::Path;

use glam::{DQuat, DVec3};

use crate::{Frame, ImageSource, Orientation};
use ostra_geometry::Pose;

/// Returns frames of 640×480 as shown, whose files are never opened.
fn frames(names: &[&str]) -> Vec<Frame> {
    names.iter().map(|name| frame(name, 640, 480, 1)).collect()
}

fn frame(name: &str, width: u32, height: u32, orientation: u8) -> Frame {
    let image = ImageSource::File {
        path: Path::new("/pictures").join(name),
        orientation: Orientation(orientation),
    };
    Frame {
        name: name.into(),
        width,
        height,
        image,
        depth: None,
        camera: None,
    }
}

/// Returns a pose that differs in every component from camera to camera.
fn pose(i: u32) -> Pose {
    let i = f64::from(i);
    let rotation = DQuat::from_rotation_y(0.3 * i)
        * DQuat::from_rotation_x(0.2)
        * DQuat::from_rotation_z(-0.1 * i);
    Pose {
        rotation,
        translation: DVec3::new(0.1 * i, -0.2, 1.0 + i),
    }
}

fn assert_near(found: &Pose, expected: &Pose) {
    let same = found.matrix().abs_diff_eq(expected.matrix(), 1e-9);
    assert!(same, "{found:?} is not {expected:?}");
}

/// Returns the four rows of a camera-to-world matrix as text.
fn world_from_camera_text(pose: &Pose) -> String {
    let rows = pose.inverse().matrix().transpose().to_cols_array_2d();
    rows.map(|row| row.map(|v| v.to_string()).join(" "))
        .join("\n")
}

fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, content).unwrap();
}
