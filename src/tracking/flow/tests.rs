//! Tests of the tracker on small synthetic videos: textured objects in front of a textured wall.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use glam::Vec2;
use rand::RngExt;
use rand_pcg::Pcg32;

use super::FlowTracker;
use super::dis::{Finest, flow_between};
use super::plane::Plane;
use crate::flow::plane::Pyramid;
use crate::flow::tracked_image::ImageCache;
use crate::propagate::PassFrame;
use ostra_core::image::ImageSize;
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, ImageSource, Orientation};
use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest, TrackedFrame, Tracker};

mod robust;

const WIDTH: u32 = 160;
const HEIGHT: u32 = 120;
const LEFT: LabelId = LabelId(1);
const RIGHT: LabelId = LabelId(2);

/// Smooth noise, −1 to 1.
struct Noise {
    side: usize,
    values: Vec<f32>,
}

impl Noise {
    fn new(seed: u64) -> Self {
        let mut dice = Pcg32::new(seed, 3);
        let side = 64;
        Self {
            side,
            values: (0..side * side)
                .map(|_| dice.random_range(-1.0..1.0f32))
                .collect(),
        }
    }

    fn at(&self, p: Vec2) -> f32 {
        let low = p.floor();
        let (u, v) = (p.x - low.x, p.y - low.y);
        let value = |dx: i64, dy: i64| {
            let wrap = |at: i64| at.rem_euclid(self.side as i64) as usize;
            self.values[wrap(low.y as i64 + dy) * self.side + wrap(low.x as i64 + dx)]
        };
        let row = |dy| value(0, dy) * (1.0 - u) + value(1, dy) * u;
        row(0) * (1.0 - v) + row(1) * v
    }
}

/// A disk with its own texture that moves in front of the wall.
struct Disk {
    label: LabelId,
    color: [f32; 3],
    radius: f32,
    centre: fn(f32) -> Vec2,
}

struct Video {
    _folder: tempfile::TempDir,
    frames: Vec<Frame>,
    truth: Vec<LabelMask>,
}

impl Video {
    /// The wall moves as well, as seen by a rotating camera; `pole` hides columns of every frame.
    fn new(count: usize, disks: &[Disk], pole: Range<u32>) -> Self {
        Self::with_cover(count, disks, |_| pole.clone())
    }

    /// Renders a video; `cover` gives the hidden columns of each frame.
    fn with_cover(count: usize, disks: &[Disk], cover: impl Fn(f32) -> Range<u32>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (wall, skin) = (Noise::new(1), Noise::new(2));
        let (mut frames, mut truth) = (Vec::new(), Vec::new());
        for k in 0..count {
            let mut mask = LabelMask::empty(WIDTH, HEIGHT);
            let image = image::RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
                let p = Vec2::new(x as f32, y as f32);
                if cover(k as f32).contains(&x) {
                    return image::Rgb([90, 90, 95]);
                }
                let on = disks
                    .iter()
                    .find(|disk| p.distance((disk.centre)(k as f32)) < disk.radius);
                let grey = 30.0 * wall.at((p + Vec2::new(1.3 * k as f32, 0.0)) / 5.0);
                let color = on.map_or([120.0 + grey, 125.0 + grey, 110.0 + grey], |disk| {
                    mask.ids[(y * WIDTH + x) as usize] = disk.label;
                    let own = 25.0 * skin.at((p - (disk.centre)(k as f32)) / 4.0);
                    disk.color.map(|channel| channel + own)
                });
                image::Rgb(color.map(|channel| channel.clamp(0.0, 255.0) as u8))
            });
            let path = folder.path().join(format!("{k:03}.png"));
            image.save(&path).unwrap();
            let image = ImageSource::File {
                path,
                orientation: Orientation::default(),
            };
            let name = format!("{k:03}.png");
            frames.push(Frame {
                name,
                width: WIDTH,
                height: HEIGHT,
                image,
                depth: None,
                camera: None,
            });
            truth.push(mask);
        }
        Self {
            _folder: folder,
            frames,
            truth,
        }
    }

    fn request(&self, keyframes: &[usize]) -> TrackRequest {
        TrackRequest {
            frames: Arc::new(self.frames.clone()),
            store: Arc::new(FrameStore::new(16 << 20)),
            keyframes: keyframes
                .iter()
                .map(|&frame| (frame, Arc::new(self.truth[frame].clone())))
                .collect(),
            from: 0,
            to: self.frames.len() - 1,
            direction: Direction::Both,
            labels: None,
        }
    }

    fn iou(&self, tracked: &BTreeMap<usize, TrackedFrame>, frame: usize, label: LabelId) -> f64 {
        tracked[&frame]
            .mask
            .region(label)
            .iou(&self.truth[frame].region(label))
    }
}

fn track(request: &TrackRequest) -> BTreeMap<usize, TrackedFrame> {
    let mut tracked = BTreeMap::new();
    let mut take = |frame: TrackedFrame| {
        tracked.insert(frame.frame, frame);
    };
    FlowTracker::default()
        .track(request, &mut take, &Progress::default())
        .unwrap();
    tracked
}

