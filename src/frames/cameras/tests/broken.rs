use std::path::Path;

use super::colmap::binary_model;
use super::write;
use crate::frames::cameras::{GivenCameras, read_sparse_points};

/// The one-line error of reading `path`.
fn error_of(path: &Path) -> String {
    let error = GivenCameras::read(path).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// The error of reading a single file of this name and content.
fn error_in(name: &str, content: impl AsRef<[u8]>) -> String {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), name, content);
    error_of(&folder.path().join(name))
}

const CAMERA: &str = "1 PINHOLE 640 480 500 500 320 240\n";

fn colmap_error(cameras: &str, images: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "cameras.txt", cameras);
    write(folder.path(), "images.txt", images);
    error_of(folder.path())
}

#[test]
fn every_cut_of_a_binary_model_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let [cameras, images, points] = binary_model();
    let store = |cameras: &[u8], images: &[u8], points: &[u8]| {
        write(folder.path(), "cameras.bin", cameras);
        write(folder.path(), "images.bin", images);
        write(folder.path(), "points3D.bin", points);
    };
    for cut in 0..cameras.len() {
        store(&cameras[..cut], &images, &points);
        assert!(error_of(folder.path()).contains("cameras.bin"), "cut at {cut}");
    }
    for cut in 0..images.len() {
        store(&cameras, &images[..cut], &points);
        assert!(error_of(folder.path()).contains("images.bin"), "cut at {cut}");
    }
    for cut in 0..points.len() {
        store(&cameras, &images, &points[..cut]);
        assert!(read_sparse_points(folder.path()).unwrap_err().to_string().contains("points3D.bin"), "cut at {cut}");
    }
}

#[test]
fn huge_counts_and_unknown_models_in_binary_files() {
    let folder = tempfile::tempdir().unwrap();
    let [mut cameras, mut images, _] = binary_model();
    write(folder.path(), "cameras.bin", &cameras);
    let points_at = images.len() - 32;
    for count in [u64::MAX, u64::MAX / 24 + 1, 1 << 40] {
        images[points_at..points_at + 8].copy_from_slice(&count.to_le_bytes());
        write(folder.path(), "images.bin", &images);
        assert!(error_of(folder.path()).contains("ends too early"));
    }
    for (model, name) in [(7i32, "FOV"), (11, "RAD_TAN_THIN_PRISM_FISHEYE"), (99, "number 99"), (-1, "number -1")] {
        cameras[12..16].copy_from_slice(&model.to_le_bytes());
        write(folder.path(), "cameras.bin", &cameras);
        assert!(error_of(folder.path()).contains(name));
    }
}

#[test]
fn broken_colmap_text() {
    let image = "1 1 0 0 0 0 0 0 1 a.png\n\n";
    for (cameras, images, expected) in [
        ("1 FOV 640 480 500 500 320 240 0.1\n", image, "FOV"),
        ("1 PINHOLE 640 480 500 500 320\n", image, "4 parameters, not 3"),
        ("1 PINHOLE 0 480 500 500 320 240\n", image, "picture size"),
        ("1 PINHOLE 99999999999 480 500 500 320 240\n", image, "picture size"),
        ("1 PINHOLE 640 480 500 500 320 x\n", image, "'x'"),
        ("1 PINHOLE 640 480 NaN 500 320 240\n", image, "finite"),
        (CAMERA, "1 NaN 0 0 0 0 0 0 1 a.png\n\n", "finite"),
        (CAMERA, "1 1 0 0 0 0 inf 0 1 a.png\n\n", "finite"),
        (CAMERA, "1 0 0 0 0 0 0 0 1 a.png\n\n", "no rotation"),
        (CAMERA, "1 1 0 0 0 0 0 0 2 a.png\n\n", "camera 2"),
        (CAMERA, "1 1 0 0 0 0 0 0 1\n\n", "no name"),
        (CAMERA, "1 1 0 0\n\n", "ends too early"),
        (CAMERA, "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png\n", "line 2"),
        (CAMERA, "# nothing\n", "no cameras"),
    ] {
        let error = colmap_error(cameras, images);
        assert!(error.contains(expected), "'{error}' does not say '{expected}'");
    }
}

#[test]
fn broken_files_of_other_formats() {
    for (name, content, expected) in [
        ("transforms.json", "{\"frames\": [", "transforms.json"),
        ("transforms.json", "{}", "frames"),
        ("transforms.json", r#"{"frames": []}"#, "no cameras"),
        ("transforms.json", r#"{"frames": [{"file_path": "a", "transform_matrix": [[1, 0], [0]]}]}"#, "not 4x4"),
        (
            "transforms.json",
            r#"{"fl_x": 1, "camera_model": "EQUIRECTANGULAR", "frames": [{"file_path": "a",
                "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]}"#,
            "EQUIRECTANGULAR",
        ),
        ("t.txt", "1.5 0 0 0 0 0 0 NaN\n", "line 1"),
        ("t.txt", "1.5 0 0 0 0 0 0 1\n2.5 0 0\n", "line 2"),
        ("t.txt", "nan 0 0 0 0 0 0 1\n", "time"),
        ("t.log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n", "cut off"),
        ("t.log", "0 0 1\n1 0 0 0\n0 1 0 nan\n0 0 1 0\n0 0 0 1\n", "finite"),
        ("t.log", "0 0 1\n2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "no rotation"),
        ("x_par.txt", "2\na.png 1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1 0 0 0\n", "2 cameras are announced, 1 follow"),
        ("x.txt", "a b c d e f\n", "no file of cameras"),
        ("x.txt", "", "empty"),
    ] {
        let error = error_in(name, content);
        assert!(error.contains(expected), "'{error}' does not say '{expected}'");
    }
    assert!(error_in("x.txt", [0xff, 0xfe, 0x00]).contains("not a text file"));
}

#[test]
fn broken_folders() {
    let folder = tempfile::tempdir().unwrap();
    assert!(error_of(&folder.path().join("missing")).contains("cannot be read"));
    assert!(error_of(folder.path()).contains("holds no cameras"));
    write(folder.path(), "a/pos_001.txt", "1 0 0 0 0 1 0 0 0 0 0 0");
    assert!(error_of(&folder.path().join("a")).contains("no projection"));
    write(folder.path(), "b/pos_001.txt", "1 0 0 0 0 nan 0 0 0 0 1 0");
    assert!(error_of(&folder.path().join("b")).contains("finite"));
    write(folder.path(), "c/0.pose.txt", "1 0 0 0 0 1 0 0 0 0 1");
    assert!(error_of(&folder.path().join("c")).contains("11 numbers"));
    write(folder.path(), "d/0.pose.txt", "nan ".repeat(16));
    assert!(error_of(&folder.path().join("d")).contains("finite"));
    write(folder.path(), "f/0.pose.txt", "-inf ".repeat(16));
    assert!(error_of(&folder.path().join("f")).contains("holds no cameras"), "a frame that was lost");
    write(folder.path(), "e/images.txt", "");
    assert!(error_of(&folder.path().join("e/images.txt")).contains("one part of a COLMAP model"));
}
