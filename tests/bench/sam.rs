//! Time of Segment Anything.
//!
//! Measures the encoder once per image, the decoder for every click, and the upscaling of its mask.
//!
//! `cargo bench --bench sam [NAME] [FOLDER]`; NAME is that of the catalogue (`sam-vit-b`), FOLDER
//! contains its two files. The time does not depend on the weights: `python3 assets/export/sam.py
//! --random 1 FOLDER` writes random ones.

#![expect(
    clippy::print_stdout,
    clippy::expect_used,
    reason = "a bench prints its table and ends where data is missing"
)]

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use glam::DVec2;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::onnx::sam::{ImagePart, Sam};
use ostra_masks::{Click, PreparedFrame, Prompt, SegmentRequest};

const CLICKS: u32 = 20;

fn main() {
    let words: Vec<String> = std::env::args()
        .skip(1)
        .filter(|word| !word.starts_with('-'))
        .collect();
    let name = words.first().map_or("sam-vit-b", |word| word.as_str());
    let folder = words
        .get(1)
        .map(PathBuf::from)
        .or_else(|| std::env::var_os("OSTRA_MODELS").map(PathBuf::from));
    let Some(folder) = folder else {
        println!("name the folder of networks, or set OSTRA_MODELS");
        return;
    };
    let start = Instant::now();
    let sam = match Sam::load(&folder, name) {
        Ok(sam) => sam,
        Err(error) => {
            println!("{error}");
            return;
        }
    };
    println!("load {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    for (width, height) in [(960, 540), (1504, 1000), (4000, 3000)] {
        times(&sam, width, height);
    }
}

fn times(sam: &Sam, width: u32, height: u32) {
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
    let start = Instant::now();
    let embedding = sam
        .embed(
            &image,
            ImagePart::whole(width, height),
            &Progress::default(),
        )
        .expect("the encoder runs");
    let encoded = start.elapsed();
    let frame = Arc::new(
        sam.frame(&embedding)
            .expect("the embedding is of this network"),
    );
    let mut requested: Vec<f64> = (0..CLICKS)
        .map(|at| click(&*frame, at, width, height))
        .collect();
    requested.sort_by(f64::total_cmp);
    println!(
        "{width}×{height}: encoder {:.0} ms, a click {:.0} ms (median of {CLICKS}, longest {:.0} ms), embedding {} kB",
        encoded.as_secs_f64() * 1e3,
        requested[requested.len() / 2],
        requested[requested.len() - 1],
        embedding.bytes() / 1000
    );
}

/// Returns the milliseconds of a click that was not made before.
fn click(frame: &dyn PreparedFrame, at: u32, width: u32, height: u32) -> f64 {
    let share = (f64::from(at) + 0.5) / f64::from(CLICKS);
    let at_px = DVec2::new(share * f64::from(width), (1.0 - share) * f64::from(height));
    let prompt = Prompt {
        clicks: vec![Click {
            at_px,
            include: true,
        }],
        ..Prompt::default()
    };
    let start = Instant::now();
    let region = frame.segment(
        &SegmentRequest {
            prompt: &prompt,
            previous: None,
            taken: None,
        },
        &Progress::default(),
    );
    let elapsed = start.elapsed();
    assert!(
        region
            .expect("the click lies in the image")
            .at(at_px.x as u32, at_px.y as u32)
    );
    elapsed.as_secs_f64() * 1e3
}
