use glam::{IVec2, Vec2};
use rand::RngExt;
use rand_pcg::Pcg32;

/// Returns smooth value noise in −1…1: lattice values at distance 1, blended by a smoothstep.
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

/// Returns the sum of `octaves` of [`value_noise`], about −1…1.
///
/// Each octave is twice as fine and half as strong as the one before.
pub(super) fn fractal_noise(at: Vec2, octaves: u32, seed: u32) -> f32 {
    let (mut sum, mut weight, mut at) = (0.0, 0.5, at);
    for octave in 0..octaves {
        sum += weight * value_noise(at, seed.wrapping_add(octave.wrapping_mul(0x85eb_ca6b)));
        weight *= 0.5;
        at = at * 2.0 + Vec2::new(17.3, -9.1);
    }
    sum
}

/// Returns a uniformly distributed number in −1…1 for a lattice cell.
pub(super) fn lattice(cell: IVec2, seed: u32) -> f32 {
    let mut h = (cell.x as u32).wrapping_mul(0x27d4_eb2d)
        ^ (cell.y as u32).wrapping_mul(0x1656_67b1)
        ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^= h >> 15;
    (h >> 8) as f32 / 8_388_608.0 - 1.0
}

/// A seeded random number generator for scenes.
pub(super) struct Dice(Pcg32);

impl Dice {
    /// Creates a generator; each `stream` of a `seed` gives an independent sequence.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        // Finaliser of SplitMix64 (Steele, Lea, Flood, "Fast splittable pseudorandom number
        // generators", OOPSLA 2014). It makes scenes of consecutive seeds differ.
        let mut state = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        state = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        state = (state ^ (state >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self(Pcg32::new(state ^ (state >> 31), stream))
    }

    /// Returns a uniform number in `low..high`.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Returns a uniform integer in `0..count`; `count` must be above 0.
    pub(super) fn below(&mut self, count: usize) -> usize {
        self.0.random_range(0..count)
    }

    /// Returns a standard normal number.
    ///
    /// Source: Box and Muller, "A note on the generation of random normal deviates", 1958.
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.0.random::<f64>()).cos()
    }

    /// Returns a seed for the texture of one part.
    pub(super) fn texture_seed(&mut self) -> u32 {
        self.0.random()
    }
}
