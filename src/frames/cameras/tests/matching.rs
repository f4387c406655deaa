use glam::{DVec2, DVec3};

use super::{frame, frames, pose, write};
use crate::cameras::{CameraKey, GivenCamera, GivenCameras, GivenIntrinsics, attach_intrinsics};
use crate::{Frame, FrameCamera};
use ostra_geometry::Camera;

/// Returns cameras by name, distinguished by the x of their translation.
fn given(names: &[&str]) -> GivenCameras {
    let camera = |(i, name): (usize, &&str)| GivenCamera {
        key: CameraKey::Name((*name).into()),
        intrinsics: Some(GivenIntrinsics::pinhole(
            DVec2::splat(500.0),
            DVec2::new(320.0, 240.0),
        )),
        camera_from_world: Ok(pose(i as u32)),
    };
    GivenCameras {
        path: "cameras".into(),
        cameras: names.iter().enumerate().map(camera).collect(),
    }
}

fn x_of(frame: &Frame) -> Option<f64> {
    Some(frame.posed_camera()?.1.translation.x)
}

/// Returns the number of each frame's camera.
fn matched(cameras: &[&str], names: &[&str]) -> Vec<Option<usize>> {
    let mut all = frames(names);
    given(cameras).match_to(&mut all).unwrap();
    all.iter()
        .map(|frame| x_of(frame).map(|x| (10.0 * x).round() as usize))
        .collect()
}

#[test]
fn full_names_take_precedence_over_file_names() {
    assert_eq!(
        matched(&["a/1.jpg", "b/1.jpg"], &["b/1.jpg", "a/1.jpg"]),
        [Some(1), Some(0)]
    );
    assert_eq!(
        matched(&["x/a/1.jpg", "x/b/1.jpg"], &["b/1.jpg", "a/1.jpg"]),
        [Some(1), Some(0)]
    );
    assert_eq!(
        matched(&["other/1.jpg", "other/2.jpg"], &["images/2.jpg"]),
        [Some(1)]
    );
    assert_eq!(
        matched(&["1.png", "2.png"], &["1.jpg", "2.jpg"]),
        [Some(0), Some(1)]
    );
}

#[test]
fn ambiguous_file_names_are_not_guessed() {
    assert_eq!(
        matched(&["1.jpg", "2.jpg"], &["a/1.jpg", "b/1.jpg", "a/2.jpg"]),
        [None, None, Some(1)]
    );
    assert_eq!(
        matched(&["a/1.jpg", "b/1.jpg", "2.jpg"], &["1.jpg", "2.jpg"]),
        [None, Some(2)]
    );
}

#[test]
fn missing_match_names_both_sides_and_changes_nothing() {
    let mut all = frames(&["x.png", "y.png"]);
    let error = given(&["a.png", "b.png"])
        .match_to(&mut all)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a.png, b.png") && error.contains("x.png, y.png") && !error.contains('\n'),
        "{error}"
    );
    assert_eq!(all, frames(&["x.png", "y.png"]));
}

#[test]
fn wrong_size_error_names_both_sizes_and_changes_nothing() {
    let mut cameras = given(&["a.png", "b.png"]);
    for camera in &mut cameras.cameras {
        camera.intrinsics.as_mut().unwrap().size = Some([640, 480]);
    }
    let mut all = vec![frame("a.png", 640, 480, 1), frame("b.png", 320, 240, 1)];
    let error = cameras.match_to(&mut all).unwrap_err().to_string();
    assert!(
        error.contains("b.png") && error.contains("640x480") && error.contains("320x240"),
        "{error}"
    );
    assert!(all.iter().all(|frame| frame.camera.is_none()));
    // An image shown upright has the swapped size of the stored one.
    assert!(cameras.match_to(&mut [frame("a.png", 480, 640, 6)]).is_ok());
    assert!(
        cameras
            .match_to(&mut [frame("a.png", 640, 480, 6)])
            .is_err()
    );
}

