//! Time of Grounding DINO for an image, and for the same image with another threshold.
//!
//! `cargo bench --bench grounding [FOLDER]`; FOLDER contains its two files. The time does not
//! depend on the weights: `python3 assets/export/grounding_dino.py --random 1 FOLDER` writes random
//! ones. Any `vocab.txt` with the tokens that captions need will do.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

use std::path::PathBuf;
use std::time::Instant;

use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::onnx::grounding::GroundingDino;
use ostra_masks::{GroundRequest, TextGrounder};

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'))
        .collect();
    let folder = words
        .first()
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("OSTRA_MODELS").map(PathBuf::from));
    let Some(folder) = folder else {
        println!("name the folder of networks, or set OSTRA_MODELS");
        return;
    };
    let start = Instant::now();
    let dino = match GroundingDino::load(&folder) {
        Ok(dino) => dino,
        Err(error) => {
            println!("{error}");
            return;
        }
    };
    println!("load {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    for (width, height) in [(960, 540), (1504, 1000), (4000, 3000)] {
        times(&dino, width, height);
    }
}

fn times(dino: &GroundingDino, width: u32, height: u32) {
    let pixel = |at: u32| {
        [
            (at % width * 255 / width) as u8,
            (at / width * 255 / height) as u8,
            (at % 251) as u8,
        ]
    };
    let image = Image {
        width,
        height,
        pixels: (0..width * height).map(pixel).collect(),
    };
    let phrases = ["red cat".to_owned(), "rice".to_owned()];
    let ms = |threshold: f32| {
        let start = Instant::now();
        let requested = GroundRequest {
            phrases: &phrases,
            threshold: Some(threshold),
        };
        dino.ground(&image, &requested, &Progress::default())
            .expect("the network runs");
        start.elapsed().as_secs_f64() * 1e3
    };
    println!(
        "{width}×{height}: an image {:.0} ms, another threshold {:.0} ms",
        ms(0.3),
        ms(0.5)
    );
}
