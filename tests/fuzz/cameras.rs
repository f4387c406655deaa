//! Fuzz targets for files of cameras, poses, intrinsics and sparse points.

use std::path::Path;

use ostra_core::job::Progress;
use ostra_frames::cameras::{
    DepthCameraSource, GivenCameras, IntrinsicsSource, attach_intrinsics, read_sparse_model,
    read_sparse_points,
};
use ostra_frames::{Frame, FrameFolder, OpenRequest, open};

use crate::harness::{Seed, fuzz};
use crate::seeds;

/// Returns four frames of 16 × 12 pixels, `0.png` to `3.png`.
fn frames() -> Vec<Frame> {
    let folder = tempfile::tempdir().unwrap();
    for k in 0..4 {
        std::fs::write(folder.path().join(format!("{k}.png")), seeds::color_png()).unwrap();
    }
    let sources = vec![FrameFolder::from(folder.path().to_owned())];
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

/// Fuzzes a COLMAP model of several files, one of them damaged.
fn fuzz_model(name: &str, files: &[Seed]) {
    let frames = frames();
    fuzz!(name, 8000, files.to_vec(), |folder, _| {
        if let Ok(given) = GivenCameras::read(folder) {
            let _ = given.match_to(&mut frames.clone());
        }
        let _ = read_sparse_model(folder, &frames);
        let _ = read_sparse_points(folder);
    });
}

#[test]
fn colmap_text() {
    fuzz_model("COLMAP text", &seeds::colmap_text());
}

#[test]
fn colmap_binary() {
    fuzz_model("COLMAP binary", &seeds::colmap_binary());
}

#[test]
fn camera_files() {
    let frames = frames();
    fuzz!(
        "camera files",
        20_000,
        seeds::camera_files(),
        |folder, seed| {
            let read = |path: &Path| {
                if let Ok(given) = GivenCameras::read(path) {
                    let _ = given.match_to(&mut frames.clone());
                }
            };
            read(&folder.join(&seed.path));
            if let Some(above) = Path::new(&seed.path)
                .parent()
                .filter(|above| !above.as_os_str().is_empty())
            {
                read(&folder.join(above));
            }
        }
    );
}

#[test]
fn intrinsics() {
    let frames = frames();
    fuzz!("intrinsics", 10_000, seeds::intrinsics(), |folder, seed| {
        let path = folder.join(&seed.path);
        if let Ok(given) = IntrinsicsSource::File(path.clone()).read() {
            let _ = attach_intrinsics(&mut frames.clone(), &given);
        }
        let depth_camera = DepthCameraSource {
            intrinsics: IntrinsicsSource::Values([20.0, 20.0, 8.0, 6.0]),
            pose: Some(path),
        };
        let _ = depth_camera.read();
        let _ = String::from_utf8_lossy(&seed.bytes).parse::<IntrinsicsSource>();
    });
}
