//! J, F and frames per second of the flow tracker on `davis2016`, decoding included.
//!
//! Tracking starts from the ground-truth mask of the first frame, or of every N-th. The bench also
//! prints the peak memory of all clips and three figures of the tracker's confidence: its mean, its
//! mean distance from the frames' IoU, and Spearman's rank correlation with the IoU.
//!
//! `cargo bench --bench flow [-- CLIP… [--every N] [--memory]]`; with `--memory` the tracker
//! remembers XFeat features. Add the network before by `ostra models add xfeat FILE`.

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use ostra_compute::nn::models_folder;
use ostra_core::job::Progress;
use ostra_eval::mask_score::{FramePair, score_pairs};
use ostra_frames::{Frame, FrameFolder, FrameStore, OpenRequest, open};
use ostra_masks::{Direction, LabelId, LabelMask, RunMask, TrackRequest, TrackedFrame, Tracker};
use ostra_tracking::XFeatCells;
use ostra_tracking::flow::{DenseFeatures, FlowTracker};

#[expect(clippy::print_stdout, reason = "a bench speaks to the user")]
fn main() -> Result<(), Box<dyn Error>> {
    let data = std::env::var_os("OSTRA_DATA")
        .map_or_else(|| PathBuf::from("../shared/data"), PathBuf::from);
    let set = data.join("davis2016");
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let every = match words.iter().position(|word| word == "--every") {
        Some(at) if at + 1 < words.len() => {
            words.drain(at..at + 2).nth(1).unwrap_or_default().parse()?
        }
        _ => usize::MAX,
    };
    let has_memory = words.iter().any(|word| word == "--memory");
    let features = has_memory
        .then(|| XFeatCells::load(&models_folder()?))
        .transpose()?;
    let features = features.map(|cells| Arc::new(cells) as Arc<dyn DenseFeatures>);
    let tracker = FlowTracker {
        features,
        ..FlowTracker::default()
    };
    let named: Vec<String> = words
        .into_iter()
        .filter(|word| !word.starts_with("--"))
        .collect();
    let mut sums = [0.0; 6];
    let mut count = 0.0;
    for clip in clips(&set)?
        .into_iter()
        .filter(|clip| named.is_empty() || named.contains(clip))
    {
        let figures = tracked(&tracker, &set, &clip, every)?;
        println!("{}", line(&clip, figures));
        sums.iter_mut()
            .zip(figures)
            .for_each(|(sum, figure)| *sum += figure);
        count += 1.0;
    }
    println!(
        "{}",
        line("mean", sums.map(|sum| sum / f64::max(count, 1.0)))
    );
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

fn line(name: &str, [j, f, fps, confidence, off, order]: [f64; 6]) -> String {
    format!(
        "{name:16} J {j:.3}  F {f:.3}  {fps:4.1} frames/s  confidence {confidence:.3}, off by {off:.3}, order {order:.2}"
    )
}

/// Reads the true masks of a clip's frames.
fn read_truths(frames: &[Frame], folder: &Path) -> Result<Vec<RunMask>, Box<dyn Error>> {
    let mut truths = Vec::new();
    for frame in frames {
        let path = folder.join(Path::new(&frame.name).with_extension("png"));
        let grey = image::open(path)?.to_luma8();
        let ids = grey
            .pixels()
            .map(|pixel| LabelId(u16::from(pixel.0[0] > 127)))
            .collect();
        truths.push(RunMask::encode(&LabelMask {
            width: grey.width(),
            height: grey.height(),
            ids,
        }));
    }
    Ok(truths)
}

/// Returns mean J, mean F, frames per second, and three figures of the confidence.
///
/// J and F are over the frames without a given mask. The figures are the mean confidence (0 where
/// the object is not found), its mean distance from the frames' IoU (1 where there is no object),
/// and the rank correlation of the two.
fn tracked(
    tracker: &FlowTracker,
    set: &Path,
    clip: &str,
    every: usize,
) -> Result<[f64; 6], Box<dyn Error>> {
    let source = FrameFolder {
        frames: set.join("JPEGImages").join(clip),
        depth: None,
    };
    let frames = open(
        &OpenRequest {
            sources: vec![source],
            ..OpenRequest::default()
        },
        &Progress::default(),
    )?
    .frames;
    let truths = read_truths(&frames, &set.join("Annotations").join(clip))?;
    let request = TrackRequest {
        from: 0,
        to: frames.len() - 1,
        frames: Arc::new(frames),
        store: Arc::new(FrameStore::new(64 << 20)),
        keyframes: truths
            .iter()
            .enumerate()
            .step_by(every)
            .map(|(at, truth)| (at, Arc::new(truth.decode())))
            .collect(),
        direction: Direction::Both,
        labels: None,
    };
    let (mut pairs, mut confidence) = (Vec::new(), Vec::new());
    let mut take = |tracked: TrackedFrame| {
        if tracked.preliminary {
            return;
        }
        let (name, truth) = (tracked.frame.to_string(), truths[tracked.frame].clone());
        confidence.push(
            tracked
                .confidence
                .get(&LabelId(1))
                .map_or(0.0, |&confidence| f64::from(confidence)),
        );
        pairs.push(FramePair {
            name,
            truth,
            result: RunMask::encode(&tracked.mask),
        });
    };
    let begun = Instant::now();
    tracker.track(&request, &mut take, &Progress::default())?;
    let fps = pairs.len() as f64 / begun.elapsed().as_secs_f64();
    let score = score_pairs(&pairs, &BTreeSet::from([LabelId(1)]), &Progress::default())?;
    let region = |mask: &RunMask| mask.decode().region(LabelId(1));
    let ious: Vec<f64> = pairs
        .iter()
        .map(|pair| region(&pair.truth).iou(&region(&pair.result)))
        .collect();
    let off = mean(
        confidence
            .iter()
            .zip(&ious)
            .map(|(confidence, iou)| (confidence - iou).abs()),
    );
    Ok([
        score.j,
        score.f,
        fps,
        mean(confidence.iter().copied()),
        off,
        rank_correlation(&confidence, &ious),
    ])
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

/// Returns Spearman's rank correlation.
///
/// It is 1 for the same order, −1 for opposite orders, and 0 if all values of one list are equal.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let middle = (a.len() as f64 - 1.0) / 2.0;
    let (a, b) = (ranks(a), ranks(b));
    let product = |a: &[f64], b: &[f64]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a - middle) * (b - middle))
            .sum::<f64>()
    };
    let spread = (product(&a, &a) * product(&b, &b)).sqrt();
    if spread > 0.0 {
        product(&a, &b) / spread
    } else {
        0.0
    }
}

/// Returns the rank of each value from 0 on; equal values share their mean rank.
fn ranks(values: &[f64]) -> Vec<f64> {
    let place = |value: &f64| {
        let (less, equal) = values.iter().fold((0.0, 0.0), |(less, equal), other| {
            match other.total_cmp(value) {
                Ordering::Less => (less + 1.0, equal),
                Ordering::Equal => (less, equal + 1.0),
                Ordering::Greater => (less, equal),
            }
        });
        less + (equal - 1.0) / 2.0
    };
    values.iter().map(place).collect()
}
