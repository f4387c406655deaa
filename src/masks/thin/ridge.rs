use glam::{IVec2, Vec2, Vec3A};

use super::crop::Crop;

/// Half widths of the lines looked for, in pixels.
const HALF_WIDTHS_PX: [f32; 6] = [0.6, 1.0, 1.7, 2.9, 5.0, 8.5];

/// Directions across a line that are tried, over half a turn; the samples lie far enough out for those between.
const DIRECTIONS: usize = 4;

/// How much of its contrast a line keeps whose sides differ from it in opposite ways: it may be a ramp of shading.
const STAIR_SHARE: f32 = 0.3;

/// How a pixel lies in a thin structure.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Ridge {
    /// Colour difference (ΔE) to both sides, the smaller of the two.
    pub contrast: f32,
    /// Half the width of the line, in pixels; one of six.
    pub half_width_px: f32,
}

/// The ridge filter: places beside each other of which the middle differs from both sides.
pub(super) struct RidgeFilter {
    widths: Vec<Probe>,
}

struct Probe {
    half_width_px: f32,
    radius: isize,
    sides: Vec<IVec2>,
}

impl RidgeFilter {
    /// The filter with its sample places.
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

    /// The strongest line through a pixel over all widths and directions. The weaker side counts, so that the border
    /// of a large thing is no line, and any difference of colour counts, so that a line may be brighter, darker or
    /// merely of another hue (after Koller, Gerig, Székely and Dettwiler, "Multiscale detection of curvilinear
    /// structures in 2-D and 3-D image data", ICCV 1995, for colours).
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
            // Of widths that answer alike the narrowest is meant.
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
