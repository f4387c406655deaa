//! Initial planes of a level: random ones, those of a coarser level, and surfaces around flat
//! patches.

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::level::{PlanePrior, SearchLevel};
use super::plane::{Field, Pixel, Plane, WORST};
use super::random::Dice;

/// Planes with a lower cost count as surfaces; mere guesses cost more.
const CONFIDENT: f32 = 0.45;
/// Distance to the nearest pixel of the coarser level that shows a surrounding surface: windows
/// reach this far beyond its border.
const NEAREST: isize = 3;
/// Distance to the farthest such pixel of the coarser level.
const FARTHEST: isize = 32;
/// Number of confident pixels used in each direction.
const SEEN: usize = 3;
/// Pixels lie on a plane if they are off by at most this many pixels of the coarser level in another image.
const TOLERANCE_PX: f32 = 0.5;
/// Lines through a pixel, and how many of them must meet one surface on both sides.
const LINES: [[isize; 2]; 4] = [[1, 0], [0, 1], [1, 1], [1, -1]];
const LEAST_LINES: usize = 2;

/// Returns for each pixel of a level the plane of the surrounding surface according to a coarser level.
///
/// Patches without texture are pulled to this plane. It is a planar prior as in Q. Xu and W. Tao,
/// *Planar Prior Assisted PatchMatch Multi-View Stereo*, AAAI 2020, but through the nearest
/// confident pixels on lines instead of the corners of triangles. A surface is never continued
/// beyond its border: the plane is only known between confident pixels. A pixel without texture
/// that lies within no surface gets no depth. The result is empty if no pixel lies within a
/// surface.
pub fn priors(level: &SearchLevel<'_>, coarser: &Field) -> Vec<PlanePrior> {
    let tolerance = 2.0 * TOLERANCE_PX * level.step;
    let pixel = |at: usize, width: usize| Pixel {
        x: at % width,
        y: at / width,
    };
    let within = |at: usize| surface_around(coarser, pixel(at, coarser.width), tolerance);
    let coarse: Vec<Plane> = (0..coarser.width * coarser.height)
        .into_par_iter()
        .map(within)
        .collect();
    if coarse.iter().all(|plane| plane.inverse_depth <= 0.0) {
        return Vec::new();
    }
    let (width, height) = (level.image.width, level.image.height);
    let hint = |at: usize| {
        let fine = pixel(at, width);
        let within = coarse_pixel(fine, coarser);
        let plane = coarse[within.y * coarser.width + within.x];
        let is_known = plane.inverse_depth > 0.0;
        if is_known {
            PlanePrior {
                plane: plane.enlarged(fine, within),
                is_known,
            }
        } else {
            PlanePrior::default()
        }
    };
    (0..width * height).map(hint).collect()
}

/// Returns the plane of the surface that a pixel lies within; inverse depth 0 if it lies within none.
fn surface_around(field: &Field, pixel: Pixel, tolerance: f32) -> Plane {
    let mut lines: Vec<Line> = LINES
        .iter()
        .filter_map(|&along| Line::new(field, pixel, along))
        .collect();
    while lines.len() >= LEAST_LINES {
        let Some(plane) = fitted(&lines) else { break };
        let off: Vec<f32> = lines.iter().map(|line| line.off(plane)).collect();
        let worst =
            (0..lines.len()).fold(0, |worst, at| if off[at] > off[worst] { at } else { worst });
        if off[worst] <= tolerance {
            let (own, cost) = field.at(pixel.x, pixel.y);
            let is_own =
                cost < CONFIDENT && (own.inverse_depth - plane.inverse_depth).abs() <= tolerance;
            return if is_own { own } else { plane };
        }
        lines.remove(worst);
    }
    Plane::default()
}

/// Confident pixels on a line through a pixel, some on either side.
struct Line {
    seen: [ConfidentPixel; 2 * SEEN],
}

/// A confident pixel: its position relative to the middle one, and its inverse depth.
#[derive(Clone, Copy)]
struct ConfidentPixel {
    at: Vec2,
    inverse_depth: f32,
}

