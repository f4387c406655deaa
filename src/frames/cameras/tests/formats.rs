use std::path::Path;

use glam::{DMat3, DVec2, DVec3};

use super::{assert_near, frames, pose, world_from_camera_text, write};
use crate::cameras::{GivenCameras, attach_intrinsics};
use crate::{Frame, FrameCamera};
use ostra_geometry::{Camera, Distortion, Pose};

const INTRINSICS: [f64; 4] = [500.0, 510.0, 320.0, 240.0];

/// Returns the cameras in `path`, matched to frames that already have intrinsics.
fn matched(path: &Path, names: &[&str]) -> Vec<FrameCamera> {
    let mut all = frames(names);
    attach_intrinsics(&mut all, &INTRINSICS.into()).unwrap();
    let warnings = GivenCameras::read(path)
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    all.iter()
        .map(|frame: &Frame| frame.camera.unwrap())
        .collect()
}

fn assert_poses(cameras: &[FrameCamera], expected: &[Pose]) {
    assert_eq!(cameras.len(), expected.len());
    for (camera, expected) in cameras.iter().zip(expected) {
        assert_near(&camera.camera_from_world.unwrap(), expected);
    }
}

#[test]
fn tum_trajectories_are_matched_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let line = |time: &str, pose: Pose| {
        let (c, q) = (pose.inverse().translation, pose.inverse().rotation);
        format!(
            "{time} {} {} {} {} {} {} {}\n",
            c.x, c.y, c.z, q.x, q.y, q.z, q.w
        )
    };
    let text = [
        "# timestamp …\n".into(),
        line("1305031102.2112", pose(2)),
        line("1305031102.1758", pose(1)),
    ]
    .concat();
    write(folder.path(), "groundtruth.txt", text);
    let cameras = matched(
        &folder.path().join("groundtruth.txt"),
        &["rgb/1305031102.175304.png", "rgb/1305031102.211214.png"],
    );
    assert_poses(&cameras, &[pose(1), pose(2)]);
    assert_eq!(
        cameras[0].intrinsics,
        Camera::pinhole(640, 480, [500.0, 510.0], [320.0, 240.0])
    );
}

#[test]
fn logs_are_matched_by_number_or_order() {
    let folder = tempfile::tempdir().unwrap();
    let log = |indices: &[u32]| {
        indices
            .iter()
            .map(|&i| format!("{i} {i} {}\n{}\n", i + 1, world_from_camera_text(&pose(i))))
            .collect::<String>()
    };
    let path = folder.path().join("trajectory.log");
    std::fs::write(&path, log(&[0, 1, 2])).unwrap();
    // Tanks and Temples counts images from 1, the log from 0.
    assert_poses(
        &matched(&path, &["000001.jpg", "000002.jpg", "000003.jpg"]),
        &[pose(0), pose(1), pose(2)],
    );
    assert_poses(
        &matched(&path, &["a.jpg", "b.jpg", "c.jpg"]),
        &[pose(0), pose(1), pose(2)],
    );
    assert_poses(
        &matched(&path, &["color-000002.jpg", "color-000000.jpg"]),
        &[pose(2), pose(0)],
    );
    assert_poses(&matched(&path, &["FILM/000001"]), &[pose(1)]);
}

#[test]
fn pose_files_are_matched_by_name() {
    let folder = tempfile::tempdir().unwrap();
    for i in 0..2 {
        write(
            folder.path(),
            &format!("seven/frame-00000{i}.pose.txt"),
            world_from_camera_text(&pose(i)),
        );
        write(
            folder.path(),
            &format!("plain/{i}.txt"),
            world_from_camera_text(&pose(i)),
        );
    }
    let seven = matched(
        &folder.path().join("seven"),
        &["frame-000000.color.png", "frame-000001.color.png"],
    );
    assert_poses(&seven, &[pose(0), pose(1)]);
    assert_poses(
        &matched(&folder.path().join("plain"), &["color/1.jpg"]),
        &[pose(1)],
    );
}

fn camera_matrix() -> DMat3 {
    DMat3::from_cols(
        DVec3::X * 1500.0,
        DVec3::Y * 1510.0,
        DVec3::new(302.5, 247.0, 1.0),
    )
}

