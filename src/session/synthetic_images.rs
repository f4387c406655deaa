//! Synthetic images with known content, to test networks.

use glam::DVec2;

use ostra_frames::Image;
use ostra_masks::{PxBox, Region};

/// A disc on an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Disc {
    width: u32,
    height: u32,
    pub(crate) centre_px: DVec2,
    radius_px: f64,
}

/// A grey image with values from 0 to 1, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grey {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Disc {
    /// Returns the bounding box.
    pub(crate) fn extent(&self) -> PxBox {
        PxBox {
            min_px: self.centre_px - self.radius_px,
            max_px: self.centre_px + self.radius_px,
        }
    }

    /// Returns the pixels of the disc.
    pub(crate) fn region(&self) -> Region {
        let inside = positions(self.width, self.height)
            .map(|at| at.distance(self.centre_px) < self.radius_px)
            .collect();
        Region {
            width: self.width,
            height: self.height,
            inside,
        }
    }
}

/// Returns the centres of all pixels, row by row.
fn positions(width: u32, height: u32) -> impl Iterator<Item = DVec2> {
    (0..width * height)
        .map(move |at| DVec2::new(f64::from(at % width), f64::from(at / width)) + 0.5)
}

/// Returns an orange disc and a smaller blue square on a greenish background.
pub(crate) fn disc_image() -> (Image, Disc) {
    let (width, height) = (640, 480);
    let disc = Disc {
        width,
        height,
        centre_px: DVec2::new(270.0, 230.0),
        radius_px: 140.0,
    };
    let texture = noise(width as usize, height as usize);
    let colour = |(at_px, texture): (DVec2, &f32)| {
        let square = (at_px - DVec2::new(520.0, 360.0)).abs().max_element() < 60.0;
        let base: [f64; 3] = if at_px.distance(disc.centre_px) < disc.radius_px {
            [225.0, 120.0, 40.0]
        } else if square {
            [50.0, 70.0, 190.0]
        } else {
            [110.0, 140.0, 110.0]
        };
        // A little texture, because networks have never seen perfectly flat colours.
        base.map(|value| (value + 8.0 * (f64::from(*texture) - 0.5)).round() as u8)
    };
    let pixels = positions(width, height).zip(&texture.values).map(colour);
    let image = Image {
        width,
        height,
        pixels: pixels.collect(),
    };
    (image, disc)
}

/// Returns an image of a video in which an orange disc moves to the right in front of a wall.
pub(crate) fn moving_disc(at: u32) -> (Image, Disc) {
    let (width, height) = (320, 240);
    let disc = Disc {
        width,
        height,
        centre_px: DVec2::new(80.0 + 20.0 * f64::from(at), 120.0),
        radius_px: 45.0,
    };
    let wall = noise(width as usize, height as usize);
    // The texture of the disc moves with it.
    let surface = noise(width as usize, height as usize);
    let colour = |(at_px, wall): (DVec2, &f32)| {
        let from_centre = at_px - disc.centre_px;
        if from_centre.length() >= disc.radius_px {
            return [110.0, 140.0, 110.0].map(|value| (value + 60.0 * f64::from(wall - 0.5)) as u8);
        }
        let place = (from_centre + 100.0).as_uvec2();
        let texture = surface.values[(place.y * width + place.x) as usize];
        [200.0, 110.0, 40.0].map(|value| (value + 50.0 * f64::from(texture - 0.5)) as u8)
    };
    let pixels = positions(width, height).zip(&wall.values).map(colour);
    let image = Image {
        width,
        height,
        pixels: pixels.collect(),
    };
    (image, disc)
}

/// Returns a round clock on a plain wall.
pub(crate) fn clock_image() -> (Image, Disc) {
    let (width, height) = (416, 416);
    let clock = Disc {
        width,
        height,
        centre_px: DVec2::new(208.0, 208.0),
        radius_px: 120.0,
    };
    let radius = clock.radius_px;
    let mut strokes = vec![
        (DVec2::ZERO, DVec2::new(-0.35, -0.3) * radius, 5.0),
        (DVec2::ZERO, DVec2::new(0.35, -0.55) * radius, 4.0),
    ];
    for hour in 0..12 {
        let direction = DVec2::from_angle(f64::from(hour) * std::f64::consts::PI / 6.0);
        strokes.push((0.74 * radius * direction, 0.84 * radius * direction, 3.0));
    }
    let colour = |at_px: DVec2| {
        let at = at_px - clock.centre_px;
        let is_stroke = |&(from, to, half_width): &(DVec2, DVec2, f64)| {
            distance_to_segment(at, from, to) < half_width
        };
        if strokes.iter().any(is_stroke) {
            [20, 20, 20]
        } else if at.length() < 0.9 * radius {
            [245, 245, 240]
        } else if at.length() < radius {
            [30, 30, 30]
        } else {
            [180, 190, 200]
        }
    };
    let image = Image {
        width,
        height,
        pixels: positions(width, height).map(colour).collect(),
    };
    (image, clock)
}

fn distance_to_segment(at: DVec2, from: DVec2, to: DVec2) -> f64 {
    let along = to - from;
    let share = ((at - from).dot(along) / along.length_squared()).clamp(0.0, 1.0);
    at.distance(from + share * along)
}

/// Returns smooth noise at several scales, which is rich in corners.
pub(crate) fn noise(width: usize, height: usize) -> Grey {
    const OCTAVES: [(usize, f32); 4] = [(4, 0.3), (9, 0.3), (21, 0.2), (50, 0.2)];
    let at = |x: usize, y: usize| {
        let sum: f32 = OCTAVES
            .iter()
            .map(|&(cell, weight)| weight * value_noise(x, y, cell))
            .sum();
        // More contrast: sums of random values lie close to their mean.
        (0.5 + 2.0 * (sum - 0.5)).clamp(0.0, 1.0)
    };
    Grey {
        width,
        height,
        values: (0..width * height)
            .map(|pixel| at(pixel % width, pixel / width))
            .collect(),
    }
}

/// Interpolates between random values on a grid of `cell` pixels.
fn value_noise(x: usize, y: usize, cell: usize) -> f32 {
    let (column, row) = (x / cell, y / cell);
    let share = |at: usize| (at % cell) as f32 / cell as f32;
    let corner = |column: usize, row: usize| random(column, row, cell);
    let mix = |a: f32, b: f32, share: f32| a + (b - a) * share;
    let above = mix(corner(column, row), corner(column + 1, row), share(x));
    let below = mix(
        corner(column, row + 1),
        corner(column + 1, row + 1),
        share(x),
    );
    mix(above, below, share(y))
}

/// Returns a value from 0 to 1 that depends only on the arguments.
fn random(column: usize, row: usize, seed: usize) -> f32 {
    let mut bits = ((column as u64) << 40) ^ ((row as u64) << 20) ^ seed as u64;
    // Finalizer of SplitMix64.
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((bits ^ (bits >> 31)) >> 40) as f32 / (1u32 << 24) as f32
}

impl Grey {
    /// Returns the part of `width` × `height` pixels from a pixel on.
    pub(crate) fn part(&self, x: usize, y: usize, width: usize, height: usize) -> Self {
        let rows = self.values.chunks_exact(self.width).skip(y).take(height);
        Self {
            width,
            height,
            values: rows.flat_map(|row| &row[x..x + width]).copied().collect(),
        }
    }
}
