use std::path::Path;

use super::colmap::binary_model;
use super::{frames, write};
use crate::Frame;
use crate::cameras::{CameraKey, GivenCameras, attach_intrinsics, read_sparse_points};

/// Returns the one-line error of reading `path`.
fn error_of(path: &Path) -> String {
    let error = GivenCameras::read(path).unwrap_err().to_string();
    assert!(!error.contains('\n'), "{error}");
    error
}

/// Returns the error of reading a single file of this name and content.
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
fn every_truncation_of_a_binary_model_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let [cameras, images, points] = binary_model();
    let store = |cameras: &[u8], images: &[u8], points: &[u8]| {
        write(folder.path(), "cameras.bin", cameras);
        write(folder.path(), "images.bin", images);
        write(folder.path(), "points3D.bin", points);
    };
    for cut in 0..cameras.len() {
        store(&cameras[..cut], &images, &points);
        assert!(
            error_of(folder.path()).contains("cameras.bin"),
            "cut at {cut}"
        );
    }
    for cut in 0..images.len() {
        store(&cameras, &images[..cut], &points);
        assert!(
            error_of(folder.path()).contains("images.bin"),
            "cut at {cut}"
        );
    }
    for cut in 0..points.len() {
        store(&cameras, &images, &points[..cut]);
        assert!(
            read_sparse_points(folder.path())
                .unwrap_err()
                .to_string()
                .contains("points3D.bin"),
            "cut at {cut}"
        );
    }
}

#[test]
fn huge_counts_and_unknown_models_in_binary_files_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let [mut cameras, mut images, _] = binary_model();
    write(folder.path(), "cameras.bin", &cameras);
    let points_at = images.len() - 32;
    for count in [u64::MAX, u64::MAX / 24 + 1, 1 << 40] {
        images[points_at..points_at + 8].copy_from_slice(&count.to_le_bytes());
        write(folder.path(), "images.bin", &images);
        assert!(error_of(folder.path()).contains("ends too early"));
    }
    let [_, images, _] = binary_model();
    write(folder.path(), "images.bin", &images);
    for (model, parameters, name) in [
        (7i32, 5, "FOV"),
        (11, 16, "RAD_TAN_THIN_PRISM_FISHEYE"),
        (12, 4, "SIMPLE_DIVISION"),
        (17, 2, "EQUIRECTANGULAR"),
        (99, 4, "number 99"),
        (-1, 4, "number -1"),
    ] {
        cameras[12..16].copy_from_slice(&model.to_le_bytes());
        cameras.resize(32 + 8 * parameters, 0);
        write(folder.path(), "cameras.bin", &cameras);
        let error = error_of(folder.path());
        assert!(
            error.contains(&format!("camera model {name} is not supported")),
            "{error}"
        );
    }
}

#[test]
fn broken_colmap_text_is_an_error() {
    let image = "1 1 0 0 0 0 0 0 1 a.png\n\n";
    for (cameras, images, expected) in [
        ("1 FOV 640 480 500 500 320 240 0.1\n", image, "FOV"),
        (
            "1 PINHOLE 640 480 500 500 320\n",
            image,
            "4 parameters, not 3",
        ),
        (
            "1 PINHOLE 0 480 500 500 320 240\n",
            image,
            "image size of 0 × 480",
        ),
        (
            "1 PINHOLE 4000000000 480 500 500 320 240\n",
            image,
            "image size of 4000000000 × 480",
        ),
        ("1 PINHOLE 640 480 500 500 320 x\n", image, "'x'"),
        ("1 PINHOLE 640 480 NaN 500 320 240\n", image, "finite"),
        (CAMERA, "1 NaN 0 0 0 0 0 0 1 a.png\n\n", "finite"),
        (CAMERA, "1 1 0 0 0 0 inf 0 1 a.png\n\n", "finite"),
        (CAMERA, "1 0 0 0 0 0 0 0 1 a.png\n\n", "not a rotation"),
        (CAMERA, "1 1 0 0 0 0 0 0 2 a.png\n\n", "camera 2"),
        (CAMERA, "1 1 0 0 0 0 0 0 1\n\n", "no name"),
        (CAMERA, "1 1 0 0\n\n", "ends too early"),
        (
            CAMERA,
            "1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png\n",
            "line 2",
        ),
        (CAMERA, "# nothing\n", "no cameras"),
    ] {
        let error = colmap_error(cameras, images);
        assert!(
            error.contains(expected),
            "'{error}' does not say '{expected}'"
        );
    }
}

