//! Time and memory of DeAOT: frames a second at three sizes, and the peak of memory over a long walk.
//!
//! `cargo bench --bench deaot [FOLDER] [FRAMES] [LONG]`; FOLDER holds its four files, FRAMES are followed at each size
//! (12), LONG in the long walk (500, at 160×96). Time does not depend on the weights: `python3 assets/export/deaot.py
//! --random 1 FOLDER` makes some. It grows with what is remembered, up to the bound of the options.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use ostra::engine::job::Progress;
use ostra::frames::{Frame, FrameStore, Orientation, PictureSource};
use ostra::masks::onnx::deaot::Deaot;
use ostra::masks::{Direction, LabelId, LabelMask, TrackRequest, TrackedFrame, Tracker};

const LABELS: u32 = 3;
/// Columns, rows, and what was published.
const SIZES: [(u32, u32, &str); 3] = [(640, 480, "5.5–6.8"), (960, 540, "5.2"), (1280, 720, "3.2–3.8")];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let folder = words.first().map(PathBuf::from).or_else(|| std::env::var_os("OSTRA_MODELS").map(PathBuf::from));
    let Some(folder) = folder else {
        println!("name the folder of networks, or set OSTRA_MODELS");
        return;
    };
    let number = |at: usize, usual| words.get(at).and_then(|word| word.parse().ok()).unwrap_or(usual);
    let deaot = match Deaot::load(&folder) {
        Ok(deaot) => deaot,
        Err(error) => {
            println!("{error}");
            return;
        }
    };
    let scratch = tempfile::tempdir().expect("a folder can be made");
    follow(&deaot, scratch.path(), (160, 96), number(2, 500), &mut |frame| {
        if frame % 50 == 0 {
            println!("160×96, frame {frame}: {} MB now, peak {} MB", status_mb("VmRSS"), status_mb("VmHWM"));
        }
    });
    for (width, height, published) in SIZES {
        let scratch = tempfile::tempdir().expect("a folder can be made");
        let rate = follow(&deaot, scratch.path(), (width, height), number(1, 12), &mut |_| {});
        println!(
            "{width}×{height}, {LABELS} labels: {rate:.3} frames/s (published, RTX 3060: {published}), peak {} MB",
            status_mb("VmHWM")
        );
    }
}

/// Follows labels over made pictures forwards; frames answered in a second.
fn follow(deaot: &Deaot, folder: &Path, (width, height): (u32, u32), count: usize, at: &mut dyn FnMut(usize)) -> f64 {
    let frames = (0..=count).map(|frame| picture(folder, frame, width, height)).collect();
    let mut anchor = LabelMask::empty(width, height);
    for (place, id) in anchor.ids.iter_mut().enumerate() {
        let (x, y) = (place as u32 % width, place as u32 / width);
        let label = 1 + x * (LABELS + 1) / width;
        if label <= LABELS && (height / 4..height / 2).contains(&y) {
            *id = LabelId(label as u16);
        }
    }
    let request = TrackRequest {
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(64 << 20)),
        anchors: BTreeMap::from([(0, Arc::new(anchor))]),
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
    deaot.track(&request, &mut emit, &Progress::default()).expect("the networks run");
    f64::from(answered) / start.elapsed().as_secs_f64()
}

/// A picture in a file: stripes that move before a gradient.
fn picture(folder: &Path, frame: usize, width: u32, height: u32) -> Frame {
    let path = folder.join(format!("{frame:04}.png"));
    let shade = |x: u32, y: u32| {
        let stripe = if (x + y + 3 * frame as u32) % 64 < 32 { 40 } else { 0 };
        image::Rgb([(x * 200 / width) as u8 + stripe, (y * 200 / height) as u8, 90 + stripe])
    };
    image::RgbImage::from_fn(width, height, shade).save(&path).expect("a picture can be written");
    let picture = PictureSource::File { path, orientation: Orientation::default() };
    Frame { name: format!("{frame:04}"), width, height, picture, depth: None, camera: None }
}

/// A line of `/proc/self/status`, in MB; 0 on systems without it.
fn status_mb(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(name)).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kilobytes| kilobytes.parse::<u64>().ok()).unwrap_or(0) / 1000
}
