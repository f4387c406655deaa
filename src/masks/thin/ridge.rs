use glam::{DVec2, IVec2, Vec2, Vec3, Vec3A};
use rayon::prelude::*;
use wide::i32x4;

use crate::lab::lab_of_pixel;
use ostra_frames::Image;

/// Steps per Lab unit in the sums.
///
/// Integers make a box's mean independent of the pixels before it.
const STEPS: f32 = 64.0;

/// A part of an image in CIE Lab with box means that cost the same for every size.
///
/// Crow, "Summed-area tables for texture mapping", SIGGRAPH 1984.
pub(super) struct Crop {
    /// Column and row of its top-left pixel in the image.
    pub origin: [usize; 2],
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Sums over all pixels above and left, with one row and column more than the crop.
    ///
    /// Sums may wrap around. The fourth number is 0: four are added as fast as one.
    sums: Vec<i32x4>,
}

impl Crop {
    /// Cuts the pixels of `image` from column and row `from` up to `to` (exclusive).
    pub fn cut(image: &Image, from: [usize; 2], to: [usize; 2]) -> Self {
        let [width, height] = [to[0] - from[0], to[1] - from[1]];
        let across = width + 1;
        let mut sums = vec![i32x4::ZERO; across * (height + 1)];
        sums.par_chunks_exact_mut(across)
            .skip(1)
            .enumerate()
            .for_each(|(row, sums)| {
                let start = (from[1] + row) * image.width as usize + from[0];
                let mut sum = i32x4::ZERO;
                for (at, &pixel) in image.pixels[start..start + width].iter().enumerate() {
                    let [l, a, b] = lab_of_pixel(pixel).map(|value| (value * STEPS).round() as i32);
                    sum += i32x4::new([l, a, b, 0]);
                    sums[at + 1] = sum;
                }
            });
        for at in across..sums.len() {
            sums[at] = sums[at] + sums[at - across];
        }
        Self {
            origin: from,
            width,
            height,
            sums,
        }
    }

    /// Returns the mean colour of the `(2 · radius + 1)²` pixels around a pixel.
    ///
    /// The box is clipped to the crop; a centre outside is moved to the nearest pixel inside.
    pub fn mean(&self, x: isize, y: isize, radius: isize) -> Vec3A {
        let (left, right) = within(x, radius, self.width);
        let (top, bottom) = within(y, radius, self.height);
        let (above, below) = (top * (self.width + 1), bottom * (self.width + 1));
        let sum = self.sums[below + right] - self.sums[below + left] - self.sums[above + right]
            + self.sums[above + left];
        let [l, a, b, _] = sum.to_array();
        Vec3A::new(l as f32, a as f32, b as f32)
            / (((right - left) * (bottom - top)) as f32 * STEPS)
    }
}

/// Returns the bilinearly interpolated CIE Lab colour at a position of the image.
///
/// Positions beyond the border have the border's colour.
pub(super) fn color_at(image: &Image, at_px: DVec2) -> Vec3 {
    let [right, bottom] = [f64::from(image.width - 1), f64::from(image.height - 1)];
    let (x, y) = (
        (at_px.x - 0.5).clamp(0.0, right),
        (at_px.y - 0.5).clamp(0.0, bottom),
    );
    let (column, row) = (x as u32, y as u32);
    let (next_column, next_row) = (
        (column + 1).min(image.width - 1),
        (row + 1).min(image.height - 1),
    );
    let lab = |x: u32, y: u32| Vec3::from_array(lab_of_pixel(image.at(x, y)));
    let (across, down) = ((x - f64::from(column)) as f32, (y - f64::from(row)) as f32);
    let upper = lab(column, row).lerp(lab(next_column, row), across);
    upper.lerp(
        lab(column, next_row).lerp(lab(next_column, next_row), across),
        down,
    )
}

/// Returns the range of indices at most `radius` from `middle` in `0..count`.
fn within(middle: isize, radius: isize, count: usize) -> (usize, usize) {
    let middle = middle.clamp(0, count as isize - 1);
    (
        (middle - radius).max(0) as usize,
        ((middle + radius + 1) as usize).min(count),
    )
}

/// Half widths of the lines that are searched, pixels.
const HALF_WIDTHS_PX: [f32; 6] = [0.6, 1.0, 1.7, 2.9, 5.0, 8.5];

