//! Fusion of `redkitchen_rgbd_a` at 1 cm with a mask on every frame: frames a second, decoding included, and peak
//! memory; then relabelling, and a large cloud through a PLY file.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use ostra::engine::job::Progress;
use ostra::frames::{Frame, FrameCamera, FrameFolder, FrameStore, OpenRequest, open};
use ostra::geometry::{Camera, Pose};
use ostra::masks::{LabelId, LabelMask, LabelTree};
use ostra::scene::LabelledCloud;
use ostra::scene::fuse::{ChangedMask, FuseOptions, Fused, ProjectViews, fuse, read_votes, relabel, write_votes};
use ostra::scene::ply::{Coloring, read_ply, save_ply};

#[path = "../support/mod.rs"]
#[expect(dead_code, reason = "the benches share it with the integration tests and use a part")]
mod support;

fn main() {
    let Some(data) = support::data_dir() else { return };
    let frames = load(&data.join("redkitchen_rgbd_a"));
    let fused = bench_fuse(&frames);
    bench_relabel(&frames, &fused);
    bench_votes_file(&fused);
    bench_ply();
}

fn load(dir: &Path) -> Vec<Frame> {
    let source = FrameFolder { frames: dir.join("color"), depth: Some(dir.join("depth")) };
    let request = OpenRequest { sources: vec![source], ..OpenRequest::default() };
    let mut frames = open(&request, &Progress::default()).unwrap().frames;
    let numbers = |line: &str| -> Vec<f64> { line.split_whitespace().filter_map(|w| w.parse().ok()).collect() };
    let cameras = std::fs::read_to_string(dir.join("sparse/cameras.txt")).unwrap();
    let c = numbers(cameras.lines().last().unwrap());
    let intrinsics = Camera::pinhole(c[1] as u32, c[2] as u32, c[3], c[4], c[5], c[6]);
    let images = std::fs::read_to_string(dir.join("sparse/images.txt")).unwrap();
    for line in images.lines().filter(|l| !l.starts_with('#') && !l.is_empty()) {
        let n = numbers(line);
        let name = line.split_whitespace().last().unwrap();
        let pose = Pose {
            rotation: glam::DQuat::from_xyzw(n[2], n[3], n[4], n[1]).normalize(),
            translation: glam::DVec3::new(n[5], n[6], n[7]),
        };
        let frame = frames.iter_mut().find(|f| f.name == name).unwrap();
        frame.camera = Some(FrameCamera { intrinsics, camera_from_world: Some(pose) });
    }
    frames
}

/// A mask whose labels do not matter, only that it votes.
fn mask(frame: &Frame, shift: u32) -> Arc<LabelMask> {
    let id = |index: u32| LabelId((((index % frame.width + shift) / 90 + index / frame.width / 80) % 5) as u16);
    let ids = (0..frame.width * frame.height).map(id).collect();
    Arc::new(LabelMask { width: frame.width, height: frame.height, ids })
}

fn bench_fuse(frames: &[Frame]) -> Fused {
    let store = FrameStore::new(32 << 20);
    let masks = |index: usize| Some(mask(&frames[index], 0));
    let views = ProjectViews { frames, store: &store, masks: &masks };
    let options = FuseOptions { voxel: Some(0.01), ..FuseOptions::default() };
    let (start, cpu) = (Instant::now(), cpu_seconds());
    let fused = fuse(&views, &LabelTree::default(), &options, &Progress::default()).unwrap();
    let (wall, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - cpu);
    println!(
        "fuse: {} frames in {wall:.2} s = {:.1} frames/s ({cpu:.2} s of CPU = {:.1} frames/s on 2 idle cores), {} points, peak {} MB",
        frames.len(),
        frames.len() as f64 / wall,
        frames.len() as f64 / cpu * 2.0,
        fused.cloud.len(),
        peak_memory_mb()
    );
    fused
}

fn bench_relabel(frames: &[Frame], fused: &Fused) {
    for count in [1, frames.len()] {
        let changed: Vec<ChangedMask> =
            (0..count).map(|frame| ChangedMask { frame, mask: Some(mask(&frames[frame], 40)) }).collect();
        let start = Instant::now();
        relabel(&fused.cloud, &fused.votes, &changed, &LabelTree::default(), &Progress::default()).unwrap();
        println!("relabel: {count} frames changed: {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    }
}

fn bench_votes_file(fused: &Fused) {
    let mut bytes = Vec::new();
    let start = Instant::now();
    write_votes(&mut bytes, &fused.votes).unwrap();
    let written = start.elapsed().as_secs_f64();
    read_votes(&bytes[..]).unwrap();
    let read = start.elapsed().as_secs_f64() - written;
    println!("votes: {} MB, written in {:.0} ms, read in {:.0} ms", bytes.len() >> 20, written * 1e3, read * 1e3);
}

fn bench_ply() {
    let position = |i: u32| glam::Vec3::new(i as f32, (i % 1000) as f32, 0.5) * 0.001;
    let cloud = LabelledCloud::from_positions((0..5_000_000).map(position).collect());
    let path = std::env::temp_dir().join(format!("ostra-bench-{}.ply", std::process::id()));
    let start = Instant::now();
    save_ply(&path, &cloud, Coloring::Picture, &Progress::default()).unwrap();
    let written = start.elapsed().as_secs_f64();
    read_ply(&path, &Progress::default()).unwrap();
    let read = start.elapsed().as_secs_f64() - written;
    std::fs::remove_file(&path).unwrap();
    println!("ply: 5 M points written (with fsync) in {:.0} ms, read in {:.0} ms", written * 1e3, read * 1e3);
}

fn peak_memory_mb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak =
        status.lines().find_map(|line| line.strip_prefix("VmHWM:")?.trim().strip_suffix(" kB")?.parse::<u64>().ok());
    peak.unwrap_or(0) >> 10
}

/// CPU time of this process, in seconds.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks: f64 = after_name.split_whitespace().skip(11).take(2).filter_map(|t| t.parse::<f64>().ok()).sum();
    ticks / 100.0
}
