use glam::Vec2;

use super::picture::Picture;
use super::plane::Plane;

/// Numbers that describe a cell: Lab, odds of its colour, strength of edges in six directions.
pub(super) const FEATURES: usize = 10;
/// Which of them is the odds of the colour, −3 to 3.
pub(super) const ODDS: usize = 3;
const DIRECTIONS: usize = 6;

/// A picture in cells, each described by a few numbers.
pub(super) struct Cells {
    pub columns: usize,
    pub rows: usize,
    /// Side of a cell, in pixels.
    pub side: usize,
    pub features: Vec<[f32; FEATURES]>,
}

impl Cells {
    /// `odds` per colour bin.
    pub fn new(picture: &Picture, odds: &[f32], side: usize) -> Self {
        let (columns, rows) = (picture.width / side, picture.height / side);
        let mut features = vec![[0.0; FEATURES]; columns * rows];
        for y in 0..rows * side {
            for x in 0..columns * side {
                let cell = &mut features[y / side * columns + x / side];
                add_pixel(cell, picture, odds, x, y);
            }
        }
        let pixels = (side * side) as f32;
        for cell in &mut features {
            cell.iter_mut().for_each(|value| *value /= pixels);
            let strength = cell[ODDS + 1..].iter().map(|value| value * value).sum::<f32>().sqrt();
            cell[ODDS + 1..].iter_mut().for_each(|value| *value /= strength + 2.0);
        }
        Self { columns, rows, side, features }
    }

    /// Where a pixel lies among the cells' centres.
    pub fn of_pixel(&self, at: Vec2) -> Vec2 {
        (at + 0.5) / self.side as f32 - 0.5
    }

    /// The pixel at a place among the cells' centres.
    pub fn to_pixel(&self, cell: Vec2) -> Vec2 {
        (cell + 0.5) * self.side as f32 - 0.5
    }

    /// The features at a whole cell; beyond the border those of the nearest.
    pub fn at(&self, x: isize, y: isize) -> &[f32; FEATURES] {
        let x = x.clamp(0, self.columns as isize - 1) as usize;
        let y = y.clamp(0, self.rows as isize - 1) as usize;
        &self.features[y * self.columns + x]
    }

    /// Means of a plane over the cells.
    pub fn means(&self, plane: &Plane) -> Plane {
        let mut means = Plane::new(self.columns, self.rows);
        for y in 0..self.rows * self.side {
            for x in 0..self.columns * self.side {
                means.values[y / self.side * self.columns + x / self.side] += plane.values[y * plane.width + x];
            }
        }
        means.values.iter_mut().for_each(|value| *value /= (self.side * self.side) as f32);
        means
    }
}

fn add_pixel(cell: &mut [f32; FEATURES], picture: &Picture, odds: &[f32], x: usize, y: usize) {
    let (width, height) = (picture.width, picture.height);
    let at = y * width + x;
    let lab = picture.lab[at];
    for (value, (lab, unit)) in cell.iter_mut().zip(lab.iter().zip([25.0, 12.0, 12.0])) {
        *value += lab / unit;
    }
    cell[ODDS] += odds[usize::from(picture.bins[at])];
    let light = |x: usize, y: usize| picture.lab[y * width + x][0];
    let slope = Vec2::new(
        light((x + 1).min(width - 1), y) - light(x.saturating_sub(1), y),
        light(x, (y + 1).min(height - 1)) - light(x, y.saturating_sub(1)),
    );
    let strength = slope.length();
    if strength > 0.0 {
        // Opposite slopes are one direction.
        let turn = slope.y.atan2(slope.x).rem_euclid(std::f32::consts::PI) / std::f32::consts::PI;
        let direction = turn * DIRECTIONS as f32;
        let (low, share) = (direction as usize, direction.fract());
        cell[ODDS + 1 + low % DIRECTIONS] += strength * (1.0 - share);
        cell[ODDS + 1 + (low + 1) % DIRECTIONS] += strength * share;
    }
}
