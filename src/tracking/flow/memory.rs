use std::fmt::Debug;
use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;
use wide::f32x8;

use super::plane::Plane;
use crate::propagate::shown_labels;
use ostra_core::image::ImageSize;
use ostra_masks::{LabelId, LabelMask, MaskError};

/// Computes features of an image cell by cell.
///
/// Features of the same part of an object must be similar in every image. A network only computes
/// the features; the tracker compares them and derives masks. Any network of dense features is
/// suitable.
pub trait DenseFeatures: Debug + Send + Sync {
    /// Returns the features of the cells.
    ///
    /// `grey` has values 0–1, row by row; `size` is that of the image.
    ///
    /// # Errors
    /// [`MaskError::Network`] if the network fails.
    fn feature_map(&self, grey: &[f32], size: ImageSize) -> Result<FeatureMap, MaskError>;
}

/// Features of the cells of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct FeatureMap {
    /// Number of cells along the image width.
    pub columns: usize,
    /// Number of cells along the image height.
    pub rows: usize,
    /// Side of a cell in pixels; cells at the right and lower border may extend beyond it.
    pub cell_px: usize,
    /// Unit vector of [`Self::DIM`] values per cell, row by row.
    pub values: Vec<[f32x8; 8]>,
}

impl FeatureMap {
    /// Values per cell.
    pub const DIM: usize = 64;

    /// Creates a map from planes of shape `[DIM, rows, columns]`.
    ///
    /// `plane_size` is that of a plane, whose first columns and rows cover the image of `size`.
    #[must_use]
    pub fn of_planes(
        planes: &[f32],
        plane_size: ImageSize,
        size: ImageSize,
        cell_px: usize,
    ) -> Self {
        let (columns, rows) = (size.width.div_ceil(cell_px), size.height.div_ceil(cell_px));
        let cells = plane_size.area();
        let values = (0..columns * rows).map(|cell| {
            let at = cell / columns * plane_size.width + cell % columns;
            let values: [f32; Self::DIM] =
                std::array::from_fn(|channel| planes[channel * cells + at]);
            let length = values
                .iter()
                .map(|value| value * value)
                .sum::<f32>()
                .sqrt()
                .max(f32::MIN_POSITIVE);
            std::array::from_fn(|part| {
                f32x8::from(std::array::from_fn(|k| values[part * 8 + k] / length))
            })
        });
        Self {
            columns,
            rows,
            cell_px,
            values: values.collect(),
        }
    }

    /// Interpolates values per cell at a pixel.
    fn sample(&self, cells: &Plane, at: Vec2) -> f32 {
        cells.sample((at + 0.5) / self.cell_px as f32 - 0.5)
    }
}

/// Number of most similar keyframe cells used per cell.
const RECALLED: usize = 16;
/// Difference in cosine similarity that changes a cell's weight by a factor of e.
const TEMPERATURE: f32 = 0.05;
/// Best similarity below which the memory is ignored, and from which it counts in full.
const STRANGE: f32 = 0.75;
const KNOWN: f32 = 0.95;

/// Features and labels of the keyframes' cells.
///
/// This is a space-time memory with given features (after Oh, Lee, Xu, Kim, "Video Object
/// Segmentation using Space-Time Memory Networks", ICCV 2019).
#[derive(Debug, Clone, Default)]
pub(super) struct FeatureMemory {
    keys: Vec<[f32x8; 8]>,
    /// Share of each key's pixels that have the label, per label.
    shares: Vec<(LabelId, Vec<f32>)>,
}

/// Label odds of an image's cells, from the memory.
pub(super) struct Recalled {
    feature_map: Arc<FeatureMap>,
    /// Log-odds per label and cell; 0 = nothing known.
    odds: Vec<(LabelId, Plane)>,
}

impl FeatureMemory {
    /// Adds the cells of an image with its mask.
    pub fn learn(&mut self, feature_map: &FeatureMap, mask: &LabelMask) {
        let known = self.keys.len();
        self.keys.extend_from_slice(&feature_map.values);
        for id in shown_labels(mask) {
            if !self.shares.iter().any(|(of, _)| *of == id) {
                self.shares.push((id, vec![0.0; known]));
            }
        }
        for (id, shares) in &mut self.shares {
            shares.extend(shares_of(feature_map, mask, *id));
        }
    }

    /// Returns the label odds of the cells of an image.
    pub fn recall(&self, feature_map: &Arc<FeatureMap>) -> Recalled {
        let (columns, rows) = (feature_map.columns, feature_map.rows);
        let recalled: Vec<Vec<f32>> = feature_map
            .values
            .par_iter()
            .map(|cell| self.odds_of(cell))
            .collect();
        let plane = |place: usize| Plane {
            width: columns,
            height: rows,
            values: recalled.iter().map(|odds| odds[place]).collect(),
        };
        let odds = self
            .shares
            .iter()
            .enumerate()
            .map(|(place, (id, _))| (*id, plane(place)))
            .collect();
        Recalled {
            feature_map: Arc::clone(feature_map),
            odds,
        }
    }

