//! Tests of the tracker in a small synthetic room.
//!
//! A box stands in front of a wall, and a plate in front of the box's right half.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::{DQuat, DVec3};

use super::{GeometryTracker, ReprojectionOptions};
use ostra_core::job::Progress;
use ostra_frames::{DepthSource, Frame, FrameCamera, FrameStore, ImageSource, Orientation};
use ostra_geometry::{Camera, Distortion, Pose};
use ostra_masks::{Direction, LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;
const BOX: LabelId = LabelId(1);
const PLATE: LabelId = LabelId(2);

/// Upright rectangle: depth; left, right, top, bottom (metres); colour; label.
type Card = (f64, [f64; 4], [u8; 3], LabelId);
const SURFACES: [Card; 3] = [
    (2.0, [-9.0, 9.0, -9.0, 9.0], [200, 190, 180], LabelId::NONE),
    (1.5, [-0.4, 0.4, -0.3, 0.3], [60, 90, 200], BOX),
    (1.1, [0.1, 0.35, -0.1, 0.1], [220, 60, 50], PLATE),
];

fn camera(x: f64) -> FrameCamera {
    let pose = Pose {
        rotation: DQuat::from_rotation_z(0.05 * x),
        translation: DVec3::new(-x, 0.0, 0.0),
    };
    FrameCamera::given(
        Camera::pinhole(WIDTH, HEIGHT, [80.0, 80.0], [48.0, 36.0]),
        Some(pose),
    )
}

/// Renders the nearest surface at every pixel: index into [`SURFACES`] and depth.
fn render(camera: &FrameCamera) -> Vec<(usize, f64)> {
    let world_from_camera = camera.camera_from_world.unwrap().inverse();
    let pixels = (0..HEIGHT).flat_map(|y| (0..WIDTH).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| {
            let at_px = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let ray = camera.intrinsics.unproject(at_px).extend(1.0);
            let (from, along) = (
                world_from_camera.translation,
                world_from_camera.rotation * ray,
            );
            let hit = |(i, (z, [l, r, t, b], ..)): (usize, &Card)| {
                let depth = (z - from.z) / along.z;
                let at = from + depth * along;
                ((*l..*r).contains(&at.x) && (*t..*b).contains(&at.y)).then_some((i, depth))
            };
            SURFACES
                .iter()
                .enumerate()
                .filter_map(hit)
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap()
        })
        .collect()
}

struct Room {
    _folder: tempfile::TempDir,
    frames: Vec<Frame>,
    truth: Vec<LabelMask>,
}

impl Room {
    /// Renders frames at the given positions; `hole` selects pixels without depth.
    fn new(places: &[f64], lens: Distortion, hole: impl Fn(usize, u32, u32) -> bool) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (mut frames, mut truth) = (Vec::new(), Vec::new());
        for (k, &x) in places.iter().enumerate() {
            let mut camera = camera(x);
            camera.intrinsics.distortion = lens;
            let seen = render(&camera);
            let at = |x: u32, y: u32| seen[(y * WIDTH + x) as usize];
            let color =
                image::RgbImage::from_fn(WIDTH, HEIGHT, |x, y| image::Rgb(SURFACES[at(x, y).0].2));
            let depth =
                image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_fn(WIDTH, HEIGHT, |x, y| {
                    image::Luma([if hole(k, x, y) {
                        0
                    } else {
                        (at(x, y).1 * 5000.0).round() as u16
                    }])
                });
            color.save(folder.path().join(format!("c{k}.png"))).unwrap();
            depth.save(folder.path().join(format!("d{k}.png"))).unwrap();
            frames.push(frame(folder.path(), k, camera));
            let ids = seen
                .iter()
                .map(|&(surface, _)| SURFACES[surface].3)
                .collect();
            truth.push(LabelMask {
                width: WIDTH,
                height: HEIGHT,
                ids,
            });
        }
        Self {
            _folder: folder,
            frames,
            truth,
        }
    }

    fn plain(places: &[f64]) -> Self {
        Self::new(places, Distortion::None, |_, _, _| false)
    }

    /// Returns the ground-truth mask of a frame, restricted to these labels.
    fn only(&self, frame: usize, labels: &[LabelId]) -> LabelMask {
        let mut mask = self.truth[frame].clone();
        mask.ids
            .iter_mut()
            .filter(|id| !labels.contains(id))
            .for_each(|id| *id = LabelId::NONE);
        mask
    }

    fn request(&self, keyframes: impl IntoIterator<Item = (usize, LabelMask)>) -> TrackRequest {
        TrackRequest {
            frames: Arc::new(self.frames.clone()),
            store: Arc::new(FrameStore::new(16 << 20)),
            keyframes: keyframes
                .into_iter()
                .map(|(frame, mask)| (frame, Arc::new(mask)))
                .collect(),
            from: 0,
            to: self.frames.len() - 1,
            direction: Direction::Both,
            labels: None,
        }
    }
}

