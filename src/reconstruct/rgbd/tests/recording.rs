use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;

use super::room::{camera, hand_at, seen};
use crate::rgbd::{
    LinkKind, OnPose, RgbdError, RgbdOptions, RgbdRequest, RgbdResult, register_rgbd,
};
use crate::sfm::matching::NearestMatcher;
use crate::sfm::{FeatureError, FeatureMatcher, Features, RegistrationStatus, Sift};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, DepthSource, Frame, FrameCamera, FrameStore, Image, ImageSource};
use ostra_geometry::{Alignment, Pose, Similarity};

/// A recording on disk, and the true poses of the camera.
pub struct Recording {
    folder: tempfile::TempDir,
    pub frames: Vec<Frame>,
    pub truth: Vec<Pose>,
}

impl Recording {
    pub fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
            frames: Vec::new(),
            truth: Vec::new(),
        }
    }

    /// Records the steps of a hand.
    pub fn of(steps: impl IntoIterator<Item = usize>) -> Self {
        let mut recording = Self::new();
        for step in steps {
            let pose = hand_at(step as f64);
            recording.add(&seen(&pose, 0.0015, step as u64), pose);
        }
        recording
    }

    pub fn add(&mut self, (image, depth): &(Image, DepthMap), truth: Pose) {
        let number = self.frames.len();
        let path = |kind: &str| self.folder.path().join(format!("{kind}{number:03}.png"));
        write(&path("c"), &path("d"), image, depth);
        self.frames.push(Frame {
            name: format!("c{number:03}.png"),
            width: image.width,
            height: image.height,
            image: ImageSource::File {
                path: path("c"),
                orientation: Default::default(),
            },
            depth: Some(DepthSource::Sensor {
                path: path("d"),
                unit: 0.0005,
                orientation: Default::default(),
                camera: None,
            }),
            camera: Some(FrameCamera::given(camera(), None)),
        });
        self.truth.push(truth);
    }

    pub fn register(
        &self,
        matcher: &dyn FeatureMatcher,
        every: usize,
    ) -> Result<RgbdResult, RgbdError> {
        self.register_with(matcher, every, &Progress::default())
    }

    fn register_with(
        &self,
        matcher: &dyn FeatureMatcher,
        every: usize,
        progress: &Progress,
    ) -> Result<RgbdResult, RgbdError> {
        self.register_watched(matcher, every, progress, &|_, _| ())
    }

    fn register_watched(
        &self,
        matcher: &dyn FeatureMatcher,
        every: usize,
        progress: &Progress,
        on_pose: &OnPose<'_>,
    ) -> Result<RgbdResult, RgbdError> {
        let (chosen, between): (Vec<usize>, Vec<usize>) =
            (0..self.frames.len()).partition(|frame| frame % every == 0);
        let request = RgbdRequest {
            on_pose,
            frames: &self.frames,
            chosen: &chosen,
            between: &between,
            pairs: &[],
            extractor: &Sift::default(),
            matcher,
            options: RgbdOptions::default(),
        };
        register_rgbd(&request, &FrameStore::new(64 << 20), progress)
    }

    /// Returns the error of each frame with a camera: centre (metres) and axes (degrees).
    ///
    /// The result is aligned by the centres of the frames in `sound` first.
    pub fn errors(&self, result: &RgbdResult, sound: &[usize]) -> Vec<(usize, f64, f64)> {
        let pose = |frame: usize| result.cameras[&frame].camera_from_world.unwrap();
        // A point in front of each camera too: a hand's path alone is too straight to determine the
        // rotation about it.
        let points = |pose: &Pose| {
            [DVec3::ZERO, DVec3::Z, DVec3::X].map(|point| pose.inverse().transform(point))
        };
        let found: Vec<DVec3> = sound
            .iter()
            .flat_map(|&frame| points(&pose(frame)))
            .collect();
        let truth: Vec<DVec3> = sound
            .iter()
            .flat_map(|&frame| points(&self.truth[frame]))
            .collect();
        let to_truth = Similarity::align(&found, &truth, Alignment::Se3).unwrap();
        let error = |&frame: &usize| {
            let (found, truth) = (to_truth.transform_camera(&pose(frame)), self.truth[frame]);
            let turn = found.rotation.angle_between(truth.rotation).to_degrees();
            (frame, found.centre().distance(truth.centre()), turn)
        };
        result.cameras.keys().map(error).collect()
    }

    fn assert_true(&self, result: &RgbdResult) {
        let all: Vec<usize> = result.cameras.keys().copied().collect();
        for (frame, off, turn) in self.errors(result, &all) {
            assert!(
                off < 0.006 && turn < 0.2,
                "frame {frame}: {off} m, {turn} deg"
            );
        }
    }
}

