//! Time and memory of DeAOT: frames a second at three sizes, and the peak of memory over a long walk.
//!
//! `cargo bench --bench deaot [FOLDER] [FRAMES] [LONG]`; FOLDER holds its four files, FRAMES are followed at each size
//! (12), LONG in the long walk (500, at 160×96). Time does not depend on the weights: `python3 assets/export/deaot.py
//! --random 1 FOLDER` makes some. It grows with what is remembered, up to the bound of the options.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

mod following;

use following::Asked;
use ostra_tracking::deaot::Deaot;

/// Columns, rows, and what was published.
const SIZES: [(u32, u32, &str); 3] = [
    (640, 480, "5.5–6.8"),
    (960, 540, "5.2"),
    (1280, 720, "3.2–3.8"),
];

fn main() {
    let Some(asked) = Asked::read() else { return };
    match Deaot::load(&asked.folder) {
        Ok(deaot) => {
            asked.walk(&deaot);
            asked.rates(&deaot, &SIZES);
        }
        Err(error) => println!("{error}"),
    }
}
