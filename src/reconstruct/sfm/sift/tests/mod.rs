//! Tests of SIFT.

mod borders;
mod keypoints;
mod matching;
mod parts;

use glam::Vec2;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// A Gaussian spot on grey 0.4.
struct Blob {
    at_px: Vec2,
    sigma_px: f32,
    contrast: f32,
}

/// Returns spots of all sizes, spread at random over an image.
fn strewn(count: usize, width: usize, height: usize) -> Vec<Blob> {
    let mut random = Pcg64Mcg::seed_from_u64(7);
    let blob = |_| Blob {
        at_px: Vec2::new(
            random.random_range(0.0..width as f32),
            random.random_range(0.0..height as f32),
        ),
        sigma_px: random.random_range(0.3_f32..2.3).exp(),
        contrast: random.random_range(-0.4..0.4),
    };
    (0..count).map(blob).collect()
}

fn painted(blobs: &[Blob], width: usize, height: usize) -> Vec<f32> {
    let mut grey = vec![0.4; width * height];
    for blob in blobs {
        let reach = 4.5 * blob.sigma_px;
        let span = |at: f32, size: usize| {
            (
                (at - reach).max(0.0) as usize,
                ((at + reach).max(0.0) as usize).min(size),
            )
        };
        let ((left, right), (top, bottom)) =
            (span(blob.at_px.x, width), span(blob.at_px.y, height));
        for y in top..bottom {
            for x in left..right {
                let apart = Vec2::new(x as f32 + 0.5, y as f32 + 0.5) - blob.at_px;
                let fall = (-0.5 * apart.length_squared() / (blob.sigma_px * blob.sigma_px)).exp();
                grey[y * width + x] += blob.contrast * fall;
            }
        }
    }
    grey
}