fn write(color: &Path, depth_path: &Path, image: &Image, depth: &DepthMap) {
    let bytes: Vec<u8> = image.pixels.iter().flatten().copied().collect();
    image::save_buffer(
        color,
        &bytes,
        image.width,
        image.height,
        image::ExtendedColorType::Rgb8,
    )
    .unwrap();
    let steps: Vec<u8> = depth
        .depths
        .iter()
        .flat_map(|depth| ((depth / 0.0005).round() as u16).to_ne_bytes())
        .collect();
    image::save_buffer(
        depth_path,
        &steps,
        depth.width,
        depth.height,
        image::ExtendedColorType::L16,
    )
    .unwrap();
}

/// An extractor that finds nothing: only depth is left.
struct Blind;

impl FeatureMatcher for Blind {
    fn name(&self) -> &'static str {
        "blind"
    }

    fn matches(&self, _: &Features, _: &Features) -> Result<Vec<(u32, u32)>, FeatureError> {
        Ok(Vec::new())
    }
}

#[test]
fn recording_is_placed_reproducibly() {
    let recording = Recording::of(0..14);
    let result = recording.register(&NearestMatcher::for_bytes(), 1).unwrap();
    assert_eq!(result.cameras.len(), 14);
    assert_eq!(
        result.cameras[&0].camera_from_world,
        Some(Pose::IDENTITY),
        "the world is that of the first frame"
    );
    recording.assert_true(&result);
    let again = recording.register(&NearestMatcher::for_bytes(), 1).unwrap();
    assert!(again.cameras == result.cameras && again.outcomes == result.outcomes);
}

#[test]
fn damaged_frames_are_reported_and_the_others_placed() {
    // A gap of four steps after the eighth frame.
    let mut recording = Recording::of((0..8).chain(12..18));
    let (repeated, truth) = (seen(&hand_at(17.0), 0.0015, 17), hand_at(17.0));
    recording.add(&repeated, truth);
    let (image, mut depth) = seen(&hand_at(18.0), 0.0015, 18);
    depth.depths.fill(0.0);
    recording.add(&(image, depth), hand_at(18.0));
    let (mut image, mut depth) = seen(&hand_at(19.0), 0.0015, 19);
    let row = image.width as usize;
    image.pixels = image.pixels.chunks(row).rev().flatten().copied().collect();
    depth.depths = depth.depths.chunks(row).rev().flatten().copied().collect();
    recording.add(&(image, depth), hand_at(19.0));
    let last = hand_at(20.0);
    recording.add(&seen(&last, 0.0015, 20), last);

    let result = recording.register(&NearestMatcher::for_bytes(), 1).unwrap();
    assert_eq!(
        result.outcomes[&15],
        RegistrationStatus::NoDepth { known: 0.0 }
    );
    assert!(
        matches!(result.outcomes[&16], RegistrationStatus::Unlike { .. }),
        "mirrored: {:?}",
        result.outcomes[&16]
    );
    let placed: Vec<usize> = result.cameras.keys().copied().collect();
    assert_eq!(
        placed,
        [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 17]
    );
    recording.assert_true(&result);
}

