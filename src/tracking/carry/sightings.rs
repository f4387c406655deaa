use ostra_masks::LabelId;

/// What one anchor says of every pixel of a target: a label and how far it is to be trusted.
#[derive(Debug, Clone)]
pub struct Sightings {
    packed: Vec<u32>,
}

/// Weights are kept in steps of one by this.
const STEPS: f32 = 65535.0;
/// The anchor sees something farther away through the pixel's place: a label without weight.
const THROUGH: u32 = 0xffff_0000;

impl Sightings {
    /// Nothing said of any pixel.
    pub fn none(pixels: usize) -> Self {
        Self {
            packed: vec![0; pixels],
        }
    }

    /// The label that the anchor gives a pixel (0 = nothing there), with a weight above 0 up to 1; `None` where the
    /// anchor does not see it.
    pub fn at(&self, pixel: usize) -> Option<(LabelId, f32)> {
        let packed = self.packed[pixel];
        (packed & 0xffff != 0).then(|| {
            (
                LabelId((packed >> 16) as u16),
                (packed & 0xffff) as f32 / STEPS,
            )
        })
    }

    /// Whether the anchor sees through the place of the pixel's surface to something behind it.
    pub fn is_through(&self, pixel: usize) -> bool {
        self.packed[pixel] == THROUGH
    }

    /// Sets that the anchor sees through the place of a pixel's surface.
    pub fn set_through(&mut self, pixel: usize) {
        self.packed[pixel] = THROUGH;
    }

    /// Sets what is said of a pixel.
    pub fn set(&mut self, pixel: usize, label: LabelId, weight: f32) {
        let steps = (weight.clamp(0.0, 1.0) * STEPS).max(1.0) as u32;
        self.packed[pixel] = u32::from(label.0) << 16 | steps;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_and_what_is_seen_through_are_told_apart() {
        let mut sightings = Sightings::none(3);
        sightings.set(0, LabelId(u16::MAX), 1e-9);
        sightings.set_through(1);
        assert!(
            sightings
                .at(0)
                .is_some_and(|(label, weight)| label == LabelId(u16::MAX) && weight > 0.0)
        );
        assert_eq!((sightings.at(1), sightings.at(2)), (None, None));
        assert_eq!(
            [0, 1, 2].map(|pixel| sightings.is_through(pixel)),
            [false, true, false]
        );
    }
}
