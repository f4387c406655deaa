use glam::{DMat2, DMat3, DVec2, DVec3};
use pulp::Arch;

use crate::camera::pixel_slope;
use crate::ransac::{Cutoff, LANES, within};
use crate::{Camera, Pose};

/// A known point and its position in the image.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointObservation {
    pub point: DVec3,
    pub at_px: DVec2,
    pub ray: DVec2,
    /// Derivative of the pixel position by the position on the plane z = 1.
    pub slope: DMat2,
    /// Index in the caller's lists.
    pub given: u32,
}

/// Returns all points that are finite and at positions that the lens covers.
pub(super) fn seen(camera: &Camera, at_px: &[DVec2], points: &[DVec3]) -> Vec<PointObservation> {
    let one = |(given, (&at_px, &point)): (usize, (&DVec2, &DVec3))| {
        let ray = camera.unproject(at_px);
        let finite = at_px.is_finite() && point.is_finite() && ray.is_finite();
        let slope = if finite {
            pixel_slope(camera, ray)?
        } else {
            return None;
        };
        slope.is_finite().then_some(PointObservation {
            point,
            at_px,
            ray,
            slope,
            given: given as u32,
        })
    };
    at_px
        .iter()
        .zip(points)
        .enumerate()
        .filter_map(one)
        .collect()
}

/// Eight points for SIMD; unused lanes hold NaN, which no pose explains.
#[derive(Debug, Clone, Copy)]
struct PointLanes {
    point: [[f64; LANES]; 3],
    ray: [[f64; LANES]; 2],
    slope: [[f64; LANES]; 4],
}

/// Points in the layout of the SIMD kernel.
pub(super) struct Blocks {
    blocks: Vec<PointLanes>,
    count: usize,
    limit: f64,
    arch: Arch,
}

impl Blocks {
    pub fn new(seen: &[PointObservation], max_error_px: f64) -> Self {
        let nan = [f64::NAN; LANES];
        let mut blocks = vec![
            PointLanes {
                point: [nan; 3],
                ray: [nan; 2],
                slope: [nan; 4]
            };
            seen.len().div_ceil(LANES)
        ];
        for (place, one) in seen.iter().enumerate() {
            let (block, lane) = (&mut blocks[place / LANES], place % LANES);
            (0..3).for_each(|i| block.point[i][lane] = one.point[i]);
            (0..2).for_each(|i| block.ray[i][lane] = one.ray[i]);
            let slope = one.slope.to_cols_array();
            (0..4).for_each(|i| block.slope[i][lane] = slope[i]);
        }
        Self {
            blocks,
            count: seen.len(),
            limit: max_error_px * max_error_px,
            arch: Arch::new(),
        }
    }

    /// Returns the sum of squared errors truncated at the limit; stops early above `enough`.
    pub fn cost(&self, pose: &Pose, enough: f64) -> f64 {
        let (rotation, translation) = (DMat3::from_quat(pose.rotation), pose.translation);
        self.arch.dispatch(Cutoff::new(
            &self.blocks,
            self.count,
            [self.limit, enough],
            #[inline(always)]
            |block| errors(&rotation, translation, block),
        ))
    }

    /// Returns the indices of points whose squared error is below the limit, ascending.
    pub fn within(&self, pose: &Pose) -> Vec<u32> {
        let rotation = DMat3::from_quat(pose.rotation);
        within(&self.blocks, self.limit, |block| {
            errors(&rotation, pose.translation, block)
        })
    }
}

/// Returns squared reprojection errors in pixels; infinite behind the camera.
///
/// The lens is linearised around the position of each point.
#[inline(always)]
fn errors(r: &DMat3, t: DVec3, b: &PointLanes) -> [f64; LANES] {
    let mut errors = [0.0; LANES];
    for (lane, error) in errors.iter_mut().enumerate() {
        let [x, y, z] = [b.point[0][lane], b.point[1][lane], b.point[2][lane]];
        let depth = r.x_axis.z * x + r.y_axis.z * y + r.z_axis.z * z + t.z;
        let near = depth.recip();
        let u = (r.x_axis.x * x + r.y_axis.x * y + r.z_axis.x * z + t.x) * near - b.ray[0][lane];
        let v = (r.x_axis.y * x + r.y_axis.y * y + r.z_axis.y * z + t.y) * near - b.ray[1][lane];
        let du = b.slope[0][lane] * u + b.slope[2][lane] * v;
        let dv = b.slope[1][lane] * u + b.slope[3][lane] * v;
        *error = if depth > 0.0 {
            du * du + dv * dv
        } else {
            f64::INFINITY
        };
    }
    errors
}
