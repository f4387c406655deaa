use glam::{DVec3, Vec2, Vec3};

use super::material::{Bitmap, Material};
use super::mesh::Mesh;
use super::model::Assembly;
use super::noise::{Dice, fractal_noise, lattice};
use ostra_masks::LabelId;

/// Distance of the wall from the specimen's axis, in metres.
const WALL_DISTANCE_M: f64 = 0.8;
const WALL_TOP_M: f64 = 0.95;
const PANELS: usize = 5;

/// Adds a folding wall of five panels with posters, and a wooden table with its top at `table_z`.
///
/// The wall is behind the specimen. From every camera of an arc of 120° it fills the image above
/// the table.
pub(super) fn add_surroundings(assembly: &mut Assembly, table_z: f64, dice: &mut Dice) {
    let corner = |k: usize| {
        let azimuth = (-100.0 + 200.0 * k as f64 / PANELS as f64).to_radians();
        DVec3::new(
            WALL_DISTANCE_M * azimuth.sin(),
            WALL_DISTANCE_M * azimuth.cos(),
            0.0,
        )
    };
    for k in 0..PANELS {
        let (left, right) = (corner(k), corner(k + 1));
        let height = WALL_TOP_M - table_z;
        let size_m = Vec2::new((right - left).length() as f32, height as f32);
        let mesh = Mesh::quad(
            left + DVec3::Z * WALL_TOP_M,
            right - left,
            -DVec3::Z * height,
        );
        let seed = dice.texture_seed();
        assembly.add(
            LabelId::NONE,
            Material::Image {
                bitmap: assembly.bitmaps.len(),
            },
            seed,
            mesh,
        );
        assembly.bitmaps.push(panel(size_m, dice));
    }
    let table = Mesh::quad(
        DVec3::new(-0.9, -0.6, table_z),
        DVec3::X * 1.8,
        DVec3::Y * 1.5,
    );
    assembly.add(LabelId::NONE, Material::Wood, dice.texture_seed(), table);
}

/// Creates a plaster panel with posters in a loose grid.
fn panel(size_m: Vec2, dice: &mut Dice) -> Bitmap {
    let seed = dice.texture_seed();
    let plaster = Vec3::new(0.80, 0.78, 0.74) - Vec3::splat(dice.range(0.0, 0.12) as f32);
    let mut bitmap = Bitmap::painted(size_m, |at| {
        plaster * (1.0 + 0.10 * fractal_noise(at / 14.0, 5, seed))
    });
    let cell = Vec2::new(bitmap.width as f32 / 2.0, bitmap.height as f32 / 4.0);
    for row in 0..4 {
        for column in 0..2 {
            let mut jitter = |low, high| dice.range(low, high) as f32;
            let low = cell
                * (Vec2::new(column as f32, row as f32)
                    + Vec2::new(jitter(0.03, 0.1), jitter(0.03, 0.1)));
            let high = low + cell * Vec2::new(jitter(0.78, 0.88), jitter(0.78, 0.88));
            poster(&mut bitmap, low, high, dice);
        }
    }
    bitmap.roughen(0.16, seed ^ 0x55);
    bitmap
}

fn poster(bitmap: &mut Bitmap, low: Vec2, high: Vec2, dice: &mut Dice) {
    bitmap.paint(low + 4.0, high + 5.0, |_, before| before * 0.72);
    match dice.below(4) {
        0 => shapes(bitmap, low, high, dice),
        1 => landscape(bitmap, low, high, dice),
        2 => text(bitmap, low, high, dice),
        _ => mosaic(bitmap, low, high, dice),
    }
}

fn color(dice: &mut Dice) -> Vec3 {
    Vec3::new(
        dice.range(0.1, 0.95) as f32,
        dice.range(0.1, 0.95) as f32,
        dice.range(0.1, 0.95) as f32,
    )
}

/// Paints overlapping discs, rings and bars on a plain ground.
fn shapes(bitmap: &mut Bitmap, low: Vec2, high: Vec2, dice: &mut Dice) {
    let ground = color(dice) * 0.3 + 0.65;
    bitmap.paint(low, high, |_, _| ground);
    let size = high - low;
    for _ in 0..26 {
        let centre =
            low + size * Vec2::new(dice.range(0.08, 0.92) as f32, dice.range(0.08, 0.92) as f32);
        let (ink, radius) = (color(dice), dice.range(6.0, 38.0) as f32);
        let (kind, angle) = (dice.below(3), dice.range(0.0, std::f64::consts::PI) as f32);
        let along = Vec2::from_angle(angle);
        bitmap.paint(
            (centre - radius).max(low),
            (centre + radius).min(high),
            |at, before| {
                let offset = at - centre;
                let inside = match kind {
                    0 => offset.length() < radius,
                    1 => offset.length() < radius && offset.length() > 0.6 * radius,
                    _ => {
                        offset.dot(along).abs() < radius
                            && offset.perp_dot(along).abs() < 0.22 * radius
                    }
                };
                if inside { ink } else { before }
            },
        );
    }
}