#[test]
fn fragments_without_features_are_joined_by_shape() {
    let recording = Recording::of((0..8).chain((2..14).rev()));
    let result = recording.register(&Blind, 1).unwrap();
    assert_eq!(result.cameras.len(), 20, "{:?}", result.outcomes);
    recording.assert_true(&result);
    let by_shape = result
        .links
        .iter()
        .filter(|link| link.kind == LinkKind::Shape && link.holds);
    assert!(by_shape.clone().count() >= 2, "{:?}", result.links);
    assert!(
        by_shape
            .clone()
            .all(|link| (link.frames[0] < 8) != (link.frames[1] < 8)),
        "between the two pieces"
    );
}

/// Stops the run after some pairs were matched.
struct Stopping {
    progress: Progress,
    left: AtomicUsize,
}

impl FeatureMatcher for Stopping {
    fn name(&self) -> &'static str {
        "stopping"
    }

    fn matches(&self, _: &Features, _: &Features) -> Result<Vec<(u32, u32)>, FeatureError> {
        if self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.progress.stop();
        }
        Ok(Vec::new())
    }
}

#[test]
fn stopped_run_keeps_its_partial_result() {
    let recording = Recording::of(0..10);
    let progress = Progress::default();
    let matcher = Stopping {
        progress: progress.clone(),
        left: AtomicUsize::new(6),
    };
    let result = recording.register_with(&matcher, 1, &progress).unwrap();
    assert!(
        result.stopped && (2..10).contains(&result.cameras.len()),
        "{:?}",
        result.cameras.keys()
    );
    recording.assert_true(&result);
    let progress = Progress::default();
    progress.stop();
    assert!(matches!(
        recording.register_with(&Blind, 1, &progress),
        Err(RgbdError::Stopped(_))
    ));
}

#[test]
fn fragment_of_another_place_is_not_joined() {
    let mut recording = Recording::of(0..6);
    // The room behind the camera: nothing of it is seen from the front.
    let behind = Pose {
        rotation: glam::DQuat::from_rotation_y(std::f64::consts::PI),
        ..Pose::IDENTITY
    };
    for step in 0..4 {
        let pose = behind.compose(&hand_at(f64::from(step)));
        recording.add(&seen(&pose, 0.0015, 50), pose);
    }
    let result = recording.register(&NearestMatcher::for_bytes(), 1).unwrap();
    assert_eq!(
        result.cameras.keys().copied().collect::<Vec<_>>(),
        [0, 1, 2, 3, 4, 5]
    );
    assert!(
        (6..10).all(|frame| result.outcomes[&frame] == RegistrationStatus::Apart { frames: 4 }),
        "{:?}",
        result.outcomes
    );
}

#[test]
fn frames_between_are_placed() {
    let recording = Recording::of(0..13);
    let result = recording.register(&NearestMatcher::for_bytes(), 3).unwrap();
    assert_eq!(result.cameras.len(), 13);
    recording.assert_true(&result);
}

#[test]
fn callback_receives_poses_in_order_and_then_the_final_ones() {
    let recording = Recording::of(0..9);
    let reported = Mutex::new(Vec::new());
    let take = |frame: usize, pose: &Pose| reported.lock().unwrap().push((frame, *pose));
    let result = recording
        .register_watched(&NearestMatcher::for_bytes(), 2, &Progress::default(), &take)
        .unwrap();
    let reported = reported.into_inner().unwrap();
    let first: Vec<usize> = reported.iter().map(|(frame, _)| *frame).take(5).collect();
    assert_eq!(first, [0, 2, 4, 6, 8], "while odometry goes on");
    let end: BTreeMap<usize, Pose> = reported.into_iter().collect();
    assert_eq!(end.len(), 9);
    for (frame, camera) in &result.cameras {
        assert!(
            end[frame]
                .centre()
                .distance(camera.camera_from_world.unwrap().centre())
                < 1e-9,
            "{frame}"
        );
    }
}

#[test]
fn frames_without_intrinsics_are_reported() {
    let mut recording = Recording::of(0..2);
    for frame in &mut recording.frames {
        frame.camera = None;
    }
    let error = recording
        .register(&NearestMatcher::for_bytes(), 1)
        .unwrap_err()
        .to_string();
    assert!(error.contains("--intrinsics"), "{error}");
}
