//! Images and depth maps of data sets.

use std::path::Path;
use std::sync::Arc;

use ostra_frames::{DepthMap, Image};

/// Reads an image.
pub fn read_image(path: &Path) -> Arc<Image> {
    let image = image::open(path).expect("the image can be read").to_rgb8();
    Arc::new(Image {
        width: image.width(),
        height: image.height(),
        pixels: image.pixels().map(|pixel| pixel.0).collect(),
    })
}

/// Reads a depth map in millimetres.
pub fn read_depth(path: &Path) -> DepthMap {
    let image = image::open(path)
        .expect("the depth can be read")
        .to_luma16();
    DepthMap {
        width: image.width(),
        height: image.height(),
        depths: image
            .pixels()
            .map(|pixel| f32::from(pixel.0[0]) * 1e-3)
            .collect(),
    }
}
