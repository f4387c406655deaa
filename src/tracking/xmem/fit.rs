use rayon::prelude::*;

use crate::networks::half_pixel_samples;
use ostra_core::image::ImageSize;
use ostra_frames::Image;
use ostra_masks::onnx::resized_planes;
use ostra_masks::{LabelId, LabelMask};

/// Side of a cell in pixels.
const CELL: usize = 16;
/// Mean and standard deviation of red, green and blue in the networks' training.
const MEAN: [f32; 3] = [123.675, 116.28, 103.53];
const DEVIATION: [f32; 3] = [58.395, 57.12, 57.375];

/// Maximum longer side of the network input in pixels; very narrow images are reduced.
const LONGEST: usize = 4096;

/// Placement of an image in the network input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fit {
    pub image: ImageSize,
    /// Size that the image is resized to.
    shown: ImageSize,
    /// Size with a border up to whole cells.
    pub padded: ImageSize,
    /// Column and row of the image's upper left corner.
    corner: (usize, usize),
}

impl Fit {
    /// Fits an image so that its shorter side has `short_side` pixels; `None` keeps its size.
    pub fn new(width: u32, height: u32, short_side: Option<u32>) -> Self {
        let image = ImageSize::new(width as usize, height as usize);
        let short = image.width.min(image.height).max(1);
        let side = short_side.map_or(short, |side| side as usize);
        let side = side
            .min(LONGEST * short / image.width.max(image.height).max(1))
            .max(1);
        let shown = ImageSize::new(side * image.width / short, side * image.height / short);
        let padded = ImageSize::new(
            shown.width.next_multiple_of(CELL),
            shown.height.next_multiple_of(CELL),
        );
        Self {
            image,
            shown,
            padded,
            corner: (
                (padded.width - shown.width) / 2,
                (padded.height - shown.height) / 2,
            ),
        }
    }

    /// Returns the numbers of cells along the width and the height.
    pub fn cells(&self) -> ImageSize {
        ImageSize::new(self.padded.width / CELL, self.padded.height / CELL)
    }

    /// Returns the number of pixels of the network input.
    pub fn area(&self) -> usize {
        self.padded.area()
    }

    /// Returns the image as the key encoder's input, `[3, rows, columns]`.
    pub fn planes(&self, image: &Image) -> Vec<f32> {
        let small = resized_planes(&image.pixels, self.image, self.shown);
        let mut planes = vec![0.0; 3 * self.area()];
        let both = planes
            .chunks_exact_mut(self.area())
            .zip(small.chunks_exact(self.shown.area()));
        for (channel, (plane, small)) in both.enumerate() {
            for (out, row) in self.rows(plane).zip(small.chunks_exact(self.shown.width)) {
                out.iter_mut()
                    .zip(row)
                    .for_each(|(out, v)| *out = (v - MEAN[channel]) / DEVIATION[channel]);
            }
        }
        planes
    }

    /// Returns a 0/1 map per label, `[labels][rows][columns]`.
    ///
    /// Each pixel takes the label at its upper left, as in the official code. A label that would
    /// get no pixel keeps the one that contains its first pixel.
    pub fn one_hot(&self, mask: &LabelMask, labels: &[LabelId]) -> Vec<f32> {
        let mut maps = vec![0.0; labels.len() * self.area()];
        let from = |at: usize, shown: usize, image: usize| at * image / shown;
        for (map, &label) in maps.chunks_exact_mut(self.area()).zip(labels) {
            for (y, out) in self.rows(map).enumerate() {
                let row = &mask.ids
                    [from(y, self.shown.height, self.image.height) * self.image.width..]
                    [..self.image.width];
                let is_there = |x: usize| row[from(x, self.shown.width, self.image.width)] == label;
                out.iter_mut()
                    .enumerate()
                    .for_each(|(x, out)| *out = f32::from(u8::from(is_there(x))));
            }
            let is_lost = !map.contains(&1.0);
            if let Some(first) = mask
                .ids
                .iter()
                .position(|&id| id == label)
                .filter(|_| is_lost)
            {
                let (x, y) = (first % self.image.width, first / self.image.width);
                let at = (
                    x * self.shown.width / self.image.width,
                    y * self.shown.height / self.image.height,
                );
                map[(self.corner.1 + at.1) * self.padded.width + self.corner.0 + at.0] = 1.0;
            }
        }
        maps
    }