/// Paints ridges under a sky, like a photograph of hills.
fn landscape(bitmap: &mut Bitmap, low: Vec2, high: Vec2, dice: &mut Dice) {
    let (sky, near, far, seed) = (
        color(dice) * 0.4 + 0.6,
        color(dice) * 0.5,
        color(dice),
        dice.texture_seed(),
    );
    let size = high - low;
    bitmap.paint(low, high, |at, _| {
        let place = (at - low) / size;
        let ridge = |depth: f32| {
            let along = Vec2::new(at.x / (60.0 - 30.0 * depth), depth * 9.0);
            0.3 + 0.5 * depth + 0.25 * fractal_noise(along, 4, seed)
        };
        let layer = (0..5)
            .rev()
            .map(|k| k as f32 / 4.0)
            .find(|&depth| place.y > ridge(depth));
        let grain = 1.0 + 0.45 * fractal_noise(at / 9.0, 4, seed ^ 7);
        match layer {
            Some(depth) => far.lerp(near, depth) * grain,
            None => {
                sky.lerp(Vec3::ONE, place.y)
                    * (1.0 + 0.35 * fractal_noise(at / Vec2::new(40.0, 16.0), 4, seed ^ 9))
            }
        }
    });
}

/// Paints a heading, a block of colour and lines of letter-like strokes.
fn text(bitmap: &mut Bitmap, low: Vec2, high: Vec2, dice: &mut Dice) {
    let (paper, ink, accent, seed) = (
        color(dice) * 0.12 + 0.84,
        color(dice) * 0.3,
        color(dice),
        dice.texture_seed(),
    );
    let split = dice.range(0.2, 0.4) as f32;
    let size = high - low;
    bitmap.paint(low, high, |at, _| {
        let place = (at - low) / size;
        let margin = (place - 0.5).abs().max_element() > 0.45;
        let (pitch, ground) = if place.y < split {
            (26.0, accent)
        } else {
            (11.0, paper)
        };
        let line = ((at.y - low.y) / pitch).floor();
        let letter = ((at.x - low.x) / (pitch * 0.55)).floor();
        let inside = Vec2::new(
            (at.x - low.x) / (pitch * 0.55) - letter,
            (at.y - low.y) / pitch - line,
        );
        let stroke = (inside * Vec2::new(3.0, 4.0)).floor().as_ivec2();
        let word = lattice(glam::IVec2::new(letter as i32 / 3, line as i32), seed ^ 3) > -0.7;
        let on = stroke.y < 3 && inside.x < 0.8;
        let cell = stroke + glam::IVec2::new(letter as i32 * 5, line as i32 * 7);
        if !margin && word && on && lattice(cell, seed) > -0.1 {
            ink
        } else {
            ground
        }
    });
}

/// Paints irregular tiles in shades of two colours.
///
/// Source: Worley, "A cellular texture basis function", SIGGRAPH 1996.
fn mosaic(bitmap: &mut Bitmap, low: Vec2, high: Vec2, dice: &mut Dice) {
    let (first, second, seed, pitch) = (
        color(dice),
        color(dice),
        dice.texture_seed(),
        dice.range(11.0, 24.0) as f32,
    );
    bitmap.paint(low, high, |at, _| {
        let cell = (at / pitch).floor().as_ivec2();
        let mut nearest = (f32::MAX, f32::MAX, cell);
        for k in 0..9 {
            let near = cell + glam::IVec2::new(k % 3 - 1, k / 3 - 1);
            let jitter = Vec2::new(lattice(near, seed), lattice(near, seed ^ 1)) * 0.42 + 0.5;
            let distance = ((near.as_vec2() + jitter) * pitch).distance(at);
            if distance < nearest.0 {
                nearest = (distance, nearest.0, near);
            } else if distance < nearest.1 {
                nearest.1 = distance;
            }
        }
        let joint = if nearest.1 - nearest.0 < 1.6 {
            0.35
        } else {
            1.0
        };
        let shade = 0.75 + 0.35 * lattice(nearest.2, seed ^ 2);
        first.lerp(second, 0.5 + 0.5 * lattice(nearest.2, seed ^ 4)) * shade * joint
    });
}
