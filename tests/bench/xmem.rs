//! Frames per second of XMem at three sizes, and its peak memory over a long video.
//!
//! `cargo bench --bench xmem [FOLDER] [FRAMES] [LONG]`; FOLDER contains its three files, FRAMES are
//! tracked at each size (12), LONG in the long video (500, at 160×96). The time does not depend on
//! the weights: `python3 assets/export/xmem.py --random 1 FOLDER` writes random ones.
//!
//! Published for an RTX 3060: 6.4–15.1 frames/s at 640×480, 6.6–9.9 at 960×540, 1.3–2.2 at
//! 1280×720.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

mod following;

use following::TrackedCase;
use ostra_tracking::xmem::XMem;

/// Width, height, and published frames per second.
const SIZES: [(u32, u32, &str); 3] = [
    (640, 480, "6.4–15.1"),
    (960, 540, "6.6–9.9"),
    (1280, 720, "1.3–2.2"),
];

fn main() {
    let Some(requested) = TrackedCase::read() else {
        return;
    };
    match XMem::load(&requested.folder) {
        Ok(xmem) => {
            let mut small = xmem.clone();
            small.options.short_side = None;
            requested.walk(&small);
            requested.rates(&xmem, &SIZES);
        }
        Err(error) => println!("{error}"),
    }
}
