//! Frames per second of DeAOT at three sizes, and its peak memory over a long video.
//!
//! `cargo bench --bench deaot [FOLDER] [FRAMES] [LONG]`; FOLDER contains its four files, FRAMES are
//! tracked at each size (12), LONG in the long video (500, at 160×96).
//!
//! The time does not depend on the weights: `python3 assets/export/deaot.py --random 1 FOLDER`
//! writes random ones. It grows with the number of remembered frames, up to the bound of the
//! options.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

mod following;

use following::TrackedCase;
use ostra_tracking::deaot::Deaot;

/// Width, height, and published frames per second.
const SIZES: [(u32, u32, &str); 3] = [
    (640, 480, "5.5–6.8"),
    (960, 540, "5.2"),
    (1280, 720, "3.2–3.8"),
];

fn main() {
    let Some(requested) = TrackedCase::read() else {
        return;
    };
    match Deaot::load(&requested.folder) {
        Ok(deaot) => {
            requested.walk(&deaot);
            requested.rates(&deaot, &SIZES);
        }
        Err(error) => println!("{error}"),
    }
}
