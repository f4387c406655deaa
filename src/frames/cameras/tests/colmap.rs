use glam::{DVec2, DVec3};
use proptest::prelude::*;

use super::{assert_near, frame, frames, pose, write};
use crate::cameras::{
    GivenCameras, ModelEncoding, SparseKeypoint, SparsePoint, SparsePoints, read_sparse_model,
    read_sparse_points, write_colmap_model,
};
use crate::{Frame, FrameCamera};
use ostra_geometry::{Camera, Distortion};

fn models() -> [Distortion; 6] {
    [
        Distortion::None,
        Distortion::Radial { k: [0.1, -0.02] },
        Distortion::OpenCv {
            k: [0.1, 0.2],
            p: [0.3, 0.4],
        },
        Distortion::FullOpenCv {
            k: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6],
            p: [0.7, 0.8],
        },
        Distortion::OpenCvFisheye {
            k: [0.1, 0.2, 0.3, 0.4],
        },
        Distortion::ThinPrismFisheye {
            k: [0.1, 0.2, 0.3, 0.4],
            p: [0.5, 0.6],
            s: [0.7, 0.8],
        },
    ]
}

/// Returns one frame per model and orientation, each with a camera.
fn with_cameras() -> Vec<Frame> {
    let mut all = Vec::new();
    for (i, distortion) in models().into_iter().enumerate() {
        for orientation in [1u8, 3, 6, 8] {
            let mut frame = frame(&format!("a b/{i}_{orientation}.jpg"), 640, 480, orientation);
            let camera = Camera {
                distortion,
                ..Camera::pinhole(640, 480, [500.5, 500.5], [320.25, 239.75])
            };
            let pose = pose(all.len() as u32);
            frame.camera = Some(FrameCamera::given(camera, Some(pose)));
            all.push(frame);
        }
    }
    all
}

/// Returns two points that the first frames see.
fn sparse() -> SparsePoints {
    let points = vec![
        SparsePoint {
            position: DVec3::new(0.1, -2.0 / 3.0, 1e-9),
            color: [1, 2, 255],
            error_px: Some(0.1 + 0.2),
        },
        SparsePoint {
            position: DVec3::new(4.0, 5.0, 6.0),
            color: [0, 0, 0],
            error_px: None,
        },
    ];
    let keypoint = |x: f64, y: f64, point| SparseKeypoint {
        at_px: DVec2::new(x, y),
        point,
    };
    let keypoints = (0..4).map(|frame| {
        let shift = frame as f64;
        (
            frame,
            vec![
                keypoint(10.25 + shift, 20.5, Some(1)),
                keypoint(3.0, 4.0, None),
                keypoint(400.0, 300.0, Some(0)),
            ],
        )
    });
    SparsePoints {
        points,
        keypoints: keypoints.chain([(4, Vec::new())]).collect(),
    }
}

#[test]
fn written_model_is_read_back() {
    for encoding in [ModelEncoding::Text, ModelEncoding::Binary] {
        let folder = tempfile::tempdir().unwrap();
        let mut expected = with_cameras();
        write_colmap_model(
            &folder.path().join("sparse/0"),
            &expected,
            &sparse(),
            encoding,
        )
        .unwrap();
        assert_eq!(read_sparse_points(folder.path()).unwrap(), sparse().points);

        let mut read: Vec<Frame> = expected
            .iter()
            .map(|frame| Frame {
                camera: None,
                ..frame.clone()
            })
            .collect();
        assert!(
            GivenCameras::read(folder.path())
                .unwrap()
                .match_to(&mut read)
                .unwrap()
                .is_empty()
        );
        for (read, expected) in read.iter().zip(&mut expected) {
            let (read, expected) = (read.camera.unwrap(), expected.camera.unwrap());
            assert_eq!(read.intrinsics, expected.intrinsics);
            assert_near(
                &read.camera_from_world.unwrap(),
                &expected.camera_from_world.unwrap(),
            );
        }
    }
}

#[test]
fn keypoints_are_read_back_in_the_shown_image() {
    let folder = tempfile::tempdir().unwrap();
    let frames = with_cameras();
    write_colmap_model(folder.path(), &frames, &sparse(), ModelEncoding::Text).unwrap();
    let read = read_sparse_model(folder.path(), &frames).unwrap();
    assert_eq!(read.points, sparse().points);
    for (frame, keypoints) in sparse().keypoints {
        assert_eq!(read.keypoints[&frame], keypoints, "frame {frame}");
    }
    assert_eq!(read.tracks()[0], [(0, 2), (1, 2), (2, 2), (3, 2)]);
    let text = std::fs::read_to_string(folder.path().join("points3D.txt")).unwrap();
    assert!(
        text.contains("\n2 4 5 6 0 0 0 -1 1 0 2 0 3 0 4 0\n"),
        "{text}"
    );
    // The third frame is shown rotated clockwise: stored (x, y) = (y shown, h stored − x shown).
    let images = std::fs::read_to_string(folder.path().join("images.txt")).unwrap();
    assert!(
        images.lines().nth(6).unwrap().starts_with("20.5 627.75 2 "),
        "{images}"
    );
}