fn two_disks() -> [Disk; 2] {
    [
        Disk {
            label: LEFT,
            color: [170.0, 90.0, 80.0],
            radius: 18.0,
            centre: |k| Vec2::new(30.0 + 2.5 * k, 40.0),
        },
        Disk {
            label: RIGHT,
            color: [90.0, 110.0, 180.0],
            radius: 16.0,
            centre: |k| Vec2::new(125.0 - 2.0 * k, 82.0),
        },
    ]
}

#[test]
fn flow_estimates_the_shift_of_a_texture() {
    let noise = Noise::new(5);
    let shift = Vec2::new(11.4, -6.7);
    let image = |shift: Vec2| {
        let grey = |x: usize, y: usize| {
            128.0 + 90.0 * noise.at((Vec2::new(x as f32, y as f32) - shift) / 6.0)
        };
        Pyramid::new(Plane::from_fn(200, 150, grey), 16)
    };
    let flow = flow_between(&image(Vec2::ZERO), &image(shift), Finest::Half);
    let mut misses: Vec<f32> = (30..120)
        .flat_map(|y| (30..170).map(move |x| (x, y)))
        .map(|(x, y)| flow.at(x, y).distance(shift))
        .collect();
    misses.sort_by(f32::total_cmp);
    let (median, worst) = (misses[misses.len() / 2], misses[misses.len() * 99 / 100]);
    assert!(
        median < 0.1 && worst < 0.5,
        "median {median}, 99 of 100 {worst}"
    );
}

#[test]
fn two_objects_are_tracked_past_each_other() {
    let video = Video::new(20, &two_disks(), 0..0);
    let tracked = track(&video.request(&[0]));
    assert_eq!(
        tracked.keys().copied().collect::<Vec<_>>(),
        (1..20).collect::<Vec<_>>(),
        "all but the keyframe"
    );
    for label in [LEFT, RIGHT] {
        for frame in [1, 10, 19] {
            let iou = video.iou(&tracked, frame, label);
            assert!(iou > 0.9, "{label:?} in frame {frame}: {iou}");
            assert!(
                tracked[&frame].confidence[&label] > 0.7,
                "{:?}",
                tracked[&frame].confidence
            );
        }
    }
}

#[test]
fn masks_propagate_in_both_directions_and_are_merged() {
    let video = Video::new(20, &two_disks(), 0..0);
    let from_the_middle = track(&video.request(&[9]));
    assert!(
        video.iou(&from_the_middle, 0, LEFT) > 0.9 && video.iou(&from_the_middle, 19, RIGHT) > 0.9
    );
    let mut request = video.request(&[0, 19]);
    // The second keyframe shows a larger object than the first, so masks in between grow.
    let grown = video.truth[19].region(LEFT).dilated(4.0);
    let mask = Arc::make_mut(request.keyframes.get_mut(&19).unwrap());
    for (id, _) in mask
        .ids
        .iter_mut()
        .zip(&grown.inside)
        .filter(|(_, inside)| **inside)
    {
        *id = LEFT;
    }
    let area = |tracked: &BTreeMap<usize, TrackedFrame>, frame: usize| {
        tracked[&frame].mask.region(LEFT).area()
    };
    let tracked = track(&request);
    assert!(
        area(&tracked, 18) > area(&tracked, 1) + 200,
        "{} and {}",
        area(&tracked, 1),
        area(&tracked, 18)
    );
    request.direction = Direction::Forward;
    let forward = track(&request);
    assert!(area(&forward, 18) < area(&tracked, 18) - 100);
    assert!(video.iou(&forward, 18, LEFT) > 0.85);
}

#[test]
fn object_that_left_stays_absent_and_hidden_object_reappears() {
    let leaves = Disk {
        label: LEFT,
        color: [170.0, 90.0, 80.0],
        radius: 14.0,
        centre: |k| Vec2::new(30.0 - 5.0 * k, 30.0),
    };
    let hides = Disk {
        label: RIGHT,
        color: [90.0, 110.0, 180.0],
        radius: 9.0,
        centre: |k| Vec2::new(40.0 + 4.0 * k, 85.0),
    };
    let video = Video::new(24, &[leaves, hides], 74..96);
    let tracked = track(&video.request(&[0]));
    assert!(
        tracked[&23].mask.region(LEFT).is_empty() && !tracked[&23].confidence.contains_key(&LEFT)
    );
    assert!(
        tracked[&11].mask.region(RIGHT).area() < 60,
        "{}",
        tracked[&11].mask.region(RIGHT).area()
    );
    let back = video.iou(&tracked, 23, RIGHT);
    assert!(back > 0.7, "{back}");
}

