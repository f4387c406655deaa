//! Tests of the cameras of the real data sets, read from their given formats.

use std::path::{Path, PathBuf};

use ostra_core::job::Progress;
use ostra_frames::cameras::{
    GivenCameras, ModelEncoding, SparsePoints, read_sparse_points, write_colmap_model,
};
use ostra_frames::{Frame, FrameFolder, OpenRequest, open};
use ostra_geometry::{Alignment, Pose, TrajectoryMetrics};

use crate::data::data_dir;

const SETS: [(&str, &str); 5] = [
    ("apc_shelf_rgbd_labels", "color"),
    ("redkitchen_rgbd_a", "color"),
    ("dtu_scan24", "images"),
    ("middlebury_templeSparseRing", "images"),
    ("strecha_fountain_P11", "images"),
];

fn opened(frames: PathBuf) -> Vec<Frame> {
    let sources = vec![FrameFolder {
        frames,
        depth: None,
    }];
    open(
        &OpenRequest {
            sources,
            ..OpenRequest::default()
        },
        &Progress::default(),
    )
    .unwrap()
    .frames
}

/// Returns the frames of a set with the cameras in `path`; every frame must have one.
fn with_cameras(frames: PathBuf, path: &Path) -> Vec<Frame> {
    let mut frames = opened(frames);
    let warnings = GivenCameras::read(path)
        .unwrap()
        .match_to(&mut frames)
        .unwrap();
    assert!(warnings.is_empty(), "{warnings:?}");
    frames
}

fn poses(frames: &[Frame]) -> Vec<Pose> {
    frames
        .iter()
        .map(|frame| *frame.posed_camera().unwrap().1)
        .collect()
}

/// Returns the camera matrix and `world_to_cam` of each frame in `cameras.json`, row by row.
fn stated(folder: &Path) -> Vec<(Vec<f64>, Vec<f64>)> {
    let text = std::fs::read_to_string(folder.join("cameras.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    let numbers = |rows: &serde_json::Value| -> Vec<f64> {
        rows.as_array()
            .unwrap()
            .iter()
            .flat_map(|row| row.as_array().unwrap())
            .map(|v| v.as_f64().unwrap())
            .collect()
    };
    json["frames"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| (numbers(&f["K"]), numbers(&f["world_to_cam"])))
        .collect()
}

fn colmap_models_agree_with_the_given_cameras() {
    let data = data_dir();
    for (set, images) in SETS {
        let folder = data.join(set);
        let frames = with_cameras(folder.join(images), &folder);
        for (frame, (k, world_to_cam)) in frames.iter().zip(stated(&folder)) {
            let (camera, pose) = frame.posed_camera().unwrap();
            let found = [
                camera.focal_px.x,
                camera.focal_px.y,
                camera.principal_px.x,
                camera.principal_px.y,
            ];
            for (found, stated) in found.into_iter().zip([k[0], k[4], k[2] + 0.5, k[5] + 0.5]) {
                assert!(
                    (found - stated).abs() < 1e-3,
                    "{set}/{}: {found} is not {stated}",
                    frame.name
                );
            }
            let matrix = pose.matrix().transpose().to_cols_array();
            let off = matrix
                .iter()
                .zip(&world_to_cam)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(off < 1e-3, "{set}/{}: a pose is off by {off}", frame.name);
        }
    }
}

fn middlebury_parameters_equal_the_colmap_model() {
    let data = data_dir();
    let folder = data.join("middlebury_templeSparseRing");
    let model = with_cameras(folder.join("images"), &folder.join("sparse"));
    let parameters = with_cameras(folder.join("images"), &folder.join("templeSR_par.txt"));
    let error =
        TrajectoryMetrics::between(&poses(&parameters), &poses(&model), Alignment::None).unwrap();
    assert!(
        error.centre.max < 1e-6 && error.rotation_deg.max < 1e-3,
        "{error:?}"
    );
    for (a, b) in parameters.iter().zip(&model) {
        let (a, b) = (a.camera.unwrap().intrinsics, b.camera.unwrap().intrinsics);
        assert!(
            a.principal_px.abs_diff_eq(b.principal_px, 1e-9)
                && a.focal_px.abs_diff_eq(b.focal_px, 1e-9)
        );
    }
}

fn real_models_are_written_and_read_again() {
    let data = data_dir();
    for (set, images) in SETS {
        let folder = data.join(set);
        let frames = with_cameras(folder.join(images), &folder);
        let out = tempfile::tempdir().unwrap();
        let sparse = SparsePoints::without_keypoints(read_sparse_points(&folder).unwrap());
        write_colmap_model(out.path(), &frames, &sparse, ModelEncoding::Text).unwrap();
        assert_eq!(with_cameras(folder.join(images), out.path()), frames);
    }
}

crate::registry::tests! {
    Data(&["apc_shelf_rgbd_labels", "redkitchen_rgbd_a", "dtu_scan24", "middlebury_templeSparseRing", "strecha_fountain_P11"]) =>
        colmap_models_agree_with_the_given_cameras,
        real_models_are_written_and_read_again;
    Data(&["middlebury_templeSparseRing"]) => middlebury_parameters_equal_the_colmap_model;
}