#[test]
fn middlebury_pixel_centres_are_at_whole_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let numbers = |m: DMat3| {
        m.transpose()
            .to_cols_array()
            .map(|v| v.to_string())
            .join(" ")
    };
    let t = pose(1).translation;
    let rotation = DMat3::from_quat(pose(1).rotation);
    let text = format!(
        "1\nx0001.png {} {} {} {} {}\n",
        numbers(camera_matrix()),
        numbers(rotation),
        t.x,
        t.y,
        t.z
    );
    write(folder.path(), "x_par.txt", text);
    let cameras = matched(folder.path(), &["x0001.png"]);
    assert_poses(&cameras, &[pose(1)]);
    assert_eq!(
        cameras[0].intrinsics,
        Camera::pinhole(640, 480, [1500.0, 1510.0], [303.0, 247.5])
    );
}

/// Returns the rows of `scale · K [R t]` as text.
fn projection_text(pose: &Pose, scale: f64) -> String {
    let left = scale * (camera_matrix() * DMat3::from_quat(pose.rotation));
    let right = scale * (camera_matrix() * pose.translation);
    let rows = [0, 1, 2].map(|i| {
        format!(
            "{} {} {} {}",
            left.row(i).x,
            left.row(i).y,
            left.row(i).z,
            right[i]
        )
    });
    rows.join("\n")
}

#[test]
fn dtu_projections_are_decomposed() {
    let folder = tempfile::tempdir().unwrap();
    for i in 1..=3 {
        let scale = if i == 2 { -0.37 } else { 24.0 };
        write(
            folder.path(),
            &format!("pos_00{i}.txt"),
            projection_text(&pose(i), scale),
        );
    }
    let by_number = matched(
        folder.path(),
        &["rect_003_3_r5000.png", "rect_001_3_r5000.png"],
    );
    assert_poses(&by_number, &[pose(3), pose(1)]);
    let from_zero = matched(folder.path(), &["000000.jpg", "000001.jpg"]);
    assert_poses(&from_zero, &[pose(1), pose(2)]);
    for camera in by_number.iter().chain(&from_zero) {
        let intrinsics = camera.intrinsics;
        assert!(
            intrinsics
                .focal_px
                .abs_diff_eq(DVec2::new(1500.0, 1510.0), 1e-6)
        );
        assert!(
            intrinsics
                .principal_px
                .abs_diff_eq(DVec2::new(303.0, 247.5), 1e-6)
        );
    }
}

/// Returns a camera-to-world matrix with y up and the view along −z, as nested JSON.
fn opengl_matrix(pose: &Pose) -> String {
    let flip = glam::DMat4::from_diagonal(glam::DVec4::new(1.0, -1.0, -1.0, 1.0));
    let rows = (pose.inverse().matrix() * flip)
        .transpose()
        .to_cols_array_2d();
    serde_json::to_string(&rows).unwrap()
}

#[test]
fn nerfstudio_transforms_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (opengl_matrix(&pose(1)), opengl_matrix(&pose(2)));
    let text = format!(
        r#"{{"camera_model": "OPENCV", "w": 640, "h": 480.0, "fl_x": 500, "fl_y": 510, "cx": 321, "cy": 242,
            "k1": 0.1, "k2": 0.02, "p1": 0.001, "p2": -0.002, "applied_scale": 2,
            "frames": [{{"file_path": "./images/a.png", "transform_matrix": {a}}},
                       {{"file_path": "images\\b.png", "fl_x": 600, "transform_matrix": {b}}}]}}"#
    );
    write(folder.path(), "transforms.json", text);
    let cameras = matched(folder.path(), &["a.png", "b.png"]);
    assert_poses(&cameras, &[pose(1), pose(2)]);
    let expected = Camera {
        distortion: Distortion::OpenCv {
            k: [0.1, 0.02],
            p: [0.001, -0.002],
        },
        ..Camera::pinhole(640, 480, [500.0, 510.0], [321.0, 242.0])
    };
    assert_eq!(cameras[0].intrinsics, expected);
    assert_eq!(
        cameras[1].intrinsics,
        Camera {
            focal_px: DVec2::new(600.0, 510.0),
            ..expected
        }
    );
}

#[test]
fn transforms_with_only_an_angle_of_view_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let angle = 2.0 * 0.5f64.atan();
    let matrix = opengl_matrix(&pose(1));
    let text = format!(
        r#"{{"camera_angle_x": {angle}, "frames": [{{"file_path": "./train/r_0", "transform_matrix": {matrix}}}]}}"#
    );
    write(folder.path(), "transforms_train.json", text);
    let cameras = matched(&folder.path().join("transforms_train.json"), &["r_0.png"]);
    assert_poses(&cameras, &[pose(1)]);
    let intrinsics = cameras[0].intrinsics;
    assert!(intrinsics.focal_px.abs_diff_eq(DVec2::splat(640.0), 1e-9));
    assert_eq!(intrinsics.principal_px, DVec2::new(320.0, 240.0));
}
