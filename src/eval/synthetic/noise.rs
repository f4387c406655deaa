use glam::{IVec2, Vec2};

/// Smooth value noise in −1…1 with cells of size 1 (lattice values blended by a smoothstep).
pub(super) fn value_noise(at: Vec2, seed: u32) -> f32 {
    let cell = at.floor();
    let inside = at - cell;
    let blend = inside * inside * (Vec2::splat(3.0) - 2.0 * inside);
    let cell = cell.as_ivec2();
    let corner = |dx, dy| lattice(cell + IVec2::new(dx, dy), seed);
    let top = corner(0, 0) + (corner(1, 0) - corner(0, 0)) * blend.x;
    let bottom = corner(0, 1) + (corner(1, 1) - corner(0, 1)) * blend.x;
    top + (bottom - top) * blend.y
}

/// Sum of `octaves` of [`value_noise`], each twice as fine and half as strong; about −1…1.
pub(super) fn fractal_noise(at: Vec2, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut at) = (0.0, 0.5, at);
    for octave in 0..octaves {
        sum += weight * value_noise(at, seed.wrapping_add(octave.wrapping_mul(0x85eb_ca6b)));
        weight *= 0.5;
        at = at * 2.0 + Vec2::new(17.3, -9.1);
    }
    sum
}

/// An evenly spread number in −1…1 for a lattice cell.
pub(super) fn lattice(cell: IVec2, seed: u32) -> f32 {
    let mut h = (cell.x as u32).wrapping_mul(0x27d4_eb2d)
        ^ (cell.y as u32).wrapping_mul(0x1656_67b1)
        ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^= h >> 15;
    (h >> 8) as f32 / 8_388_608.0 - 1.0
}