impl Line {
    fn new(field: &Field, pixel: Pixel, [dx, dy]: [isize; 2]) -> Option<Self> {
        let (to, fro) = (
            confidence(field, pixel, [dx, dy])?,
            confidence(field, pixel, [-dx, -dy])?,
        );
        Some(Self {
            seen: std::array::from_fn(|k| if k < SEEN { to[k] } else { fro[k - SEEN] }),
        })
    }

    /// Returns the maximum distance of the pixels from a plane.
    fn off(&self, plane: Plane) -> f32 {
        let off = |seen: &ConfidentPixel| {
            (plane.moved(seen.at.x, seen.at.y).inverse_depth - seen.inverse_depth).abs()
        };
        self.seen.iter().map(off).fold(0.0, f32::max)
    }
}

/// Returns the nearest confident pixels in a direction.
fn confidence(field: &Field, pixel: Pixel, [dx, dy]: [isize; 2]) -> Option<[ConfidentPixel; SEEN]> {
    let mut seen = [ConfidentPixel {
        at: Vec2::ZERO,
        inverse_depth: 0.0,
    }; SEEN];
    let mut count = 0;
    for steps in NEAREST..=FARTHEST {
        let column = pixel
            .x
            .checked_add_signed(dx * steps)
            .filter(|&column| column < field.width)?;
        let row = pixel
            .y
            .checked_add_signed(dy * steps)
            .filter(|&row| row < field.height)?;
        let (plane, cost) = field.at(column, row);
        if cost < CONFIDENT {
            let at = Vec2::new((dx * steps) as f32, (dy * steps) as f32);
            seen[count] = ConfidentPixel {
                at,
                inverse_depth: plane.inverse_depth,
            };
            count += 1;
        }
        if count == SEEN {
            return Some(seen);
        }
    }
    None
}

/// Fits a plane to the pixels of some lines; those of a short line have more weight.
fn fitted(lines: &[Line]) -> Option<Plane> {
    let (mut matrix, mut right) = (Mat3::ZERO, Vec3::ZERO);
    for seen in lines.iter().flat_map(|line| &line.seen) {
        let (row, weight) = (seen.at.extend(1.0), 1.0 / seen.at.length());
        matrix += Mat3::from_cols(row * row.x, row * row.y, row) * weight;
        right += row * seen.inverse_depth * weight;
    }
    let solved = matrix.inverse() * right;
    solved.is_finite().then_some(Plane {
        inverse_depth: solved.z,
        slope: [solved.x, solved.y],
    })
}

/// Creates planes with random depths, uniform in inverse depth over the range, and those of the seeds.
pub fn random_field(
    level: &SearchLevel<'_>,
    seeds: &[(usize, usize, f32)],
    number: usize,
) -> Field {
    let (width, height) = (level.image.width, level.image.height);
    let [low, high] = level.range;
    let mut field = Field::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let mut dice = Dice::new(level.options.seed, u32::MAX, (y * width + x) as u32);
            let inverse_depth = low + (high - low) * dice.unit();
            let slope = level
                .raster
                .focal
                .map(|focal| 0.5 * dice.signed() * inverse_depth / focal);
            field.set(
                x,
                y,
                Plane {
                    inverse_depth,
                    slope,
                },
                WORST,
            );
        }
    }
    for &(x, y, depth) in seeds {
        let (x, y) = (x >> number, y >> number);
        if x < width && y < height {
            field.set(
                x,
                y,
                Plane {
                    inverse_depth: 1.0 / depth,
                    slope: [0.0; 2],
                },
                WORST,
            );
        }
    }
    field
}

/// Returns the coarse pixel that contains a fine one.
fn coarse_pixel(fine: Pixel, coarser: &Field) -> Pixel {
    Pixel {
        x: (fine.x / 2).min(coarser.width - 1),
        y: (fine.y / 2).min(coarser.height - 1),
    }
}

/// Copies the planes of a coarser field to the four fine pixels of each.
pub fn finer_field(level: &SearchLevel<'_>, coarser: &Field) -> Field {
    let (width, height) = (level.image.width, level.image.height);
    let mut field = Field::new(width, height);
    for y in 0..height {
        for x in 0..width {
            let fine = Pixel { x, y };
            let coarse = coarse_pixel(fine, coarser);
            let (plane, _) = coarser.at(coarse.x, coarse.y);
            field.set(x, y, plane.enlarged(fine, coarse), WORST);
        }
    }
    field
}
