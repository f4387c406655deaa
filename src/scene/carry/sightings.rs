use crate::masks::LabelId;

/// What one anchor says of every pixel of a target: a label and how far it is to be trusted.
#[derive(Debug, Clone)]
pub struct Sightings {
    packed: Vec<u32>,
}

/// Weights are kept in steps of one by this.
const STEPS: f32 = 65535.0;

impl Sightings {
    /// Nothing said of any pixel.
    pub fn none(pixels: usize) -> Self {
        Self { packed: vec![0; pixels] }
    }

    /// The label that the anchor gives a pixel (0 = nothing there), with a weight above 0 up to 1; `None` where the
    /// anchor does not see it.
    pub fn at(&self, pixel: usize) -> Option<(LabelId, f32)> {
        let packed = self.packed[pixel];
        (packed != 0).then(|| (LabelId((packed >> 16) as u16), (packed & 0xffff) as f32 / STEPS))
    }

    /// Sets what is said of a pixel.
    pub fn set(&mut self, pixel: usize, label: LabelId, weight: f32) {
        let steps = (weight.clamp(0.0, 1.0) * STEPS).max(1.0) as u32;
        self.packed[pixel] = u32::from(label.0) << 16 | steps;
    }
}