    /// Returns the log-odds of each label in a cell.
    fn odds_of(&self, cell: &[f32x8; 8]) -> Vec<f32> {
        let best = most_alike(&self.keys, cell);
        let top = best.first().map_or(0.0, |(likeness, _)| *likeness);
        let known = ((top - STRANGE) / (KNOWN - STRANGE)).clamp(0.0, 1.0);
        let weight = |likeness: f32| ((likeness - top) / TEMPERATURE).exp();
        let sum: f32 = best.iter().map(|(likeness, _)| weight(*likeness)).sum();
        let share = |shares: &[f32]| {
            best.iter()
                .map(|&(likeness, key)| weight(likeness) * shares[key])
                .sum::<f32>()
                / sum.max(f32::MIN_POSITIVE)
        };
        self.shares
            .iter()
            .map(|(_, shares)| share(shares))
            .map(|share| known * ((share + 0.05) / (1.05 - share)).ln())
            .collect()
    }
}

impl Recalled {
    /// Returns the log-odds of a label at a pixel; 0 where nothing is known.
    pub fn odds(&self, label: LabelId) -> impl Fn(Vec2) -> f32 {
        let plane = self
            .odds
            .iter()
            .find(|(id, _)| *id == label)
            .map(|(_, plane)| plane);
        move |at| plane.map_or(0.0, |plane| self.feature_map.sample(plane, at))
    }
}

/// Returns the keys most similar to a cell and their similarities, best first.
///
/// Of equal keys, the earlier one comes first.
fn most_alike(keys: &[[f32x8; 8]], cell: &[f32x8; 8]) -> Vec<(f32, usize)> {
    let mut best: Vec<(f32, usize)> = Vec::with_capacity(RECALLED + 1);
    for (place, key) in keys.iter().enumerate() {
        let likeness = key
            .iter()
            .zip(cell)
            .fold(f32x8::ZERO, |sum, (&a, &b)| a.mul_add(b, sum))
            .reduce_add();
        if best.len() < RECALLED || likeness > best[RECALLED - 1].0 {
            let at = best.partition_point(|(other, _)| *other >= likeness);
            best.insert(at, (likeness, place));
            best.truncate(RECALLED);
        }
    }
    best
}

/// Returns the share of each cell's pixels that have a label.
fn shares_of(feature_map: &FeatureMap, mask: &LabelMask, id: LabelId) -> Vec<f32> {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let side = feature_map.cell_px;
    let share = |cell: usize| {
        let (left, top) = (
            cell % feature_map.columns * side,
            cell / feature_map.columns * side,
        );
        let (right, bottom) = ((left + side).min(width), (top + side).min(height));
        let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| y * width + x));
        let inside = pixels.filter(|&at| mask.ids[at] == id).count();
        inside as f32 / ((right - left) * (bottom - top)).max(1) as f32
    };
    (0..feature_map.values.len()).map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two rows of four cells; only cells of the same number are similar.
    fn described(numbers: [usize; 8]) -> Arc<FeatureMap> {
        let mut planes = vec![0.0; FeatureMap::DIM * 8];
        numbers
            .iter()
            .enumerate()
            .for_each(|(cell, number)| planes[number * 8 + cell] = 3.0);
        Arc::new(FeatureMap::of_planes(
            &planes,
            ImageSize::new(4, 2),
            ImageSize::new(31, 16),
            8,
        ))
    }

    #[test]
    fn moved_object_cells_are_recognized_and_unknown_cells_have_no_odds() {
        let mut mask = LabelMask::empty(31, 16);
        (0..8)
            .flat_map(|y| (0..8).map(move |x| (x, y)))
            .for_each(|(x, y)| mask.ids[y * 31 + x] = LabelId(7));
        let mut memory = FeatureMemory::default();
        memory.learn(&described([1, 2, 2, 2, 3, 3, 4, 4]), &mask);
        let recalled = memory.recall(&described([2, 2, 2, 1, 3, 3, 9, 4]));
        let odds = recalled.odds(LabelId(7));
        assert!(odds(Vec2::new(27.0, 3.0)) > 1.0 && odds(Vec2::new(3.0, 3.0)) < -1.0);
        assert!(
            odds(Vec2::new(19.0, 12.0)).abs() < 0.2,
            "nothing like it was seen"
        );
        assert_eq!(
            recalled.odds(LabelId(8))(Vec2::ZERO),
            0.0,
            "no keyframe shows this label"
        );
    }

    #[test]
    fn label_of_a_second_keyframe_is_added_to_the_memory() {
        let mut memory = FeatureMemory::default();
        memory.learn(&described([1; 8]), &LabelMask::empty(31, 16));
        let mut mask = LabelMask::empty(31, 16);
        mask.ids.fill(LabelId(2));
        memory.learn(&described([2; 8]), &mask);
        let recalled = memory.recall(&described([1, 2, 1, 2, 1, 2, 1, 2]));
        let odds = recalled.odds(LabelId(2));
        assert!(odds(Vec2::new(3.5, 3.5)) < -2.0 && odds(Vec2::new(11.5, 3.5)) > 2.0);
    }
}