    /// Resizes maps `[any][rows][columns]` to the image size by linear interpolation.
    pub fn enlarged(&self, maps: &[f32]) -> Vec<f32> {
        let (columns, rows) = (
            half_pixel_samples(self.shown.width, self.image.width),
            half_pixel_samples(self.shown.height, self.image.height),
        );
        let mut out = vec![0.0; maps.len() / self.area() * self.image.width * self.image.height];
        out.par_chunks_mut(self.image.width)
            .enumerate()
            .for_each(|(line, out)| {
                let map = &maps[line / self.image.height * self.area()..][..self.area()];
                let sample = rows[line % self.image.height];
                let row = |at: usize| {
                    &map[(self.corner.1 + at) * self.padded.width + self.corner.0..]
                        [..self.shown.width]
                };
                let (first, second) = (row(sample.first), row(sample.next));
                for (out, column) in out.iter_mut().zip(&columns) {
                    let across = |row: &[f32]| {
                        row[column.first] + column.weight * (row[column.next] - row[column.first])
                    };
                    *out = across(first) + sample.weight * (across(second) - across(first));
                }
            });
        out
    }

    /// Returns the rows of a map that belong to the image.
    fn rows<'a>(&self, map: &'a mut [f32]) -> impl Iterator<Item = &'a mut [f32]> + use<'a> {
        let (corner, shown) = (self.corner, self.shown);
        let rows = map
            .chunks_exact_mut(self.padded.width)
            .skip(corner.1)
            .take(shown.height);
        rows.map(move |row| &mut row[corner.0..][..shown.width])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_match_the_official_code() {
        let fit = Fit::new(960, 540, Some(480));
        assert_eq!(
            (fit.shown, fit.padded, fit.corner),
            (ImageSize::new(853, 480), ImageSize::new(864, 480), (5, 0))
        );
        let fit = Fit::new(300, 401, None);
        assert_eq!(
            (fit.shown, fit.padded, fit.corner),
            (ImageSize::new(300, 401), ImageSize::new(304, 416), (2, 7))
        );
        assert_eq!(Fit::new(90, 60, Some(72)).cells(), ImageSize::new(7, 5));
    }

    #[test]
    fn label_smaller_than_a_pixel_is_kept() {
        let mut mask = LabelMask::empty(100, 100);
        (mask.ids[33 * 100 + 57], mask.ids[0]) = (LabelId(3), LabelId(4));
        let fit = Fit::new(100, 100, Some(32));
        let maps = fit.one_hot(&mask, &[LabelId(3), LabelId(4), LabelId(5)]);
        let there: Vec<Vec<usize>> = maps
            .chunks(32 * 32)
            .map(|map| (0..1024).filter(|&at| map[at] > 0.0).collect())
            .collect();
        assert_eq!(there, [vec![10 * 32 + 18], vec![0], vec![]]);
    }

    #[test]
    fn enlarged_ramp_has_no_shift_and_no_border() {
        // A ramp stays a ramp: no half-pixel shift, no border.
        let fit = Fit::new(90, 60, Some(30));
        let mut map = vec![99.0; fit.area()];
        for (y, row) in fit.rows(&mut map).enumerate() {
            row.iter_mut()
                .enumerate()
                .for_each(|(x, value)| *value = 2.0 * (x as f32 + 0.5) + 4.0 * (y as f32 + 0.5));
        }
        let found = fit.enlarged(&map);
        for (x, y) in [(1, 1), (44, 30), (88, 58)] {
            let expected = (f64::from(x) + 0.5) + 2.0 * (f64::from(y) + 0.5);
            assert!(
                (f64::from(found[(y * 90 + x) as usize]) - expected).abs() < 1e-4,
                "{x} {y}"
            );
        }
    }
}