proptest! {
    #[test]
    fn upright_cameras_are_read_back_bit_for_bit(
        f in 1.0..1e4f64, c in -1e3..1e4f64, t in -1e6..1e6f64, q in prop::array::uniform4(-1.0..1.0f64),
    ) {
        let rotation = glam::DQuat::from_array(q);
        prop_assume!(rotation.length() > 0.1);
        let pose = ostra_geometry::Pose { rotation: rotation.normalize(), translation: DVec3::new(t, 1.0 / t, f) };
        let intrinsics = Camera::pinhole(640, 480, [f, 1.1 * f], [c, 0.3 * c]);
        let mut all = frames(&["x.png"]);
        all[0].camera = Some(FrameCamera::given(intrinsics, Some(pose)));
        let folder = tempfile::tempdir().unwrap();
        write_colmap_model(folder.path(), &all, &SparsePoints::default(), ModelEncoding::Text).unwrap();
        let mut read = frames(&["x.png"]);
        GivenCameras::read(folder.path()).unwrap().match_to(&mut read).unwrap();
        prop_assert_eq!(&read, &all);
    }
}

#[test]
fn equal_cameras_are_written_once_and_frames_without_pose_are_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = frames(&["0.png", "1.png", "2.png"]);
    let intrinsics = Camera::pinhole(640, 480, [500.0, 500.0], [320.0, 240.0]);
    for (i, frame) in all.iter_mut().enumerate() {
        frame.camera = Some(FrameCamera::given(intrinsics, (i < 2).then(|| pose(1))));
    }
    write_colmap_model(
        folder.path(),
        &all,
        &SparsePoints::default(),
        ModelEncoding::Text,
    )
    .unwrap();
    let text = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(
        text("cameras.txt").lines().skip(1).collect::<Vec<_>>(),
        ["1 PINHOLE 640 480 500 500 320 240"]
    );
    assert!(text("images.txt").contains(" 1 1.png\n") && !text("images.txt").contains("2.png"));
}

/// Returns a binary model of one SIMPLE_RADIAL camera and one image with one 2-D point.
pub(super) fn binary_model() -> [Vec<u8>; 3] {
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(7u32.to_le_bytes());
    cameras.extend(2i32.to_le_bytes());
    [640u64, 480]
        .iter()
        .for_each(|v| cameras.extend(v.to_le_bytes()));
    [500.0f64, 320.0, 240.0, 0.01]
        .iter()
        .for_each(|v| cameras.extend(v.to_le_bytes()));
    let mut images = 1u64.to_le_bytes().to_vec();
    images.extend(3u32.to_le_bytes());
    let (q, t) = (pose(2).rotation, pose(2).translation);
    [q.w, q.x, q.y, q.z, t.x, t.y, t.z]
        .iter()
        .for_each(|v| images.extend(v.to_le_bytes()));
    images.extend(7u32.to_le_bytes());
    images.extend(b"b.png\0");
    images.extend(1u64.to_le_bytes());
    [1.0f64, 2.0]
        .iter()
        .for_each(|v| images.extend(v.to_le_bytes()));
    images.extend(u64::MAX.to_le_bytes());
    let mut points = 1u64.to_le_bytes().to_vec();
    points.extend(9u64.to_le_bytes());
    [1.0f64, 2.0, 3.0]
        .iter()
        .for_each(|v| points.extend(v.to_le_bytes()));
    points.extend([10, 20, 30]);
    points.extend(0.5f64.to_le_bytes());
    points.extend(2u64.to_le_bytes());
    points.extend([0; 16]);
    [cameras, images, points]
}

#[test]
fn binary_model_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let [cameras, images, points] = binary_model();
    write(folder.path(), "sparse/cameras.bin", cameras);
    write(folder.path(), "sparse/images.bin", images);
    write(folder.path(), "sparse/points3D.bin", points);
    let mut all = frames(&["a.png", "b.png"]);
    let warnings = GivenCameras::read(folder.path())
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    assert!(
        warnings.len() == 1
            && warnings[0].starts_with("1 of 2 frames")
            && warnings[0].ends_with("a.png")
    );
    assert_eq!(all[0].camera, None);
    let (camera, found) = all[1].posed_camera().unwrap();
    assert_eq!(camera.focal_px, DVec2::splat(500.0));
    assert_eq!(camera.distortion, Distortion::Radial { k: [0.01, 0.0] });
    assert_eq!(*found, pose(2));
    let points = read_sparse_points(folder.path()).unwrap();
    assert_eq!(
        points,
        [SparsePoint {
            position: DVec3::new(1.0, 2.0, 3.0),
            color: [10, 20, 30],
            error_px: Some(0.5)
        }]
    );
}

#[test]
fn text_model_may_have_points_comments_and_names_with_spaces() {
    let folder = tempfile::tempdir().unwrap();
    write(
        folder.path(),
        "cameras.txt",
        "# c\n1 SIMPLE_PINHOLE 640 480 500 320 240\n",
    );
    write(
        folder.path(),
        "images.txt",
        "# c\n1 2 0 0 0 1 2 3 1 my pictures/a 1.png\n1.5 2.5 -1 3 4 7\n2 1 0 0 0 4 5 6 1 b.png",
    );
    let mut all = frames(&["my pictures/a 1.png", "b.png"]);
    GivenCameras::read(&folder.path().join("images.txt"))
        .unwrap()
        .match_to(&mut all)
        .unwrap();
    let (_, first) = all[0].posed_camera().unwrap();
    assert_eq!(first.translation, DVec3::new(1.0, 2.0, 3.0));
    assert_eq!(first.rotation.w, 1.0, "a quaternion is normalised");
    assert_eq!(
        all[1].posed_camera().unwrap().1.translation,
        DVec3::new(4.0, 5.0, 6.0)
    );
}
