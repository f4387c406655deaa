use super::depth_view::{DepthView, Reprojection};
use ostra_core::statistics::upper_median;

/// How masks are carried through geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionOptions {
    /// How much two depths of one surface may differ, in medians of the differences between two frames; ≥ 1.
    pub noise_factor: f32,
    /// Least of that, as a share of the depth at the scene's median depth; > 0.
    pub least_tolerance: f32,
    /// Most of that, as a share of the depth at the scene's median depth; < 0.1.
    pub most_tolerance: f32,
    /// Keyframes asked per label and frame; ≥ 1.
    pub keyframes: usize,
    /// Frames that fill the holes in a keyframe's depth; 0 = none.
    pub fillers: usize,
    /// Weight of a vote where a surface is seen at a grazing angle, 0–1; 1 where it is faced.
    pub grazing_weight: f32,
    /// Weight of a vote on the border of a keyframe's mask, 0–1; 1 from `border_px` inside or outside.
    pub border_weight: f32,
    /// Width of the border that is trusted less, in pixels; 0–8.
    pub border_px: u8,
    /// Weight of a keyframe's surface that is drawn where the target has no depth, 0–1.
    pub drawn_weight: f32,
    /// The same for a surface in a hole of the keyframe's own depth, 0–1.
    pub filled_weight: f32,
    /// How far votes spread over an even surface, in pixels; > 0.
    pub reach_px: f32,
    /// Extra length of a step between pixels whose colours differ by 255 (sum over channels), in pixels.
    pub color_edge_px: f32,
    /// Extra length of a step over a jump in depth, in pixels.
    pub depth_edge_px: f32,
    /// Weight of a pixel's own votes next to those that are spread to it; ≥ 0.
    pub own_weight: f32,
    /// Least weight that decides a pixel; 0–1.
    pub least_weight: f32,
    /// How far beyond the pixels that were voted for a label may spread, in pixels.
    pub margin_px: usize,
}

impl Default for ReprojectionOptions {
    fn default() -> Self {
        Self {
            noise_factor: 3.0,
            least_tolerance: 0.005,
            most_tolerance: 0.04,
            keyframes: 3,
            fillers: 8,
            grazing_weight: 0.1,
            border_weight: 0.2,
            border_px: 3,
            drawn_weight: 0.4,
            filled_weight: 0.2,
            reach_px: 30.0,
            color_edge_px: 60.0,
            depth_edge_px: 300.0,
            own_weight: 1.0,
            least_weight: 1e-3,
            margin_px: 32,
        }
    }
}

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
    pub fn most(view: &DepthView, options: &ReprojectionOptions) -> Self {
        Self::new(options.most_tolerance, view.median_depth().unwrap_or(1.0))
    }

    /// From how much the depths of two frames differ where they see the same place: three times the median, within the
    /// limits of the options; the upper limit where they see too little of the same.
    pub fn measured(from: &DepthView, to: &DepthView, options: &ReprojectionOptions) -> Self {
        let unit = Self::new(1.0, from.median_depth().unwrap_or(1.0));
        let reprojection = Reprojection::new(&from.posed, &to.posed);
        let mut differences: Vec<f32> = (0..from.rays.len())
            .step_by(STRIDE)
            .filter_map(|at| {
                let moved = reprojection.transform(from.point(at)?);
                let px = reprojection.pixel(moved)?;
                let depth = to.depth.depths[px.y as usize * to.width() + px.x as usize];
                let difference = (depth - moved.z).abs();
                (depth > 0.0 && difference < GATE * moved.z).then(|| difference / unit.at(moved.z))
            })
            .collect();
        let median = upper_median(&mut differences).unwrap_or_default();
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