/// Number of directions across a line, over half a turn.
///
/// The samples are far enough out to cover directions in between.
const DIRECTIONS: usize = 4;

/// Share of its contrast that a line keeps if its two sides differ from it in opposite directions.
///
/// Such a line may be a ramp of shading.
const STAIR_SHARE: f32 = 0.3;

/// Ridge strength and width at a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ridge {
    /// Colour difference (ΔE) to both sides, the smaller of the two.
    pub contrast: f32,
    /// Half the width of the line, pixels; one of [`HALF_WIDTHS_PX`].
    pub half_width_px: f32,
}

/// Ridge filter: compares the colour at a pixel with the colours on both sides.
pub(super) struct RidgeFilter {
    widths: Vec<Probe>,
}

struct Probe {
    half_width_px: f32,
    radius: isize,
    sides: Vec<IVec2>,
}

impl RidgeFilter {
    /// Creates the filter with its sample positions.
    pub fn new() -> Self {
        let probe = |&half_width_px: &f32| {
            let radius = (half_width_px * 0.7) as isize;
            let away = half_width_px + 1.0 + radius as f32;
            let turn =
                |k: usize| Vec2::from_angle(std::f32::consts::PI * k as f32 / DIRECTIONS as f32);
            let sides = (0..DIRECTIONS)
                .map(|k| (turn(k) * away).round().as_ivec2())
                .collect();
            Probe {
                half_width_px,
                radius,
                sides,
            }
        };
        Self {
            widths: HALF_WIDTHS_PX.iter().map(probe).collect(),
        }
    }

    /// Returns the strongest line through a pixel over all widths and directions.
    ///
    /// The weaker side counts, so that the border of a large object is not a line. Any difference
    /// of colour counts, so that a line may be brighter, darker or only of another hue. After
    /// Koller, Gerig, Székely and Dettwiler, "Multiscale detection of curvilinear structures in 2-D
    /// and 3-D image data", ICCV 1995, extended to colours.
    pub fn at(&self, crop: &Crop, x: isize, y: isize) -> Ridge {
        let mut best = Ridge::default();
        for probe in &self.widths {
            let middle = crop.mean(x, y, probe.radius);
            let side =
                |by: IVec2| middle - crop.mean(x + by.x as isize, y + by.y as isize, probe.radius);
            let strongest = probe
                .sides
                .iter()
                .map(|&by| contrast(side(by), side(-by)))
                .fold(0.0, f32::max);
            // Of widths with nearly equal responses, the narrowest is taken.
            if strongest > best.contrast * 1.1 {
                best = Ridge {
                    contrast: strongest,
                    half_width_px: probe.half_width_px,
                };
            }
        }
        best
    }
}

fn contrast(left: Vec3A, right: Vec3A) -> f32 {
    let least = left.length_squared().min(right.length_squared()).sqrt();
    if left.dot(right) < 0.0 {
        least * STAIR_SHARE
    } else {
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_means_equal_direct_sums() {
        let pixels = (0..30 * 20_usize)
            .map(|at| [at * 7 % 251, at * 3 % 241, at % 5 * 40].map(|v| v as u8))
            .collect();
        let image = Image {
            width: 30,
            height: 20,
            pixels,
        };
        let crop = Crop::cut(&image, [4, 3], [25, 19]);
        for (x, y, radius) in [(0, 0, 0), (3, 5, 2), (20, 15, 4), (-7, 8, 1)] {
            let near = |at: isize, middle: isize, count: isize| {
                (at - middle.clamp(0, count - 1)).abs() <= radius
            };
            let all = (0..16_isize).flat_map(|v| (0..21_isize).map(move |u| (u, v)));
            let inside: Vec<Vec3A> = all
                .filter(|&(u, v)| near(u, x, 21) && near(v, y, 16))
                .map(|(u, v)| Vec3A::from_array(lab_of_pixel(image.at(u as u32 + 4, v as u32 + 3))))
                .collect();
            let mean = inside.iter().sum::<Vec3A>() / inside.len() as f32;
            assert!(
                mean.distance(crop.mean(x, y, radius)) < 0.05,
                "{x}, {y}, {radius}"
            );
        }
    }
}
