//! The surface of 50 frames of `redkitchen_rgbd_a` at 1 cm and at 5 mm: frames a second, decoding included, the surface
//! itself, and memory.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a bench speaks to the user and may panic"
)]

use std::time::Instant;

use ostra::engine::job::Progress;
use ostra::scene::volume::{VolumeOptions, reconstruct_surface};

#[path = "../support/mod.rs"]
#[expect(dead_code, reason = "the benches share it with the integration tests and use a part")]
mod support;

/// Pictures and depths kept: so few that every pass decodes anew.
const CACHE_BYTES: usize = 32 << 20;
const FRAMES: usize = 50;

fn main() {
    let Some(data) = support::data_dir() else { return };
    let set = data.join("redkitchen_rgbd_a");
    let mut recording = support::recording::Recording::open(&set, "color", Some("depth"), None, CACHE_BYTES);
    recording.frames.truncate(FRAMES);
    recording.masks = vec![None; recording.frames.len()];
    for voxel in [0.01, 0.005] {
        let options = VolumeOptions { voxel, ..VolumeOptions::default() };
        let begun = Instant::now();
        let surface = reconstruct_surface(&recording, &options, &Progress::default()).unwrap();
        let seconds = begun.elapsed().as_secs_f64();
        println!(
            "{:.0} mm: {} frames in {seconds:.2} s = {:.1} frames/s, {} triangles, volume {} MiB",
            voxel * 1000.0,
            surface.frames,
            surface.frames as f64 / seconds,
            surface.mesh.triangles.len(),
            surface.bytes >> 20
        );
    }
}
