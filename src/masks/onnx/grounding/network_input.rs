use rayon::prelude::*;

use crate::MaskError;
use crate::onnx::resize::resized;
use ostra_core::image::ImageSize;
use ostra_frames::Image;

/// Length of the input's shorter side, and maximum length of the longer one, pixels.
const SHORT: f64 = 800.0;
const LONGEST: f64 = 1333.0;
/// Pixels along each side of a cell, per level.
const STRIDES: [usize; 4] = [8, 16, 32, 64];
/// Number of cells that become queries.
const QUERIES: usize = 900;
/// Mean and standard deviation per channel from training, as fractions of 255.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// An image as the network expects it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NetworkInput {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pixels: Vec<[u8; 3]>,
}

impl NetworkInput {
    /// Stretches an image to a square of [`SHORT`] pixels, for the export of Hugging Face.
    pub(super) fn square(image: &Image) -> Result<Self, MaskError> {
        check_pixels(image)?;
        let side = SHORT as usize;
        Ok(Self {
            columns: side,
            rows: side,
            pixels: resized(&image.pixels, image.size(), ImageSize::new(side, side)),
        })
    }

    /// Resizes an image to the size that the network was trained with.
    pub(super) fn new(image: &Image) -> Result<Self, MaskError> {
        check_pixels(image)?;
        let (columns, rows) = size(image.width, image.height);
        let cells: usize = STRIDES
            .iter()
            .map(|side| columns.div_ceil(*side) * rows.div_ceil(*side))
            .sum();
        if cells < QUERIES {
            let text = format!(
                "an image of {}×{} is too narrow to search",
                image.width, image.height
            );
            return Err(MaskError::Request(format!("{text}; crop it")));
        }
        let pixels = resized(&image.pixels, image.size(), ImageSize::new(columns, rows));
        Ok(Self {
            columns,
            rows,
            pixels,
        })
    }

    /// Returns the normalised red, green and blue planes.
    pub(super) fn planes(&self) -> Vec<f32> {
        let mut planes = vec![0.0; 3 * self.pixels.len()];
        planes
            .par_chunks_mut(self.pixels.len())
            .enumerate()
            .for_each(|(channel, plane)| {
                let normal =
                    |value: u8| (f32::from(value) / 255.0 - MEAN[channel]) / DEVIATION[channel];
                plane
                    .iter_mut()
                    .zip(&self.pixels)
                    .for_each(|(out, pixel)| *out = normal(pixel[channel]));
            });
        planes
    }
}

fn check_pixels(image: &Image) -> Result<(), MaskError> {
    if image.pixels.is_empty() {
        return Err(MaskError::Request(
            "there is nothing to find in an empty image; open another".into(),
        ));
    }
    Ok(())
}

/// Returns columns and rows as the official code computes them.
///
/// The shorter side is rounded, the longer one truncated.
fn size(width: u32, height: u32) -> (usize, usize) {
    let (least, most) = (f64::from(width.min(height)), f64::from(width.max(height)));
    let too_long = most / least * SHORT > LONGEST;
    let short = if too_long {
        (LONGEST * least / most).round_ties_even()
    } else {
        SHORT
    };
    let long = (short * most / least) as usize;
    let short = short as usize;
    if width < height {
        (short, long)
    } else {
        (long, short)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shorter_side_is_800_unless_the_longer_one_is_too_long() {
        let sizes = [
            (640, 480),
            (480, 640),
            (960, 540),
            (1504, 1000),
            (100, 100),
            (4000, 3000),
            (300, 1000),
        ];
        let found = sizes.map(|(width, height)| size(width, height));
        let expected = [
            (1066, 800),
            (800, 1066),
            (1333, 750),
            (1203, 800),
            (800, 800),
            (1066, 800),
            (400, 1333),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn channels_are_normalised_and_narrow_images_are_rejected() {
        let image = Image {
            width: 2,
            height: 2,
            pixels: vec![[255, 0, 51]; 4],
        };
        let planes = NetworkInput::new(&image).unwrap().planes();
        let [red, green, blue] = [0, 1, 2].map(|channel| planes[channel * 800 * 800 + 17]);
        assert!(
            (red - 2.248_908).abs() < 1e-5
                && (green + 2.035_714).abs() < 1e-5
                && (blue + 0.915_556).abs() < 1e-5
        );
        let narrow = Image {
            width: 2,
            height: 2000,
            pixels: vec![[0; 3]; 4000],
        };
        assert!(
            NetworkInput::new(&narrow)
                .unwrap_err()
                .to_string()
                .contains("too narrow")
        );
    }
}
