//! Region of every pixel.
//!
//! Large images are processed at a reduced size. At full size, every pixel then joins the nearby
//! region with the closest colour.

use rayon::prelude::*;

use super::region_stats::RegionStats;
use crate::Region;
use crate::lab::{lab_of_pixel, squared_difference};
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{DepthMap, Image};

/// Images with more pixels than this are reduced.
const MOST_PIXELS: usize = 1_300_000;

/// Pixels of the full-size image and the regions they belong to.
pub(super) struct Raster {
    pub width: usize,
    pub height: usize,
    /// Reduction factor: side of the square of pixels that is one pixel of the reduced image.
    pub factor: usize,
    /// Region of every pixel.
    pub of_pixel: Vec<u32>,
    /// Area of each region, pixels.
    areas: Vec<u32>,
}

/// Returns the factor by which an image is reduced.
pub(super) fn reduction(width: usize, height: usize) -> usize {
    let fits = |factor: &usize| width / factor * (height / factor) <= MOST_PIXELS;
    (1..=width.min(height)).find(fits).unwrap_or(1)
}

/// Averages every `factor²` pixels; an incomplete column or row at the right or bottom is dropped.
pub(super) fn reduced_image(image: &Image, factor: usize) -> Image {
    let (width, height) = reduced_size(image.width, image.height, factor);
    let mut pixels = vec![[0u8; 3]; width * height];
    pixels
        .par_chunks_exact_mut(width)
        .enumerate()
        .for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let mut sum = [0u32; 3];
                for line in y * factor..(y + 1) * factor {
                    let start = line * image.width as usize + x * factor;
                    for pixel in &image.pixels[start..start + factor] {
                        (0..3).for_each(|channel| sum[channel] += u32::from(pixel[channel]));
                    }
                }
                *out = sum.map(|sum| (sum / (factor * factor) as u32) as u8);
            }
        });
    Image {
        width: width as u32,
        height: height as u32,
        pixels,
    }
}

/// Takes the depth in the middle of every `factor²` pixels.
///
/// Averages would lie between two surfaces.
pub(super) fn reduced_depth(depth: &DepthMap, factor: usize) -> DepthMap {
    let (width, height) = reduced_size(depth.width, depth.height, factor);
    let at = |place: usize| {
        let (x, y) = (
            place % width * factor + factor / 2,
            place / width * factor + factor / 2,
        );
        depth.depths[y * depth.width as usize + x]
    };
    DepthMap {
        width: width as u32,
        height: height as u32,
        depths: (0..width * height).map(at).collect(),
    }
}

fn reduced_size(width: u32, height: u32, factor: usize) -> (usize, usize) {
    (width as usize / factor, height as usize / factor)
}

impl Raster {
    /// Transfers the regions of the reduced image to `image`.
    pub fn new(
        image: &Image,
        factor: usize,
        reduced: Vec<u32>,
        regions: &[RegionStats],
        progress: &Progress,
    ) -> Result<Self, Stopped> {
        let (width, height) = (image.width as usize, image.height as usize);
        let of_pixel = if factor == 1 {
            reduced
        } else {
            enlarged(image, factor, &reduced, regions, progress)?
        };
        let mut areas = vec![0; regions.len()];
        of_pixel
            .iter()
            .for_each(|&region| areas[region as usize] += 1);
        Ok(Self {
            width,
            height,
            factor,
            of_pixel,
            areas,
        })
    }

    /// Returns the region at a position in the full-size image, pixels.
    pub fn region_at(&self, at_px: glam::DVec2) -> u32 {
        self.of_pixel[self.pixel_at(at_px)]
    }

    /// Returns the pixel index at a position in the full-size image.
    pub fn pixel_at(&self, at_px: glam::DVec2) -> usize {
        let x = (at_px.x as usize).min(self.width - 1);
        let y = (at_px.y as usize).min(self.height - 1);
        y * self.width + x
    }

    /// Returns which regions lie mostly inside `mask`.
    pub fn mostly(&self, mask: &Region) -> Vec<bool> {
        let mut inside = vec![0u32; self.areas.len()];
        for (&region, &is_inside) in self.of_pixel.iter().zip(&mask.inside) {
            inside[region as usize] += u32::from(is_inside);
        }
        inside
            .iter()
            .zip(&self.areas)
            .map(|(inside, area)| inside * 2 > *area)
            .collect()
    }

    /// Returns the number of bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.of_pixel) + size_of_val(&*self.areas)
    }
}

fn enlarged(
    image: &Image,
    factor: usize,
    reduced: &[u32],
    regions: &[RegionStats],
    progress: &Progress,
) -> Result<Vec<u32>, Stopped> {
    // Minimum gain for which a pixel leaves the region of its reduced pixel for a neighbour, ΔE².
    const LEAVING: f32 = 25.0;
    let width = image.width as usize;
    let (columns, rows) = reduced_size(image.width, image.height, factor);
    let mut of_pixel = vec![0u32; image.pixels.len()];
    of_pixel
        .par_chunks_exact_mut(width)
        .enumerate()
        .try_for_each(|(line, out)| {
            let y = (line / factor).min(rows - 1);
            for (at, out) in out.iter_mut().enumerate() {
                let x = (at / factor).min(columns - 1);
                let own = reduced[y * columns + x];
                let around = [
                    (x.saturating_sub(1), y),
                    ((x + 1).min(columns - 1), y),
                    (x, y.saturating_sub(1)),
                    (x, (y + 1).min(rows - 1)),
                ]
                .map(|(x, y)| reduced[y * columns + x]);
                *out = own;
                if around.iter().any(|&region| region != own) {
                    let lab = lab_of_pixel(image.pixels[line * width + at]);
                    let apart = |region: u32| squared_difference(lab, regions[region as usize].lab);
                    let mut least = apart(own) - LEAVING;
                    for region in around {
                        if apart(region) < least {
                            (*out, least) = (region, apart(region));
                        }
                    }
                }
            }
            if line % 64 == 0 {
                progress.check()
            } else {
                Ok(())
            }
        })?;
    Ok(of_pixel)
}