#[test]
fn camera_is_rotated_with_its_image() {
    let mut all = vec![frame("a.png", 640, 480, 1), frame("b.png", 480, 640, 6)];
    let mut cameras = given(&["a.png", "b.png"]);
    cameras.cameras[1] = GivenCamera {
        key: CameraKey::Name("b.png".into()),
        ..cameras.cameras[0].clone()
    };
    cameras.match_to(&mut all).unwrap();
    let x_in_world = pose(0).inverse().transform(DVec3::new(0.2, 0.1, 1.0));
    let at = |frame: &Frame| {
        let (camera, pose) = frame.posed_camera().unwrap();
        camera.project(pose.transform(x_in_world)).unwrap()
    };
    let stored = at(&all[0]);
    assert!(at(&all[1]).abs_diff_eq(DVec2::new(480.0 - stored.y, stored.x), 1e-9));
}

#[test]
fn mirrored_image_is_refused() {
    let error = given(&["a.png"])
        .match_to(&mut [frame("a.png", 640, 480, 2)])
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a.png") && error.contains("mirrors"),
        "{error}"
    );
}

#[test]
fn poses_without_intrinsics_are_refused_until_given() {
    let mut cameras = given(&["a.png"]);
    cameras.cameras[0].intrinsics = None;
    let mut all = frames(&["a.png"]);
    assert!(!cameras.have_intrinsics());
    assert!(
        cameras
            .match_to(&mut all)
            .unwrap_err()
            .to_string()
            .contains("--intrinsics")
    );
    attach_intrinsics(&mut all, &[400.0, 401.0, 300.0, 200.0].into()).unwrap();
    cameras.match_to(&mut all).unwrap();
    let intrinsics = Camera::pinhole(640, 480, [400.0, 401.0], [300.0, 200.0]);
    assert_eq!(
        all[0].camera,
        Some(FrameCamera::given(intrinsics, Some(pose(0))))
    );
    // Intrinsics given later keep the pose.
    attach_intrinsics(&mut all, &[410.0, 401.0, 300.0, 200.0].into()).unwrap();
    assert_eq!(all[0].posed_camera().unwrap().1, &pose(0));
}

#[test]
fn one_set_of_intrinsics_fits_one_stored_size_only() {
    let mut all = vec![frame("a.png", 640, 480, 1), frame("b.png", 480, 640, 6)];
    attach_intrinsics(&mut all, &[500.0, 510.0, 300.0, 200.0].into()).unwrap();
    let turned = all[1].camera.unwrap().intrinsics;
    assert_eq!(
        turned,
        Camera::pinhole(480, 640, [510.0, 500.0], [280.0, 300.0])
    );
    all.push(frame("c.png", 480, 640, 1));
    let error = attach_intrinsics(&mut all, &[1.0; 4].into())
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("a.png") && error.contains("c.png"),
        "{error}"
    );
    assert_eq!(all[0].camera.unwrap().intrinsics.focal_px.x, 500.0);
    assert!(attach_intrinsics(&mut all[..1], &[0.0, 1.0, 1.0, 1.0].into()).is_err());
    assert!(attach_intrinsics(&mut all[..1], &[f64::NAN, 1.0, 1.0, 1.0].into()).is_err());
}

#[test]
fn unmatched_numbers_leave_frames_out_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let text: String = (0..3)
        .map(|i| format!("{i} {i} 0\n{}\n", super::world_from_camera_text(&pose(i))))
        .collect();
    write(folder.path(), "t.log", text);
    let mut all = frames(&["0001.png", "0002.png", "0005.png", "0006.png"]);
    attach_intrinsics(&mut all, &[500.0, 500.0, 320.0, 240.0].into()).unwrap();
    let warnings = GivenCameras::read(&folder.path().join("t.log"))
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    assert!(
        warnings.len() == 1 && warnings[0].ends_with("0005.png, 0006.png"),
        "{warnings:?}"
    );
    assert!(all[3].camera.unwrap().camera_from_world.is_none());
    assert_eq!(x_of(&all[0]).map(|x| (10.0 * x).round()), Some(1.0));
}