#[test]
fn static_object_is_recovered_after_occlusion() {
    // Panels slide in front of it for many frames.
    let stands = Disk {
        label: LEFT,
        color: [170.0, 90.0, 80.0],
        radius: 13.0,
        centre: |_| Vec2::new(80.0, 60.0),
    };
    let video = Video::with_cover(52, &[stands], |k| {
        if k < 8.0 {
            40..64
        } else if k < 40.0 {
            55..105
        } else {
            115..145
        }
    });
    let tracked = track(&video.request(&[0]));
    assert!(tracked[&30].mask.region(LEFT).is_empty());
    assert!(
        video.iou(&tracked, 51, LEFT) > 0.8,
        "{}",
        video.iou(&tracked, 51, LEFT)
    );
}

#[test]
fn label_in_only_one_keyframe_is_tracked_through_the_interval() {
    let video = Video::new(16, &two_disks(), 0..0);
    let mut request = video.request(&[0, 15]);
    let first = Arc::make_mut(request.keyframes.get_mut(&0).unwrap());
    first
        .ids
        .iter_mut()
        .filter(|id| **id == RIGHT)
        .for_each(|id| *id = LabelId::NONE);
    let tracked = track(&request);
    for frame in [1, 8, 14] {
        assert!(
            video.iou(&tracked, frame, RIGHT) > 0.85,
            "frame {frame}: {}",
            video.iou(&tracked, frame, RIGHT)
        );
    }
}

#[test]
fn tiny_images_and_keyframes_of_other_sizes_are_handled() {
    for (width, height) in [(1, 1), (7, 90), (640, 3), (33, 31)] {
        let folder = tempfile::tempdir().unwrap();
        let mut video = Video {
            _folder: folder,
            frames: Vec::new(),
            truth: Vec::new(),
        };
        for k in 0..4u32 {
            let path = video._folder.path().join(format!("{k}.png"));
            let (width, height) = if k == 3 {
                (2 * width, 2 * height)
            } else {
                (width, height)
            };
            image::RgbImage::from_fn(width, height, |x, y| {
                image::Rgb([(x * 7 + k) as u8, y as u8, 90])
            })
            .save(&path)
            .unwrap();
            let image = ImageSource::File {
                path,
                orientation: Orientation::default(),
            };
            video.frames.push(Frame {
                name: k.to_string(),
                width,
                height,
                image,
                depth: None,
                camera: None,
            });
            let mut mask = LabelMask::empty(width, height);
            mask.ids[0] = LEFT;
            video.truth.push(mask);
        }
        let tracked = track(&video.request(&[0, 3]));
        assert_eq!(tracked.keys().copied().collect::<Vec<_>>(), [1, 2]);
        assert!(
            tracked
                .values()
                .all(|frame| (frame.mask.width, frame.mask.height) == (width, height))
        );
    }
}

#[test]
fn masks_do_not_depend_on_the_number_of_threads() {
    let video = Video::new(6, &two_disks(), 0..0);
    let request = video.request(&[0, 5]);
    let with = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| track(&request))
    };
    let masks = |tracked: &BTreeMap<usize, TrackedFrame>| {
        tracked
            .values()
            .map(|frame| frame.mask.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(masks(&with(1)), masks(&with(4)));
}

#[test]
fn range_is_respected_and_finished_frames_survive_a_stop() {
    let video = Video::new(12, &two_disks(), 0..0);
    let mut request = video.request(&[1, 10]);
    (request.from, request.to) = (3, 6);
    assert_eq!(
        track(&request).keys().copied().collect::<Vec<_>>(),
        [3, 4, 5, 6]
    );
    request.keyframes.remove(&1);
    request.direction = Direction::Forward;
    let refused = FlowTracker::default()
        .track(&request, &mut |_| {}, &Progress::default())
        .unwrap_err();
    assert!(
        refused
            .to_string()
            .contains("choose another range or direction"),
        "{refused}"
    );

    let progress = Progress::default();
    let mut done = Vec::new();
    let mut take = |frame: TrackedFrame| {
        done.push(frame.frame);
        if done.len() == 3 {
            progress.stop();
        }
    };
    let stopped = FlowTracker::default().track(&video.request(&[0]), &mut take, &progress);
    assert!(matches!(stopped, Err(ostra_masks::MaskError::Stopped(_))));
    assert_eq!(done, [1, 2, 3]);
}

#[test]
fn prepared_image_is_cached_while_in_use() {
    let video = Video::new(2, &two_disks(), 0..0);
    let request = video.request(&[0]);
    let size = ImageSize::new(
        video.frames[1].width as usize,
        video.frames[1].height as usize,
    );
    let frame = |index: usize| PassFrame {
        index,
        image: request.store.image(&request.frames[index]).unwrap(),
    };
    let mut images = ImageCache::new(size, None);
    let held = images.get(&frame(1)).unwrap();
    assert!(Arc::ptr_eq(&held, &images.get(&frame(1)).unwrap()));
    let half = ImageSize::new(size.width / 2, size.height / 2);
    let mut smaller = ImageCache::new(half, None);
    let small = smaller.get(&frame(1)).unwrap();
    assert_eq!(ImageSize::new(small.width, small.height), half);
    let watched = Arc::downgrade(&held);
    drop(held);
    assert!(
        watched.upgrade().is_none(),
        "only those who use an image hold it"
    );
}