fn frame(folder: &Path, k: usize, camera: FrameCamera) -> Frame {
    let orientation = Orientation::default();
    Frame {
        name: format!("c{k}.png"),
        width: WIDTH,
        height: HEIGHT,
        image: ImageSource::File {
            path: folder.join(format!("c{k}.png")),
            orientation,
        },
        depth: Some(DepthSource::Sensor {
            path: folder.join(format!("d{k}.png")),
            unit: 0.0002,
            orientation,
            camera: None,
        }),
        camera: Some(camera),
    }
}

fn track(
    request: &TrackRequest,
) -> Result<(BTreeMap<usize, TrackedFrame>, Vec<String>), MaskError> {
    let mut tracked = BTreeMap::new();
    let mut emit = |frame: TrackedFrame| assert!(tracked.insert(frame.frame, frame).is_none());
    let warnings = GeometryTracker::default().track(request, &mut emit, &Progress::default())?;
    Ok((tracked, warnings))
}

fn refused(request: &TrackRequest) -> String {
    track(request).map(|_| ()).unwrap_err().to_string()
}

fn iou(a: &LabelMask, b: &LabelMask, label: LabelId) -> f64 {
    let pairs = || {
        a.ids
            .iter()
            .zip(&b.ids)
            .map(|(&a, &b)| (a == label, b == label))
    };
    let (both, any) = (
        pairs().filter(|&(a, b)| a && b).count(),
        pairs().filter(|&(a, b)| a || b).count(),
    );
    both as f64 / any.max(1) as f64
}

#[test]
fn mask_is_reprojected_to_views_on_both_sides() {
    let room = Room::plain(&[-0.2, -0.1, 0.0, 0.1, 0.2]);
    let request = room.request([(2, room.truth[2].clone())]);
    let (tracked, warnings) = track(&request).unwrap();
    assert_eq!(
        tracked.keys().copied().collect::<Vec<_>>(),
        [0, 1, 3, 4],
        "a keyframe is not answered"
    );
    assert!(warnings.is_empty());
    for (&k, frame) in &tracked {
        for label in [BOX, PLATE] {
            let iou = iou(&frame.mask, &room.truth[k], label);
            assert!(iou > 0.93, "frame {k}, label {}: {iou}", label.0);
            assert!(frame.confidence[&label] > 0.8 && frame.confidence[&label] <= 1.0);
        }
    }
}

#[test]
fn hidden_surfaces_are_not_labelled() {
    // Seen from the left, the plate hides another part of the box.
    let room = Room::plain(&[0.0, -0.3]);
    let (tracked, _) = track(&room.request([(0, room.only(0, &[BOX]))])).unwrap();
    let plate = room.truth[1]
        .ids
        .iter()
        .zip(&tracked[&1].mask.ids)
        .filter(|&(&truth, _)| truth == PLATE);
    let (wrong, all) = plate.fold((0, 0), |(wrong, all), (_, &id)| {
        (wrong + usize::from(id == BOX), all + 1)
    });
    assert!(all > 100 && wrong * 10 < all, "{wrong} of {all}");
}

#[test]
fn depth_holes_are_filled_from_other_frames() {
    // No depth on the left half of the target, nor on the right part of the keyframe.
    let hole = |k: usize, x: u32, _| if k == 1 { x < 48 } else { x > 60 };
    let room = Room::new(&[0.0, 0.1, 0.05, -0.05], Distortion::None, hole);
    let (tracked, _) = track(&room.request([(0, room.truth[0].clone())])).unwrap();
    let iou = iou(&tracked[&1].mask, &room.truth[1], BOX);
    assert!(iou > 0.9, "{iou}");
}

#[test]
fn keyframes_without_a_label_do_not_erase_it() {
    let room = Room::plain(&[0.0, 0.05, 0.1]);
    let (tracked, _) =
        track(&room.request([(0, room.only(0, &[BOX])), (2, room.only(2, &[PLATE]))])).unwrap();
    for label in [BOX, PLATE] {
        assert!(iou(&tracked[&1].mask, &room.truth[1], label) > 0.9);
    }
}

#[test]
fn requested_direction_is_respected() {
    let room = Room::plain(&[0.0, 0.02, 0.04, 0.06]);
    let frames = |direction| {
        let request = TrackRequest {
            direction,
            ..room.request([(1, room.truth[1].clone())])
        };
        track(&request).unwrap().0.into_keys().collect::<Vec<_>>()
    };
    assert_eq!(frames(Direction::Forward), [2, 3]);
    assert_eq!(frames(Direction::Backward), [0]);
    // A keyframe outside the range is used, but only in the requested direction.
    let mut request = room.request([(0, room.only(0, &[BOX])), (3, room.only(3, &[PLATE]))]);
    (request.from, request.to, request.direction) = (1, 2, Direction::Forward);
    let (tracked, _) = track(&request).unwrap();
    assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), [1, 2]);
    assert!(
        tracked
            .values()
            .all(|f| f.mask.ids.contains(&BOX) && !f.mask.ids.contains(&PLATE))
    );
}

