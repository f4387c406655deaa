/// How much two depths of one surface may differ: growing with the square of the depth, as the error of a depth camera
/// and of stereo does.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    base: f32,
    growth: f32,
}

impl Tolerance {
    /// Equal to `share · median` at the median depth of the scene, so that it fits any unit.
    pub fn new(share: f32, median: f32) -> Self {
        Self { base: 0.5 * share * median, growth: 0.5 * share / median }
    }

    /// The tolerance at a depth.
    pub fn at(&self, depth: f32) -> f32 {
        self.base + self.growth * depth * depth
    }
}
