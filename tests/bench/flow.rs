//! J, F and frames per second of the flow tracker on `davis2016`, from the true mask of the first frame, or of every
//! N-th, decoding included, with the peak memory of all clips.
//!
//! `cargo bench --bench flow [-- CLIP… [--every N] [--memory]]`; with `--memory` the tracker remembers by XFeat, added
//! before by `ostra models add xfeat FILE`.

use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use ostra::engine::job::Progress;
use ostra::engine::nn::models_folder;
use ostra::frames::{FrameFolder, FrameStore, OpenRequest, open};
use ostra::masks::flow::{Describer, FlowTracker};
use ostra::masks::onnx::XFeatCells;
use ostra::masks::{
    Direction, FramePair, LabelId, LabelMask, RunMask, TrackRequest, TrackedFrame, Tracker, score_pairs,
};

#[expect(clippy::print_stdout, reason = "a bench speaks to the user")]
fn main() -> Result<(), Box<dyn Error>> {
    let data = std::env::var_os("OSTRA_DATA").map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let set = data.join("davis2016");
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let every = match words.iter().position(|word| word == "--every") {
        Some(at) if at + 1 < words.len() => words.drain(at..at + 2).nth(1).unwrap_or_default().parse()?,
        _ => usize::MAX,
    };
    let has_memory = words.iter().any(|word| word == "--memory");
    let describer = has_memory.then(|| XFeatCells::load(&models_folder()?)).transpose()?;
    let describer = describer.map(|cells| Arc::new(cells) as Arc<dyn Describer>);
    let tracker = FlowTracker { describer, ..FlowTracker::default() };
    let named: Vec<String> = words.into_iter().filter(|word| !word.starts_with("--")).collect();
    let mut sums = [0.0; 3];
    let mut count = 0.0;
    for clip in clips(&set)?.into_iter().filter(|clip| named.is_empty() || named.contains(clip)) {
        let [j, f, fps] = tracked(&tracker, &set, &clip, every)?;
        println!("{clip:16} J {j:.3}  F {f:.3}  {fps:.1} frames/s");
        sums = [sums[0] + j, sums[1] + f, sums[2] + fps];
        count += 1.0;
    }
    let [j, f, fps] = sums.map(|sum| sum / f64::max(count, 1.0));
    println!("mean             J {j:.3}  F {f:.3}  {fps:.1} frames/s");
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    if let Some(peak) = status.lines().find(|line| line.starts_with("VmHWM")) {
        println!("{peak}");
    }
    Ok(())
}

fn clips(set: &Path) -> Result<Vec<String>, std::io::Error> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(set.join("JPEGImages"))? {
        names.push(entry?.file_name().to_string_lossy().into_owned());
    }
    names.sort();
    Ok(names)
}

/// Mean J, mean F over the frames without a given mask, and frames per second.
fn tracked(tracker: &FlowTracker, set: &Path, clip: &str, every: usize) -> Result<[f64; 3], Box<dyn Error>> {
    let source = FrameFolder { frames: set.join("JPEGImages").join(clip), depth: None };
    let frames = open(&OpenRequest { sources: vec![source], ..OpenRequest::default() }, &Progress::default())?.frames;
    let mut truths = Vec::new();
    for frame in &frames {
        let path = set.join("Annotations").join(clip).join(Path::new(&frame.name).with_extension("png"));
        let grey = image::open(path)?.to_luma8();
        let ids = grey.pixels().map(|pixel| LabelId(u16::from(pixel.0[0] > 127))).collect();
        truths.push(RunMask::encode(&LabelMask { width: grey.width(), height: grey.height(), ids }));
    }
    let request = TrackRequest {
        from: 0,
        to: frames.len() - 1,
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(64 << 20)),
        anchors: truths.iter().enumerate().step_by(every).map(|(at, truth)| (at, Arc::new(truth.decode()))).collect(),
        direction: Direction::Both,
        labels: None,
    };
    let mut pairs = Vec::new();
    let mut take = |tracked: TrackedFrame| {
        if tracked.preliminary {
            return;
        }
        let (name, truth) = (tracked.frame.to_string(), truths[tracked.frame].clone());
        pairs.push(FramePair { name, truth, result: RunMask::encode(&tracked.mask) });
    };
    let begun = Instant::now();
    tracker.track(&request, &mut take, &Progress::default())?;
    let fps = pairs.len() as f64 / begun.elapsed().as_secs_f64();
    let score = score_pairs(&pairs, &BTreeSet::from([LabelId(1)]), &Progress::default())?;
    Ok([score.j, score.f, fps])
}