#[test]
fn broken_files_of_other_formats_are_errors() {
    for (name, content, expected) in [
        ("transforms.json", "{\"frames\": [", "transforms.json"),
        ("transforms.json", "{}", "frames"),
        ("transforms.json", r#"{"frames": []}"#, "no cameras"),
        (
            "transforms.json",
            r#"{"frames": [{"file_path": "a", "transform_matrix": [[1, 0], [0]]}]}"#,
            "not 4x4",
        ),
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
        (
            "t.log",
            "0 0 1\n1 0 0 0\n0 1 0 nan\n0 0 1 0\n0 0 0 1\n",
            "finite",
        ),
        (
            "t.log",
            "0 0 1\n2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n",
            "not a rotation",
        ),
        (
            "x_par.txt",
            "2\na.png 1 0 0 0 1 0 0 0 1 1 0 0 0 1 0 0 0 1 0 0 0\n",
            "2 cameras are announced, 1 follow",
        ),
        ("x.txt", "a b c d e f\n", "not a known camera file"),
        ("x.txt", "", "empty"),
    ] {
        let error = error_in(name, content);
        assert!(
            error.contains(expected),
            "'{error}' does not say '{expected}'"
        );
    }
    assert!(error_in("x.txt", [0xff, 0xfe, 0x00]).contains("not a text file"));
}

#[test]
fn unused_cameras_of_unsupported_models_are_ignored() {
    let folder = tempfile::tempdir().unwrap();
    write(
        folder.path(),
        "text/cameras.txt",
        format!("{CAMERA}2 EQUIRECTANGULAR 640 320 640 320\n3 NEW 1 1 1\n"),
    );
    write(
        folder.path(),
        "text/images.txt",
        "1 1 0 0 0 0 0 0 1 a.png\n\n",
    );
    assert!(
        GivenCameras::read(&folder.path().join("text"))
            .unwrap()
            .cameras[0]
            .camera_from_world
            .is_ok()
    );
    let [mut cameras, images, _] = binary_model();
    cameras[0] = 3;
    for (model, parameters) in [(16i32, 6), (13, 5)] {
        cameras.extend(99u32.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend([640u64, 480].iter().flat_map(|side| side.to_le_bytes()));
        cameras.extend(vec![0; 8 * parameters]);
    }
    write(folder.path(), "binary/cameras.bin", &cameras);
    write(folder.path(), "binary/images.bin", &images);
    assert!(
        GivenCameras::read(&folder.path().join("binary"))
            .unwrap()
            .cameras[0]
            .camera_from_world
            .is_ok()
    );
}

#[test]
fn json_numbers_may_be_strings_or_python_spellings() {
    let folder = tempfile::tempdir().unwrap();
    let json = r#"{"fl_x": "500", "k1": 0, "frames": [
        {"file_path": "a \"NaN.png", "transform_matrix": [[NaN, 0, 0, 0], [0, 1, 0, Infinity], [0, 0, 1, -Infinity], [0, 0, 0, 1]]},
        {"file_path": "Infinity.png", "transform_matrix": [["1", 0, 0, "2.5"], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}]}"#;
    write(folder.path(), "transforms.json", json);
    let cameras = GivenCameras::read(&folder.path().join("transforms.json"))
        .unwrap()
        .cameras;
    assert!(
        cameras[0]
            .camera_from_world
            .as_ref()
            .unwrap_err()
            .contains("a \"NaN.png: the pose has a value")
    );
    assert_eq!(cameras[1].key, CameraKey::Name("Infinity.png".into()));
    assert_eq!(
        cameras[1]
            .camera_from_world
            .as_ref()
            .unwrap()
            .inverse()
            .translation
            .x,
        2.5
    );
    let error = error_in(
        "transforms.json",
        r#"{"fl_x": 1, "k1": NaN, "frames": [{"file_path": "a",
        "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}]}"#,
    );
    assert!(error.contains("distortion"), "{error}");
}

#[test]
fn transforms_frames_without_usable_pose_or_lens_do_not_discard_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let frame = |name: &str, value: &str, more: &str| {
        format!(
            r#"{{"file_path": "{name}"{more}, "transform_matrix": [[1, 0, 0, {value}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}}"#
        )
    };
    let lost = [
        "null",
        "-NaN",
        "nan",
        "-nan(ind)",
        "1.#QNAN",
        "-1.#IND",
        "-inf",
        "1.#INF",
    ];
    let mut all: Vec<String> = lost
        .iter()
        .enumerate()
        .map(|(k, value)| frame(&k.to_string(), value, ""))
        .collect();
    all.push(frame(
        "panorama",
        "0",
        r#", "camera_model": "EQUIRECTANGULAR""#,
    ));
    all.push(frame("whole", "2.5", ""));
    write(
        folder.path(),
        "transforms.json",
        format!(r#"{{"fl_x": 500, "frames": [{}]}}"#, all.join(", ")),
    );
    let cameras = GivenCameras::read(&folder.path().join("transforms.json"))
        .unwrap()
        .cameras;
    let (whole, others) = cameras.split_last().unwrap();
    assert_eq!(
        whole
            .camera_from_world
            .as_ref()
            .unwrap()
            .inverse()
            .translation
            .x,
        2.5
    );
    for camera in others {
        let reason = camera.camera_from_world.as_ref().unwrap_err();
        assert!(
            reason.contains("finite") || reason.contains("EQUIRECTANGULAR"),
            "{reason}"
        );
    }
}

#[test]
fn damaged_and_macos_pose_files_do_not_discard_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = |x: &str| format!("1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    write(folder.path(), "._000000.txt", [0, 5, 22, 7, 0xff, 0xfe]);
    write(folder.path(), "000000.txt", "");
    write(folder.path(), "000001.txt", matrix("1"));
    write(folder.path(), "000002.txt", &matrix("2")[..20]);
    write(folder.path(), "000003.txt", matrix("-nan(ind)"));
    write(folder.path(), "000004.txt", matrix("1.#QNAN0"));
    let mut all = frames(&[
        "000000.png",
        "000001.png",
        "000002.png",
        "000003.png",
        "000004.png",
    ]);
    attach_intrinsics(&mut all, &[500.0, 500.0, 320.0, 240.0].into()).unwrap();
    let warnings = GivenCameras::read(folder.path())
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    let posed: Vec<bool> = all
        .iter()
        .map(|frame| frame.posed_camera().is_some())
        .collect();
    assert_eq!(posed, [false, true, false, false, false]);
    assert!(
        warnings.len() == 1 && warnings[0].contains("4 of 5 frames"),
        "{warnings:?}"
    );
    assert!(
        warnings[0].contains("000000.txt: holds 0 numbers"),
        "{warnings:?}"
    );
}

#[test]
fn sparse_binary_files_are_refused_without_reading_them() {
    let folder = tempfile::tempdir().unwrap();
    let [cameras, images, points] = binary_model();
    let huge = |name: &str, start: &[u8]| {
        write(folder.path(), name, start);
        std::fs::File::options()
            .write(true)
            .open(folder.path().join(name))
            .unwrap()
            .set_len(200 << 30)
            .unwrap();
    };
    write(folder.path(), "cameras.bin", &cameras);
    for start in [&[][..], &4_u64.to_le_bytes(), &u64::MAX.to_le_bytes()] {
        huge("images.bin", start);
        assert!(error_of(folder.path()).contains("images.bin"));
    }
    write(folder.path(), "images.bin", &images);
    huge("points3D.bin", &[]);
    assert!(
        read_sparse_points(folder.path())
            .unwrap_err()
            .to_string()
            .contains("points3D.bin")
    );
    write(folder.path(), "points3D.bin", &points);
    huge("cameras.bin", &[]);
    assert!(error_of(folder.path()).contains("cameras.bin"));
}

#[test]
fn lost_frame_keeps_the_numbers_of_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = |x: &str| format!("1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    let zeros = "0 0 0 0\n".repeat(4);
    let log: String = [matrix("0"), matrix("nan"), zeros, matrix("3")]
        .iter()
        .enumerate()
        .map(|(k, matrix)| format!("{k} {k} {}\n{matrix}", k + 1))
        .collect();
    write(folder.path(), "t.log", log);
    let mut all = frames(&["image1.png", "image2.png", "image3.png", "image4.png"]);
    attach_intrinsics(&mut all, &[500.0, 500.0, 320.0, 240.0].into()).unwrap();
    let warnings = GivenCameras::read(&folder.path().join("t.log"))
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    let x = |frame: &Frame| {
        frame
            .posed_camera()
            .map(|(_, pose)| pose.inverse().translation.x)
    };
    assert_eq!(
        all.iter().map(x).collect::<Vec<_>>(),
        [Some(0.0), None, None, Some(3.0)]
    );
    assert!(
        warnings.len() == 1
            && warnings[0].contains("2 of 4 frames")
            && warnings[0].contains("image2.png, image3.png")
    );
    assert_eq!(
        warnings[0].matches("not a finite number").count(),
        1,
        "{warnings:?}"
    );
}

#[test]
fn broken_folders_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    assert!(error_of(&folder.path().join("missing")).contains("cannot be read"));
    assert!(error_of(folder.path()).contains("holds no cameras"));
    write(folder.path(), "a/pos_001.txt", "1 0 0 0 0 1 0 0 0 0 0 0");
    assert!(error_of(&folder.path().join("a")).contains("not a camera projection"));
    write(folder.path(), "b/pos_001.txt", "1 0 0 0 0 nan 0 0 0 0 1 0");
    assert!(error_of(&folder.path().join("b")).contains("finite"));
    write(folder.path(), "c/0.pose.txt", "1 0 0 0 0 1 0 0 0 0 1");
    assert!(error_of(&folder.path().join("c")).contains("11 numbers"));
    write(folder.path(), "d/0.pose.txt", "nan ".repeat(16));
    assert!(error_of(&folder.path().join("d")).contains("finite"));
    write(folder.path(), "f/0.pose.txt", "-inf ".repeat(16));
    assert!(
        error_of(&folder.path().join("f")).contains("holds no cameras"),
        "a frame that was lost"
    );
    write(folder.path(), "e/images.txt", "");
    assert!(error_of(&folder.path().join("e/images.txt")).contains("one part of a COLMAP model"));
}
