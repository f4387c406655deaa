//! Segments the object at a clicked pixel of an image.
//!
//! `cargo run --release --example click_to_mask -- IMAGE X Y MASK.png`

use std::error::Error;
use std::sync::Arc;

use glam::DVec2;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{Click, Prompt, SegmentRequest, Segmenter};

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [image, x, y, mask] = &args[..] else {
        return Err("usage: click_to_mask IMAGE X Y MASK.png".into());
    };
    let pixels = image::open(image)?.to_rgb8();
    let image = Arc::new(Image {
        width: pixels.width(),
        height: pixels.height(),
        pixels: pixels.pixels().map(|pixel| pixel.0).collect(),
    });

    // The work that needs no click is done once per image.
    let progress = Progress::default();
    let prepared = BuiltinSegmenter.prepare(&image, None, &progress)?;
    let prompt = Prompt {
        clicks: vec![Click {
            at_px: DVec2::new(x.parse()?, y.parse()?),
            include: true,
        }],
        ..Prompt::default()
    };
    let request = SegmentRequest {
        prompt: &prompt,
        previous: None,
        taken: None,
    };
    let region = prepared.segment(&request, &progress)?;

    let white = |x, y| image::Luma([u8::from(region.at(x, y)) * 255]);
    image::GrayImage::from_fn(region.width, region.height, white).save(mask)?;
    Ok(())
}
