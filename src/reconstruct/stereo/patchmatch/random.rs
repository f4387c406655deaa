/// Random numbers that depend only on their purpose.
///
/// A counter instead of a state gives the same numbers in any order and on any device (M. Jarzynski
/// and M. Olano, *Hash Functions for GPU Rendering*, JCGT 2020: PCG).
#[derive(Debug, Clone, Copy)]
pub struct Dice {
    key: u32,
    count: u32,
}

#[inline(always)]
fn hash(value: u32) -> u32 {
    let state = value.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

impl Dice {
    /// Creates numbers for one visit of one pixel.
    #[inline(always)]
    pub fn new(seed: u32, visit: u32, pixel: u32) -> Self {
        Self {
            key: hash(seed ^ hash(visit ^ hash(pixel))),
            count: 0,
        }
    }

    /// Creates numbers for another purpose in the same visit.
    #[inline(always)]
    pub fn adjacent(self) -> Self {
        Self {
            key: hash(self.key),
            count: self.count,
        }
    }

    /// Returns the next number, uniform in 0–1.
    #[inline(always)]
    pub fn unit(&mut self) -> f32 {
        self.count = self.count.wrapping_add(0x9E37_79B9);
        (hash(self.key ^ self.count) >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Returns the next number, uniform in −1–1.
    #[inline(always)]
    pub fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }
}
