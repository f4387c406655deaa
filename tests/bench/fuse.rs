//! Fusion of `redkitchen_rgbd_a` at 1 cm with a mask on every frame.
//!
//! Prints frames per second, decoding included, and peak memory; then relabelling, and a large
//! cloud through a PLY file.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench speaks to the user and may panic"
)]

use std::sync::Arc;
use std::time::Instant;

use ostra_cloud::LabelledCloud;
use ostra_cloud::fuse::{ChangedMask, FuseOptions, Fused, fuse, read_votes, relabel, write_votes};
use ostra_cloud::ply::{SavedColors, read_ply, save_ply};
use ostra_core::job::Progress;
use ostra_frames::Frame;
use ostra_masks::{LabelId, LabelMask, LabelTree};

#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the benches share it with the integration tests and use a part"
)]
mod data;
#[path = "../support/data_set.rs"]
mod data_set;

/// Cache for images and depth during the fusion; so small that every pass decodes again.
const CACHE_BYTES: usize = 32 << 20;

fn main() {
    let Ok(data) = data::find_data() else {
        return;
    };
    let set = data.join("redkitchen_rgbd_a");
    let mut recording = data_set::DataSet::open(&set, "color", Some("depth"), None, CACHE_BYTES);
    recording.masks = recording
        .frames
        .iter()
        .map(|frame| Some(mask(frame, 0)))
        .collect();
    let fused = bench_fuse(&recording);
    bench_relabel(&recording.frames, &fused);
    bench_votes_file(&fused);
    bench_ply();
}

/// Returns the result of some work with its wall and CPU seconds.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64, f64) {
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let done = work();
    (done, start.elapsed().as_secs_f64(), cpu_seconds() - cpu)
}

/// Returns a mask whose labels do not matter; it only has to vote.
fn mask(frame: &Frame, shift: u32) -> Arc<LabelMask> {
    let id = |index: u32| {
        LabelId((((index % frame.width + shift) / 90 + index / frame.width / 80) % 5) as u16)
    };
    let ids = (0..frame.width * frame.height).map(id).collect();
    Arc::new(LabelMask {
        width: frame.width,
        height: frame.height,
        ids,
    })
}

fn bench_fuse(recording: &data_set::DataSet) -> Fused {
    let options = FuseOptions {
        voxel: Some(0.01),
        ..FuseOptions::default()
    };
    let (fused, wall, cpu) = timed(|| {
        fuse(
            recording,
            &LabelTree::default(),
            &options,
            &Progress::default(),
        )
        .unwrap()
    });
    let count = recording.frames.len() as f64;
    println!(
        "fuse: {count} frames in {wall:.2} s = {:.1} frames/s; {cpu:.2} s of CPU = {:.1} frames/s on two cores of its own",
        count / wall,
        2.0 * count / cpu
    );
    println!(
        "      {} points, peak {} MB",
        fused.cloud.len(),
        peak_memory_mb()
    );
    fused
}

fn bench_relabel(frames: &[Frame], fused: &Fused) {
    for count in [1, frames.len()] {
        let changed: Vec<ChangedMask> = (0..count)
            .map(|frame| ChangedMask {
                frame,
                mask: Some(mask(&frames[frame], 40)),
            })
            .collect();
        let tree = LabelTree::default();
        let (_, wall, cpu) = timed(|| {
            relabel(
                &fused.cloud,
                &fused.votes,
                &changed,
                &tree,
                &Progress::default(),
            )
            .unwrap()
        });
        println!("relabel: {count} frames changed: {wall:.2} s, {cpu:.2} s of CPU");
    }
}

fn bench_votes_file(fused: &Fused) {
    let mut bytes = Vec::new();
    let ((), _, written) = timed(|| write_votes(&mut bytes, &fused.votes).unwrap());
    let (_, _, read) = timed(|| read_votes(&bytes[..]).unwrap());
    println!(
        "votes: {} MB; {written:.2} s of CPU to write, {read:.2} s to read",
        bytes.len() >> 20
    );
}

fn bench_ply() {
    let position = |i: u32| glam::Vec3::new(i as f32, (i % 1000) as f32, 0.5) * 0.001;
    let cloud = LabelledCloud::from_positions((0..5_000_000).map(position).collect());
    let path = std::env::temp_dir().join(format!("ostra-bench-{}.ply", std::process::id()));
    let ((), wall, cpu) =
        timed(|| save_ply(&path, &cloud, SavedColors::Image, &Progress::default()).unwrap());
    println!("ply: 5 M points written in {wall:.2} s, {cpu:.2} s of CPU");
    let (_, wall, cpu) = timed(|| read_ply(&path, &Progress::default()).unwrap());
    println!("ply: 5 M points read in {wall:.2} s, {cpu:.2} s of CPU");
    std::fs::remove_file(&path).unwrap();
}

fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|line| {
        line.strip_prefix("VmHWM:")?
            .trim()
            .strip_suffix(" kB")?
            .parse::<u64>()
            .ok()
    });
    peak.unwrap_or(0) >> 10
}

/// Returns the CPU time of this process in seconds.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = after_name
        .split_whitespace()
        .skip(11)
        .take(2)
        .filter_map(|t| t.parse::<f64>().ok())
        .sum();
    ticks / 100.0
}
