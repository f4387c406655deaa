//! How thorough the adjustments of a model are.

use crate::sfm::KeypointId;
use ostra_geometry::bundle::Loss;

/// How thorough an adjustment is.
#[derive(Clone, Copy)]
pub(super) struct Effort {
    pub loss: Loss,
    /// Most iterations.
    pub iterations: usize,
    /// Share of the loss that an iteration must gain for another one.
    pub tolerance: f64,
    /// Also refines the principal points of cameras that took few of the images.
    pub principal: bool,
    /// Most observations of a point that are used once the model is large.
    pub sample: TrackSample,
}

/// Most observations of a point that an adjustment uses; the others are left out evenly.
#[derive(Clone, Copy)]
pub(super) struct TrackSample {
    /// By images that move.
    pub moving: usize,
    /// By images that stay where they are.
    pub fixed: usize,
}

impl TrackSample {
    /// Every observation is used.
    pub const ALL: Self = Self {
        moving: usize::MAX,
        fixed: usize::MAX,
    };

    /// Returns the observations of a point that are used.
    ///
    /// Which ones they are depends on the number of the point, so that every image keeps some.
    pub fn of(self, track: &[KeypointId], point: u32, is_free: &[bool]) -> Vec<KeypointId> {
        let is_moving = |keypoint: &KeypointId| is_free[keypoint.image as usize];
        let moving = track.iter().filter(|keypoint| is_moving(keypoint)).count();
        let counts = [track.len() - moving, moving];
        let wanted = [counts[0].min(self.fixed), counts[1].min(self.moving)];
        let mut sums = counts.map(|count| point as usize % count.max(1));
        let chosen = track.iter().filter(|keypoint| {
            let side = usize::from(is_moving(keypoint));
            sums[side] += wanted[side];
            let is_chosen = sums[side] >= counts[side];
            if is_chosen {
                sums[side] -= counts[side];
            }
            is_chosen
        });
        chosen.copied().collect()
    }
}

pub(super) const LOCAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 15,
    tolerance: 1e-4,
    principal: false,
    sample: TrackSample {
        moving: usize::MAX,
        fixed: 8,
    },
};
pub(super) const GLOBAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 30,
    tolerance: 1e-5,
    principal: false,
    sample: TrackSample {
        moving: 12,
        fixed: 12,
    },
};
pub(super) const FINAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 100,
    tolerance: 1e-8,
    principal: true,
    sample: TrackSample::ALL,
};
/// Before [`LARGE_FINAL`] in large models.
///
/// With all observations, the time of an iteration grows with the square of the number of images
/// that see a point. Of 300 rendered images, 28 see a point on average; 30 iterations with all
/// observations took more than a quarter of the time of mapping.
pub(super) const LARGE_ALMOST_FINAL: Effort = Effort {
    tolerance: 1e-7,
    sample: TrackSample {
        moving: 16,
        fixed: 16,
    },
    ..FINAL
};
/// All observations, from where only a few iterations are left.
pub(super) const LARGE_FINAL: Effort = Effort {
    tolerance: 1e-6,
    ..FINAL
};
