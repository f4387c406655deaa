use glam::{DQuat, DVec3};

use super::recording::Recording;
use super::room::{camera, hand_at, seen, seen_through};
use crate::rgbd::{Calibration, calibrate};
use crate::sfm::matching::NearestMatcher;
use ostra_core::job::Progress;
use ostra_frames::{DepthCamera, DepthSource, FrameStore};
use ostra_geometry::{Camera, Distortion, Pose};

/// Returns the images' camera of a typical sensor: a shorter focal length, next to that of the
/// depths and slightly rotated.
fn adjacent() -> (Camera, Pose) {
    let image_camera = Camera::pinhole(320, 240, [264.0, 264.0], [159.8, 119.6]);
    let image_from_depth = Pose {
        rotation: DQuat::from_rotation_z(0.006),
        translation: DVec3::new(-0.026, 0.001, 0.0),
    };
    (image_camera, image_from_depth)
}

/// Returns a recording by two cameras next to each other; the true poses are those of the images.
fn by_two_cameras(steps: usize) -> Recording {
    by_two_cameras_at((0..steps).map(|step| step as f64))
}

/// Returns the same with the hand at these steps of its path.
fn by_two_cameras_at(steps: impl Iterator<Item = f64>) -> Recording {
    let (image_camera, image_from_depth) = adjacent();
    let mut recording = Recording::new();
    for (step, at) in steps.enumerate() {
        let depth_pose = hand_at(at);
        let pose = image_from_depth.compose(&depth_pose);
        let (image, _) = seen_through(&image_camera, &pose, 0.0, 0);
        let (_, depth) = seen(&depth_pose, 0.0015, step as u64);
        recording.add(&(image, depth), pose);
    }
    recording
}

fn found(recording: &Recording) -> Vec<Calibration> {
    calibrate(
        &recording.frames,
        &FrameStore::new(64 << 20),
        &Progress::default(),
    )
    .unwrap()
}

/// Returns the error of the image's corners for points at a depth, in pixels.
fn off_px(found: &Calibration, depth: f64) -> f64 {
    let (image_camera, image_from_depth) = adjacent();
    let off = |x: f64, y: f64| {
        let point = camera().unproject(glam::DVec2::new(x, y)).extend(1.0) * depth;
        let truth = image_camera
            .project(image_from_depth.transform(point))
            .unwrap();
        truth.distance(
            found
                .image
                .project(found.depth.image_from_depth.transform(point))
                .unwrap(),
        )
    };
    [
        off(0.0, 0.0),
        off(320.0, 0.0),
        off(0.0, 240.0),
        off(320.0, 240.0),
    ]
    .into_iter()
    .fold(0.0, f64::max)
}

#[test]
fn shifted_image_camera_is_found_and_the_recording_placed_by_it() {
    let mut recording = by_two_cameras(18);
    let calibrations = found(&recording);
    assert_eq!(calibrations.len(), 1);
    let calibration = &calibrations[0];
    assert_eq!(calibration.frames, (0..18).collect::<Vec<_>>());
    assert_eq!(
        calibration.depth.intrinsics,
        camera(),
        "the depths' camera is the one that was given"
    );
    // Without calibration the corners are up to 21 pixels off. Most points are at 2.4 m. The shift
    // of the camera is hardly constrained, so that near points are farther off.
    for (depth, most_px) in [(2.4, 2.5), (1.2, 6.0)] {
        let off = off_px(calibration, depth);
        println!("images not aligned with their depths: {off:.2} px off at {depth} m");
        assert!(off < most_px, "{off} px at {depth} m: {calibration}");
    }
    calibration.apply(&mut recording.frames);
    let result = recording.register(&NearestMatcher::for_bytes(), 1).unwrap();
    assert_eq!(result.cameras.len(), 18);
    assert!(
        result
            .cameras
            .values()
            .all(|camera| camera.intrinsics == calibration.image)
    );
    let all: Vec<usize> = result.cameras.keys().copied().collect();
    for (frame, off, turn) in recording.errors(&result, &all) {
        assert!(
            off < 0.01 && turn < 0.3,
            "frame {frame}: {off} m, {turn} deg"
        );
    }
    assert_eq!(found(&recording), [], "what has cameras of its own is left");
}

#[test]
fn images_aligned_with_their_depths_stay_unchanged() {
    assert_eq!(found(&Recording::of(0..18)), []);
}

#[test]
fn further_frames_of_a_known_sensor_take_its_cameras() {
    let mut recording = by_two_cameras(18);
    let whole = found(&recording).remove(0);
    Calibration {
        frames: (0..16).collect(),
        ..whole
    }
    .apply(&mut recording.frames);
    // Two frames alone would not be enough.
    assert_eq!(
        found(&recording),
        [Calibration {
            frames: vec![16, 17],
            ..whole
        }]
    );
    // Cameras given for some frames say nothing about others.
    let depth = DepthCamera {
        estimated: false,
        ..whole.depth
    };
    Calibration {
        frames: (0..16).collect(),
        depth,
        ..whole
    }
    .apply(&mut recording.frames);
    assert_eq!(found(&recording), []);
}

#[test]
fn too_few_frames_and_calibrated_lenses_stay_unchanged() {
    assert_eq!(found(&by_two_cameras(5)), []);
    let mut recording = by_two_cameras(18);
    for frame in &mut recording.frames {
        frame.camera.as_mut().unwrap().intrinsics.distortion =
            Distortion::Radial { k: [0.01, 0.0] };
    }
    assert_eq!(found(&recording), []);
}

#[test]
fn sensor_that_hardly_moves_gives_no_calibration() {
    for (frames, speed) in [(8, 0.05), (16, 0.02)] {
        let found = found(&by_two_cameras_at(
            (0..frames).map(|step| speed * f64::from(step)),
        ));
        assert_eq!(found, [], "{frames} frames at {speed}");
    }
}

#[test]
fn depth_of_another_size_is_projected_to_the_images() {
    let (image_camera, image_from_depth) = adjacent();
    let mut recording = by_two_cameras(1);
    let larger = Camera {
        width: 640,
        height: 480,
        focal_px: 2.0 * image_camera.focal_px,
        principal_px: 2.0 * image_camera.principal_px,
        ..image_camera
    };
    let (image, exact) = seen_through(&larger, &recording.truth[0], 0.0, 0);
    let (_, depth) = seen(&hand_at(0.0), 0.0, 0);
    recording.add(&(image, depth), recording.truth[0]);
    let frame = &mut recording.frames[1];
    frame.camera.as_mut().unwrap().intrinsics = larger;
    let Some(DepthSource::Sensor { camera: own, .. }) = &mut frame.depth else {
        panic!("a sensor's")
    };
    *own = Some(Box::new(DepthCamera {
        intrinsics: camera(),
        image_from_depth,
        estimated: false,
    }));
    let seen = FrameStore::new(64 << 20).depth(frame).unwrap().unwrap();
    let mut off: Vec<f32> = seen
        .depths
        .iter()
        .zip(&exact.depths)
        .filter(|(seen, _)| **seen > 0.0)
        .map(|(a, b)| (a - b).abs())
        .collect();
    assert!(off.len() > 640 * 480 * 8 / 10, "{} pixels known", off.len());
    off.sort_by(f32::total_cmp);
    assert!(
        off[off.len() * 95 / 100] < 0.002,
        "{} m",
        off[off.len() * 95 / 100]
    );
}
