//! Surface of 50 frames of `redkitchen_rgbd_a` at 1 cm and at 5 mm.
//!
//! The surface is made with colours, then with the labels of a mask on every frame. Prints frames
//! per second, decoding included, the size of the surface, and memory.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a bench speaks to the user and may panic"
)]

use std::sync::Arc;
use std::time::Instant;

use ostra_cloud::fuse::{MaskVote, OntoOptions, SeenPoints, vote_seen};
use ostra_cloud::volume::{VolumeOptions, reconstruct_surface};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelMask, LabelTree};

#[path = "../support/data.rs"]
#[expect(
    dead_code,
    reason = "the benches share it with the integration tests and use a part"
)]
mod data;
#[path = "../support/data_set.rs"]
mod data_set;

/// Cache for images and depth; so small that every pass decodes again.
const CACHE_BYTES: usize = 32 << 20;
const FRAMES: usize = 50;

fn main() {
    let Ok(data) = data::find_data() else {
        return;
    };
    let set = data.join("redkitchen_rgbd_a");
    let mut recording = data_set::DataSet::open(&set, "color", Some("depth"), None, CACHE_BYTES);
    recording.frames.truncate(FRAMES);
    let masks = recording.frames.iter().map(|frame| {
        let ids = (0..frame.width * frame.height)
            .map(|at| LabelId((at % frame.width / 80 % 7) as u16))
            .collect();
        Some(Arc::new(LabelMask {
            width: frame.width,
            height: frame.height,
            ids,
        }))
    });
    recording.masks = masks.collect();
    for voxel in [0.01, 0.005] {
        let options = VolumeOptions {
            voxel,
            ..VolumeOptions::default()
        };
        let begun = Instant::now();
        let surface = reconstruct_surface(&recording, &options, &Progress::default()).unwrap();
        let seconds = begun.elapsed().as_secs_f64();
        let (tree, onto) = (LabelTree::default(), OntoOptions::default());
        let voted = vote_seen(
            surface.mesh.vertices.clone(),
            &SeenPoints::new(),
            &MaskVote {
                views: &recording,
                tree: &tree,
                options: &onto,
            },
            &Progress::default(),
        );
        let (all, labelled) = (begun.elapsed().as_secs_f64(), voted.unwrap().cloud);
        let is_labelled = |label: &&LabelId| **label != LabelId::NONE;
        println!(
            "{:.0} mm: {} frames in {seconds:.2} s = {:.1} frames/s, {} triangles, volume {} MiB; with labels {all:.2} s = \
             {:.1} frames/s, {} of {} vertices labelled; peak {} MiB",
            voxel * 1000.0,
            surface.frames,
            surface.frames as f64 / seconds,
            surface.mesh.triangles.len(),
            surface.bytes >> 20,
            surface.frames as f64 / all,
            labelled.labels.iter().filter(is_labelled).count(),
            labelled.len(),
            peak_mib()
        );
    }
}

/// Returns the peak memory of this process in MiB, or 0 if the system does not report it.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kib = |line: &str| {
        line.strip_prefix("VmHWM:")?
            .trim()
            .strip_suffix(" kB")?
            .parse::<u64>()
            .ok()
    };
    status.lines().find_map(kib).unwrap_or(0) / 1024
}