#[test]
fn lens_distortion_is_taken_into_account() {
    let lens = Distortion::OpenCv {
        k: [-0.2, 0.05],
        p: [0.002, -0.001],
    };
    let room = Room::new(&[-0.1, 0.1], lens, |_, _, _| false);
    let (tracked, _) = track(&room.request([(0, room.truth[0].clone())])).unwrap();
    assert!(iou(&tracked[&1].mask, &room.truth[1], BOX) > 0.93);
}

#[test]
fn masks_do_not_depend_on_the_number_of_threads() {
    let room = Room::plain(&[-0.2, -0.1, 0.0, 0.1, 0.2, 0.3]);
    let request = room.request([(1, room.truth[1].clone()), (4, room.only(4, &[PLATE]))]);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let (tracked, _) = pool.install(|| track(&request)).unwrap();
        tracked
            .into_values()
            .map(|f| (f.frame, f.mask, f.confidence))
            .collect::<Vec<_>>()
    };
    assert_eq!(run(1), run(4));
}

#[test]
fn frames_without_depth_or_camera_are_skipped_and_named() {
    let mut room = Room::plain(&[0.0, 0.1, 0.2]);
    room.frames[1].depth = None;
    let (tracked, warnings) = track(&room.request([(0, room.truth[0].clone())])).unwrap();
    assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), [2]);
    assert!(
        warnings.len() == 1 && warnings[0].contains("c1.png") && !warnings[0].contains("c2.png"),
        "{warnings:?}"
    );
    room.frames[0].camera = None;
    assert!(
        refused(&room.request([(0, room.truth[0].clone())])).contains("needs depth and a camera")
    );
    room.frames[0].camera = room.frames[1].camera;
    room.frames[2].camera = None;
    assert!(refused(&room.request([(0, room.truth[0].clone())])).contains("no frame from 0 to 2"));
}

#[test]
fn unreadable_frames_are_skipped_and_named_in_one_line() {
    let room = Room::plain(&[0.0, 0.05, 0.1, 0.15, 0.2, 0.25]);
    let depth = |k: usize| {
        room.frames[k]
            .depth
            .as_ref()
            .unwrap()
            .sensor_path()
            .unwrap()
    };
    // Depth of a target that also fills holes, image of a target, depth of a keyframe.
    for path in [depth(1), room.frames[3].image.path(), depth(5)] {
        std::fs::write(path, "").unwrap();
    }
    let request = || room.request([0, 5].map(|k| (k, room.truth[k].clone())));
    let (tracked, warnings) = track(&request()).unwrap();
    assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), [2, 4]);
    for (&k, frame) in &tracked {
        let iou = iou(&frame.mask, &room.truth[k], BOX);
        assert!(iou > 0.9, "frame {k}: {iou}");
    }
    assert!(
        warnings.len() == 1 && warnings[0].starts_with("3 frames cannot be read"),
        "{warnings:?}"
    );
    assert!(
        warnings[0].ends_with("c1.png, c3.png, c5.png"),
        "{warnings:?}"
    );
    std::fs::write(depth(0), "").unwrap();
    assert!(
        refused(&request()).contains("d0.png"),
        "no mask is left to re-project"
    );
}

#[test]
fn invalid_requests_are_rejected() {
    let room = Room::plain(&[0.0, 0.1]);
    assert!(refused(&room.request([])).contains("no frame has a mask"));
    assert!(
        refused(&room.request([(0, LabelMask::empty(WIDTH, HEIGHT))]))
            .contains("no frame has a mask")
    );
    assert!(refused(&room.request([(0, LabelMask::empty(5, 4))])).contains("5x4"));
    assert!(refused(&room.request([(7, room.truth[0].clone())])).contains("the project has 2"));
    let request = room.request([(0, room.truth[0].clone())]);
    assert!(
        refused(&TrackRequest {
            to: 2,
            ..request.clone()
        })
        .contains("the project has 2")
    );
    assert!(
        refused(&TrackRequest {
            from: 2,
            to: 1,
            ..request
        })
        .contains("the project has 2")
    );
}

#[test]
fn stopped_job_ends_with_an_error() {
    let room = Room::plain(&[0.0, 0.1]);
    let progress = Progress::default();
    let request = room.request([(0, room.truth[0].clone())]);
    progress.stop();
    let tracker = GeometryTracker {
        options: ReprojectionOptions::default(),
    };
    assert!(matches!(
        tracker.track(&request, &mut |_| {}, &progress),
        Err(MaskError::Stopped(_))
    ));
}
