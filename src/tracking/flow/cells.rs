use glam::Vec2;

use super::plane::Plane;
use super::tracked_image::TrackedImage;

/// Features per cell: Lab, colour odds, and edge strength in six directions.
pub(super) const FEATURES: usize = 10;
/// Index of the colour odds, −3 to 3.
pub(super) const ODDS: usize = 3;
const DIRECTIONS: usize = 6;

/// A region of an image divided into cells with features.
pub(super) struct FeatureCells {
    pub columns: usize,
    pub rows: usize,
    /// Side of a cell in pixels.
    pub side: usize,
    /// First and last column and row of the cells that have features.
    first: [usize; 2],
    last: [usize; 2],
    features: Vec<[f32; FEATURES]>,
}

impl FeatureCells {
    /// Computes the cells at most `reach_px` from `centre` in each direction.
    ///
    /// `odds` has one value per colour bin.
    pub fn new(
        image: &TrackedImage,
        odds: &[f32],
        side: usize,
        centre: Vec2,
        reach_px: f32,
    ) -> Self {
        let (columns, rows) = (
            image.width.div_ceil(side).max(1),
            image.height.div_ceil(side).max(1),
        );
        let cell =
            |at: f32, count: usize| (at / side as f32).clamp(0.0, count as f32 - 1.0) as usize;
        let first = [
            cell(centre.x - reach_px, columns),
            cell(centre.y - reach_px, rows),
        ];
        let last = [
            cell(centre.x + reach_px, columns),
            cell(centre.y + reach_px, rows),
        ];
        let mut features = vec![[0.0; FEATURES]; columns * rows];
        for row in first[1]..=last[1] {
            for column in first[0]..=last[0] {
                features[row * columns + column] = described(image, odds, side, column, row);
            }
        }
        Self {
            columns,
            rows,
            side,
            first,
            last,
            features,
        }
    }

    /// Converts a pixel position to cell coordinates; cell centres are integers.
    pub fn of_pixel(&self, at: Vec2) -> Vec2 {
        (at + 0.5) / self.side as f32 - 0.5
    }

    /// Converts cell coordinates to a pixel position.
    pub fn to_pixel(&self, cell: Vec2) -> Vec2 {
        (cell + 0.5) * self.side as f32 - 0.5
    }

    /// Returns the features of a cell; outside the computed region, those of the nearest cell.
    pub fn at(&self, x: isize, y: isize) -> &[f32; FEATURES] {
        let x = x.clamp(self.first[0] as isize, self.last[0] as isize) as usize;
        let y = y.clamp(self.first[1] as isize, self.last[1] as isize) as usize;
        &self.features[y * self.columns + x]
    }

    /// Returns the means of a plane over the cells.
    pub fn means(&self, plane: &Plane) -> Plane {
        let mut means = Plane::new(self.columns, self.rows);
        let mut counts = vec![0.0f32; means.values.len()];
        for (at, value) in plane.values.iter().enumerate() {
            let cell = at / plane.width / self.side * self.columns + at % plane.width / self.side;
            means.values[cell] += value;
            counts[cell] += 1.0;
        }
        means
            .values
            .iter_mut()
            .zip(counts)
            .for_each(|(value, count)| *value /= count);
        means
    }
}

/// Computes the features of a cell; cells at the right and lower border may be smaller.
fn described(
    image: &TrackedImage,
    odds: &[f32],
    side: usize,
    column: usize,
    row: usize,
) -> [f32; FEATURES] {
    let mut cell = [0.0; FEATURES];
    let (left, top) = (column * side, row * side);
    let (right, bottom) = (
        (left + side).min(image.width),
        (top + side).min(image.height),
    );
    for y in top..bottom {
        for x in left..right {
            add_pixel(&mut cell, image, odds, x, y);
        }
    }
    let pixels = ((right - left) * (bottom - top)) as f32;
    cell.iter_mut().for_each(|value| *value /= pixels);
    let edges = &mut cell[ODDS + 1..];
    let strength = edges.iter().map(|value| value * value).sum::<f32>().sqrt();
    edges.iter_mut().for_each(|value| *value /= strength + 2.0);
    cell
}

fn add_pixel(cell: &mut [f32; FEATURES], image: &TrackedImage, odds: &[f32], x: usize, y: usize) {
    let (width, height) = (image.width, image.height);
    let at = y * width + x;
    let lab = image.lab[at];
    for (value, (lab, unit)) in cell.iter_mut().zip(lab.iter().zip([25.0, 12.0, 12.0])) {
        *value += lab / unit;
    }
    cell[ODDS] += odds[usize::from(image.bins[at])];
    let light = |x: usize, y: usize| image.lab[y * width + x][0];
    let slope = Vec2::new(
        light((x + 1).min(width - 1), y) - light(x.saturating_sub(1), y),
        light(x, (y + 1).min(height - 1)) - light(x, y.saturating_sub(1)),
    );
    let strength = slope.length();
    if strength > 0.0 {
        // Opposite gradients have the same direction.
        let turn = slope.y.atan2(slope.x).rem_euclid(std::f32::consts::PI) / std::f32::consts::PI;
        let direction = turn * DIRECTIONS as f32;
        let (low, share) = (direction as usize, direction.fract());
        cell[ODDS + 1 + low % DIRECTIONS] += strength * (1.0 - share);
        cell[ODDS + 1 + (low + 1) % DIRECTIONS] += strength * share;
    }
}
