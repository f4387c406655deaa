use super::depth_view::{DepthView, Reprojection};
use ostra_core::statistics::upper_median;

/// Options of the re-projection of masks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReprojectionOptions {
    /// Depth tolerance, in medians of the depth differences between two frames; ≥ 1.
    pub noise_factor: f32,
    /// Minimum tolerance relative to depth, at the scene's median depth; > 0.
    pub least_tolerance: f32,
    /// Maximum tolerance relative to depth, at the scene's median depth; < 0.1.
    pub most_tolerance: f32,
    /// Number of keyframes that vote per label and frame; ≥ 1.
    pub keyframes: usize,
    /// Number of frames that fill the holes in a keyframe's depth; 0 = none.
    pub fillers: usize,
    /// Weight of a vote at a grazing angle, 0–1; a surface that faces the camera has 1.
    pub grazing_weight: f32,
    /// Weight of a vote on a border of a keyframe's mask, 0–1; 1 from `border_px` on.
    pub border_weight: f32,
    /// Width of the border with reduced weight, in pixels; 0–8.
    pub border_px: u8,
    /// Weight of a keyframe's surface drawn where the target has no depth, 0–1.
    pub drawn_weight: f32,
    /// Weight of a surface in a filled hole of the keyframe's depth, 0–1.
    pub filled_weight: f32,
    /// Distance over which votes spread on a uniform surface, in pixels; > 0.
    pub reach_px: f32,
    /// Extra path length between pixels whose colours differ by 255 (channel sum), in pixels.
    pub color_edge_px: f32,
    /// Extra path length over a depth jump, in pixels.
    pub depth_edge_px: f32,
    /// Weight of a pixel's own votes relative to the votes that spread to it; ≥ 0.
    pub own_weight: f32,
    /// Minimum total weight that decides a pixel; 0–1.
    pub least_weight: f32,
    /// Maximum spread of a label beyond its voted pixels, in pixels.
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

/// Maximum difference between two depths of one surface.
///
/// It grows with the square of the depth, as the error of depth cameras and stereo does.
#[derive(Debug, Clone, Copy)]
pub struct Tolerance {
    share: f32,
    median: f32,
}

/// Sampling step in pixels when the tolerance is measured.
const STRIDE: usize = 53;
/// Relative depth difference above which two surfaces are different.
const GATE: f32 = 0.1;
/// Minimum number of samples for a valid measurement.
const FEWEST: usize = 64;

impl Tolerance {
    /// Creates a tolerance of `share · median` at the scene's median depth.
    ///
    /// It is relative to the median and so independent of the unit.
    pub fn new(share: f32, median: f32) -> Self {
        Self { share, median }
    }

    /// Returns the largest tolerance that the options allow.
    pub fn most(view: &DepthView, options: &ReprojectionOptions) -> Self {
        Self::new(options.most_tolerance, view.median_depth().unwrap_or(1.0))
    }

    /// Measures the tolerance from the depth differences between two frames.
    ///
    /// It is `noise_factor` times their median, within the limits of the options. If the overlap is
    /// too small, it is the upper limit.
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

    /// Returns the tolerance at a depth.
    pub fn at(&self, depth: f32) -> f32 {
        0.5 * self.share * (self.median + depth * depth / self.median)
    }
}
