//! Time and memory of XMem: frames a second at three sizes, and the peak of memory over a long walk.
//!
//! `cargo bench --bench xmem [FOLDER] [FRAMES] [LONG]`; FOLDER holds its three files, FRAMES are followed at each size (12),
//! LONG in the long walk (500, at 160×96). Time does not depend on the weights: `python3 assets/export/xmem.py --random 1
//! FOLDER` makes some. Published for an RTX 3060: 6.4–15.1 frames/s at 640×480, 6.6–9.9 at 960×540, 1.3–2.2 at 1280×720.

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
use ostra::masks::onnx::xmem::XMem;
use ostra::masks::{Direction, LabelId, LabelMask, TrackRequest, Tracker};

const LABELS: u32 = 3;
/// Columns, rows, and what was published.
const SIZES: [(u32, u32, &str); 3] = [(640, 480, "6.4–15.1"), (960, 540, "6.6–9.9"), (1280, 720, "1.3–2.2")];

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect();
    let folder = words.first().map(PathBuf::from).or_else(|| std::env::var_os("OSTRA_MODELS").map(PathBuf::from));
    let Some(folder) = folder else {
        println!("name the folder of networks, or set OSTRA_MODELS");
        return;
    };
    let number = |at: usize, usual| words.get(at).and_then(|word| word.parse().ok()).unwrap_or(usual);
    let mut xmem = match XMem::load(&folder) {
        Ok(xmem) => xmem,
        Err(error) => {
            println!("{error}");
            return;
        }
    };
    // First, while the process has not yet been larger.
    let usual = xmem.options;
    xmem.options.short_side = None;
    let (count, scratch) = (number(2, 500), tempfile::tempdir().expect("a folder can be made"));
    follow(&xmem, scratch.path(), 160, 96, count, &mut |frame| {
        if frame % 50 == 0 {
            println!("160×96, frame {frame}: {} MB now, peak {} MB", status_mb("VmRSS"), peak_mb());
        }
    });
    xmem.options = usual;
    for (width, height, published) in SIZES {
        let (count, scratch) = (number(1, 12), tempfile::tempdir().expect("a folder can be made"));
        let start = Instant::now();
        let frames = follow(&xmem, scratch.path(), width, height, count, &mut |_| {});
        let seconds = start.elapsed().as_secs_f64();
        println!(
            "{width}×{height}, {LABELS} labels: {:.2} frames/s (published, RTX 3060: {published}), peak {} MB",
            frames as f64 / seconds,
            peak_mb()
        );
    }
}

/// Follows labels over made pictures forwards; the number of frames answered.
fn follow(xmem: &XMem, folder: &Path, width: u32, height: u32, count: usize, at: &mut dyn FnMut(usize)) -> usize {
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
    let mut answered = 0;
    let mut emit = |given: ostra::masks::TrackedFrame| {
        answered += 1;
        at(given.frame);
    };
    xmem.track(&request, &mut emit, &Progress::default()).expect("the networks run");
    answered
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

fn peak_mb() -> u64 {
    status_mb("VmHWM")
}

/// A line of `/proc/self/status`, in MB; 0 on systems without it.
fn status_mb(name: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with(name)).unwrap_or_default();
    line.split_whitespace().nth(1).and_then(|kilobytes| kilobytes.parse::<u64>().ok()).unwrap_or(0) / 1000
}
