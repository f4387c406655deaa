use rand::RngExt;
use rand_pcg::Pcg32;

/// Seeded random numbers for building scenes.
pub(super) struct Dice(Pcg32);

impl Dice {
    /// Independent sequences for different `stream`s of one `seed`.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        // SplitMix64's finaliser (Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014):
        // neighbouring seeds give unlike scenes.
        let mut state = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        state = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        state = (state ^ (state >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self(Pcg32::new(state ^ (state >> 31), stream))
    }

    /// Uniform in `low..high`.
    pub(super) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Uniform in `0..count`; `count` above 0.
    pub(super) fn below(&mut self, count: usize) -> usize {
        self.0.random_range(0..count)
    }

    /// Standard normal (Box and Muller, "A note on the generation of random normal deviates", 1958).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.0.random::<f64>()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.0.random::<f64>()).cos()
    }

    /// A seed for the texture of one part.
    pub(super) fn texture_seed(&mut self) -> u32 {
        self.0.random()
    }
}
