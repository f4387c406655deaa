//! Common code of the benches of learned trackers.
//!
//! Labels are tracked over synthetic images, timed at three sizes, and over a long video whose
//! memory is measured.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore, ImageSource, Orientation};
use ostra_masks::{Direction, LabelId, LabelMask, TrackRequest, TrackedFrame, Tracker};

const LABELS: u32 = 3;

/// Arguments of the command line.
pub struct TrackedCase {
    /// Folder of networks.
    pub folder: PathBuf,
    /// Frames to track at each size.
    frames: usize,
    /// Frames to track in the long video.
    long: usize,
}

impl TrackedCase {
    /// Reads `[FOLDER] [FRAMES] [LONG]`; without a folder, prints a line and returns `None`.
    pub fn read() -> Option<Self> {
        let words: Vec<String> = std::env::args()
            .skip(1)
            .filter(|word| !word.starts_with('-'))
            .collect();
        let folder = words
            .first()
            .map(PathBuf::from)
            .or_else(|| std::env::var_os("OSTRA_MODELS").map(PathBuf::from));
        if folder.is_none() {
            println!("name the folder of networks, or set OSTRA_MODELS");
        }
        let number = |at: usize, usual| {
            words
                .get(at)
                .and_then(|word| word.parse().ok())
                .unwrap_or(usual)
        };
        Some(Self {
            folder: folder?,
            frames: number(1, 12),
            long: number(2, 500),
        })
    }

    /// Prints the memory along a long video of small images.
    ///
    /// Call this first, while the peak of the process is still small.
    pub fn walk(&self, tracker: &dyn Tracker) {
        follow(tracker, (160, 96), self.long, &mut |frame| {
            if frame % 50 == 0 {
                println!(
                    "160×96, frame {frame}: {} MB now, peak {} MB",
                    status_mb("VmRSS"),
                    status_mb("VmHWM")
                );
            }
        });
    }

    /// Prints the frames per second at sizes (width, height, published rate).
    pub fn rates(&self, tracker: &dyn Tracker, sizes: &[(u32, u32, &str)]) {
        for &(width, height, published) in sizes {
            let rate = follow(tracker, (width, height), self.frames, &mut |_| {});
            println!(
                "{width}×{height}, {LABELS} labels: {rate:.3} frames/s (published, RTX 3060: {published}), peak {} MB",
                status_mb("VmHWM")
            );
        }
    }
}

/// Tracks labels forwards over synthetic images; returns the frames per second.
fn follow(
    tracker: &dyn Tracker,
    (width, height): (u32, u32),
    count: usize,
    at: &mut dyn FnMut(usize),
) -> f64 {
    let scratch = tempfile::tempdir().expect("a folder can be made");
    let frames = (0..=count)
        .map(|frame| image(scratch.path(), frame, width, height))
        .collect();
    let mut keyframe = LabelMask::empty(width, height);
    for (place, id) in keyframe.ids.iter_mut().enumerate() {
        let (x, y) = (place as u32 % width, place as u32 / width);
        let label = 1 + x * (LABELS + 1) / width;
        if label <= LABELS && (height / 4..height / 2).contains(&y) {
            *id = LabelId(label as u16);
        }
    }
    let request = TrackRequest {
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(64 << 20)),
        keyframes: BTreeMap::from([(0, Arc::new(keyframe))]),
        from: 0,
        to: count,
        direction: Direction::Forward,
        labels: None,
    };
    let mut answered = 0u32;
    let mut emit = |given: TrackedFrame| {
        answered += 1;
        at(given.frame);
    };
    let start = Instant::now();
    tracker
        .track(&request, &mut emit, &Progress::default())
        .expect("the networks run");
    f64::from(answered) / start.elapsed().as_secs_f64()
}

/// Writes an image of stripes that move in front of a gradient, and returns its frame.
fn image(folder: &Path, frame: usize, width: u32, height: u32) -> Frame {
    let path = folder.join(format!("{frame:04}.png"));
    let shade = |x: u32, y: u32| {
        let stripe = if (x + y + 3 * frame as u32) % 64 < 32 {
            40
        } else {
            0
        };
        image::Rgb([
            (x * 200 / width) as u8 + stripe,
            (y * 200 / height) as u8,
            90 + stripe,
        ])
    };
    image::RgbImage::from_fn(width, height, shade)
        .save(&path)
        .expect("an image can be written");
    let image = ImageSource::File {
        path,
        orientation: Orientation::default(),
    };
    Frame {
        name: format!("{frame:04}"),
        width,
        height,
        image,
        depth: None,
        camera: None,
    }
}

/// Returns a line of `/proc/self/status` in MB; 0 on systems without it.
fn status_mb(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status
        .lines()
        .find(|line| line.starts_with(name))
        .unwrap_or_default();
    line.split_whitespace()
        .nth(1)
        .and_then(|kilobytes| kilobytes.parse::<u64>().ok())
        .unwrap_or(0)
        / 1000
}
