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

mod following;

use following::Asked;
use ostra_tracking::xmem::XMem;

/// Columns, rows, and what was published.
const SIZES: [(u32, u32, &str); 3] = [
    (640, 480, "6.4–15.1"),
    (960, 540, "6.6–9.9"),
    (1280, 720, "1.3–2.2"),
];

fn main() {
    let Some(asked) = Asked::read() else { return };
    match XMem::load(&asked.folder) {
        Ok(xmem) => {
            let mut small = xmem.clone();
            small.options.short_side = None;
            asked.walk(&small);
            asked.rates(&xmem, &SIZES);
        }
        Err(error) => println!("{error}"),
    }
}
