use super::options::CarryOptions;
use super::viewpoint::{Passage, Viewpoint};

/// How much two depths of one surface may differ: growing with the square of the depth, as the error of a depth camera
/// and of stereo does.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    share: f32,
    median: f32,
}

/// Every so-many-th pixel is looked at when measuring.
const STRIDE: usize = 53;
/// Differences above this share of the depth are other surfaces.
const GATE: f32 = 0.1;
/// Pixels below which a measurement says nothing.
const FEWEST: usize = 64;

impl Tolerance {
    /// `share · median` at the median depth of the scene, so that it fits any unit.
    pub fn new(share: f32, median: f32) -> Self {
        Self { share, median }
    }

    /// The most that the options allow.
    pub fn most(view: &Viewpoint, options: &CarryOptions) -> Self {
        Self::new(options.most_tolerance, view.median_depth().unwrap_or(1.0))
    }

    /// From how much the depths of two frames differ where they see the same place: three times the median, within the
    /// limits of the options; the upper limit where they see too little of the same.
    pub fn measured(from: &Viewpoint, to: &Viewpoint, options: &CarryOptions) -> Self {
        let unit = Self::new(1.0, from.median_depth().unwrap_or(1.0));
        let passage = Passage::new(&from.stand, &to.stand);
        let mut differences: Vec<f32> = (0..from.rays.len())
            .step_by(STRIDE)
            .filter_map(|at| {
                let moved = passage.transform(from.point(at)?);
                let px = passage.pixel(moved)?;
                let depth = to.depth.depths[px.y as usize * to.width() + px.x as usize];
                let difference = (depth - moved.z).abs();
                (depth > 0.0 && difference < GATE * moved.z).then(|| difference / unit.at(moved.z))
            })
            .collect();
        differences.sort_by(f32::total_cmp);
        let median = differences
            .get(differences.len() / 2)
            .copied()
            .unwrap_or_default();
        let enough = differences.len() >= FEWEST;
        let share = if enough {
            (options.noise_factor * median).clamp(options.least_tolerance, options.most_tolerance)
        } else {
            options.most_tolerance
        };
        Self { share, ..unit }
    }

    /// The tolerance at a depth.
    pub fn at(&self, depth: f32) -> f32 {
        0.5 * self.share * (self.median + depth * depth / self.median)
    }
}
