use glam::{DQuat, DVec3, Vec3};
use nalgebra::{Matrix6, Vector6};
use wide::f32x8;

use super::pyramid::{Pyramid, PyramidLevel};
use ostra_geometry::{Isometry, Pose};

/// Maximum number of steps per level, from the finest to the coarsest.
const STEPS: [usize; 4] = [10, 10, 12, 20];
/// Maximum distance of a point from the surface that it is compared with, as a share of the depth, per level.
const GATES: [f32; 4] = [0.04, 0.06, 0.10, 0.15];
/// Degrees of freedom of the t-distribution that errors are assumed to follow.
const FREEDOM: f32 = 5.0;
/// Minimum standard deviation: of depth as a share of it, at the typical depth; of luma.
const LEAST_SPREAD: [f32; 2] = [1e-3, 4e-3];
/// Weight of luma relative to depth, per level.
///
/// On the fine levels it is enough to hold a pose where surfaces leave it open. It is too little to
/// pull the pose off where a sensor's image is not exactly aligned with its depth.
const LUMA: [f32; 4] = [0.1, 0.1, 0.1, 0.5];
/// A level has converged if the step (radians, shares of the typical depth) is below this.
const CONVERGED: f64 = 2e-5;
/// Share by which the diagonal of the equations grows, so that directions without information move little.
const DAMPING: f64 = 1e-4;
const LEAST_DAMPING: f64 = 1e-9;
/// Surfaces seen at a smaller cosine give no reliable information.
const LEAST_COSINE: f32 = 0.2;

/// Alignment of two views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aligned {
    /// The estimated pose.
    pub target_from_source: Pose,
    /// `δᵀ · information · δ` is the mean squared displacement caused by a small motion δ, in the
    /// directions that the pixels constrain.
    ///
    /// δ is a rotation vector followed by a translation, in the target's axes.
    pub information: [[f64; 6]; 6],
    /// Number of source pixels used at the finest level.
    pub pixels: usize,
}

/// Spreads of the errors and the difference in brightness, estimated along with the pose.
#[derive(Clone, Copy)]
struct Spread {
    depth: f32,
    luma: f32,
    brighter: f32,
}

/// Parameters by which errors are measured.
#[derive(Clone, Copy)]
struct Errors {
    spread: Spread,
    /// Maximum distance of a point from the surface, as a share of the depth.
    gate: f32,
    /// Weight of luma.
    luma: f32,
    /// Depth in world units to which the spread of depths applies.
    typical: f32,
}

/// Sums over the pixels.
struct AlignmentSums {
    /// Weighted products of the derivatives.
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// Number of pixels.
    count: usize,
    /// For depth and luma: sums of the weights and of the weighted squared errors.
    depth: [f64; 2],
    luma: [f64; 2],
    /// Weighted sum of the errors of luma.
    brighter: f64,
}

impl AlignmentSums {
    fn new() -> Self {
        let (hessian, gradient) = (Matrix6::zeros(), Vector6::zeros());
        Self {
            hessian,
            gradient,
            count: 0,
            depth: [0.0; 2],
            luma: [0.0; 2],
            brighter: 0.0,
        }
    }
}

/// Aligns two views from an initial pose, coarse to fine.
///
/// Points are aligned to the surface in front of them, and their brightness to the image there
/// (after F. Steinbrücker, J. Sturm, D. Cremers, *Real-Time Visual Odometry from Dense RGB-D
/// Images*, ICCV Workshops 2011, and C. Kerl, J. Sturm, D. Cremers, *Dense Visual SLAM for RGB-D
/// Cameras*, IROS 2013). `None` if too little is seen by both. The content may leave the pose open,
/// as a single wall does; the information matrix shows this.
#[must_use]
pub fn align(source: &Pyramid, target: &Pyramid, guess: &Pose, coarsest: usize) -> Option<Aligned> {
    let mut pose = *guess;
    let typical = target.typical_depth;
    let mut spread = Spread {
        depth: 0.03,
        luma: 0.1,
        brighter: 0.0,
    };
    let mut last = None;
    for at in (0..=coarsest).rev() {
        let (source, target) = (&source.levels[at], &target.levels[at]);
        for _ in 0..STEPS[at] {
            let sums = sums(
                source,
                target,
                &pose,
                &Errors {
                    spread,
                    gate: GATES[at],
                    luma: LUMA[at],
                    typical,
                },
            );
            if sums.count < 100 {
                return None;
            }
            let mut damped = sums.hessian;
            let diagonal = sums.hessian.diagonal();
            damped.set_diagonal(
                &(diagonal * (1.0 + DAMPING)).add_scalar(LEAST_DAMPING * diagonal.max()),
            );
            let step = damped.cholesky()?.solve(&-sums.gradient);
            pose = moved(&pose, &step);
            spread = sums.spread(&spread);
            last = Some(sums);
            let (turn, shift) = (
                step.fixed_rows::<3>(0).amax(),
                step.fixed_rows::<3>(3).amax(),
            );
            if turn < CONVERGED && shift < CONVERGED * f64::from(typical) {
                break;
            }
        }
    }
    let sums = last?;
    // From squared errors over their variance to squared world units.
    let unit = f64::from(spread.depth * typical).powi(2) / sums.count as f64;
    let information = (sums.hessian * unit).into();
    Some(Aligned {
        target_from_source: pose,
        information,
        pixels: sums.count,
    })
}

impl AlignmentSums {
    fn spread(&self, before: &Spread) -> Spread {
        let of = |[weights, squares]: [f64; 2], before: f32, least: f32| {
            if weights > 0.0 {
                ((squares / weights).sqrt() as f32).max(least)
            } else {
                before
            }
        };
        Spread {
            depth: of(self.depth, before.depth, LEAST_SPREAD[0]),
            luma: of(self.luma, before.luma, LEAST_SPREAD[1]),
            brighter: before.brighter
                + if self.luma[0] > 0.0 {
                    (self.brighter / self.luma[0]) as f32
                } else {
                    0.0
                },
        }
    }
}

/// Sums over one row of pixels, where single precision is sufficient: six rows of products with the
/// derivatives, then the error.
#[derive(Default)]
struct RowSums([f32x8; 6]);

impl RowSums {
    /// Adds derivatives by rotation and translation with their error, all divided by the spread.
    #[inline]
    fn add(&mut self, turn: Vec3, shift: Vec3, error: f32, weight: f32) {
        let row = [
            turn.x, turn.y, turn.z, shift.x, shift.y, shift.z, error, 0.0,
        ];
        let values = f32x8::from(row);
        for (sum, by) in self.0.iter_mut().zip(row) {
            *sum += f32x8::splat(weight * by) * values;
        }
    }

    fn flush(&self, sums: &mut AlignmentSums) {
        for (i, row) in self.0.iter().enumerate() {
            let row = row.to_array();
            for (j, &value) in row[..6].iter().enumerate() {
                sums.hessian[(i, j)] += f64::from(value);
            }
            sums.gradient[i] += f64::from(row[6]);
        }
    }
}

fn sums(
    source: &PyramidLevel,
    target: &PyramidLevel,
    pose: &Pose,
    errors: &Errors,
) -> AlignmentSums {
    let target_from_source = Isometry::from(pose);
    let mut sums = AlignmentSums::new();
    for y in 0..source.height {
        let mut row = RowSums::default();
        for x in 0..source.width {
            let pixel = y * source.width + x;
            let depth = source.depths[pixel];
            if depth > 0.0 {
                let point = SourcePoint {
                    position: target_from_source.transform(source.ray(x, y) * depth),
                    grey: source.grey[pixel],
                };
                add_point(&mut sums, &mut row, target, point, errors);
            }
        }
        row.flush(&mut sums);
    }
    sums
}

/// A point of the source.
#[derive(Clone, Copy)]
struct SourcePoint {
    /// Position in the target's axes.
    position: Vec3,
    /// Brightness in the source's image.
    grey: f32,
}

/// Adds the contribution of a source point.
#[inline]
fn add_point(
    sums: &mut AlignmentSums,
    row: &mut RowSums,
    target: &PyramidLevel,
    point: SourcePoint,
    errors: &Errors,
) {
    let SourcePoint {
        position: point,
        grey,
    } = point;
    let Errors {
        spread,
        gate,
        luma,
        typical,
    } = *errors;
    let Some(at_px) = target.project(point) else {
        return;
    };
    let pixel = at_px.y as usize * target.width + at_px.x as usize;
    let depth = target.depths[pixel];
    if depth <= 0.0 || (depth - point.z).abs() > gate * depth {
        return;
    }
    let normal = target.normals[pixel];
    let ray = target.ray(at_px.x as usize, at_px.y as usize);
    if normal.dot(ray) > -LEAST_COSINE * ray.length() {
        return;
    }
    sums.count += 1;
    // The scatter of a sensor's depths grows with their square.
    let scatter = spread.depth * depth * depth / typical;
    let error = normal.dot(point - ray * depth) / scatter;
    let weight = t_weight(error);
    row.add(
        point.cross(normal) / scatter,
        normal / scatter,
        error,
        weight,
    );
    sums.depth[0] += 1.0;
    sums.depth[1] += f64::from(weight * (error * spread.depth).powi(2));
    let Some((seen, slope)) = target.grey_at(at_px) else {
        return;
    };
    let raw = seen - grey - spread.brighter;
    let error = raw / spread.luma;
    let weight = t_weight(error);
    // The slope of luma in the target's image by motions of the point.
    let scaled = slope * target.focal / (point.z * spread.luma);
    let by = Vec3::new(
        scaled.x,
        scaled.y,
        -(scaled.x * point.x + scaled.y * point.y) / point.z,
    );
    row.add(point.cross(by), by, error, luma * weight);
    sums.luma[0] += 1.0;
    sums.luma[1] += f64::from(weight * raw * raw);
    sums.brighter += f64::from(weight * raw);
}

/// Returns the weight of an error divided by its spread.
fn t_weight(error: f32) -> f32 {
    (FREEDOM + 1.0) / (FREEDOM + error * error)
}

fn moved(pose: &Pose, step: &Vector6<f64>) -> Pose {
    let rotation = DQuat::from_scaled_axis(DVec3::new(step[0], step[1], step[2]));
    Pose {
        rotation,
        translation: DVec3::new(step[3], step[4], step[5]),
    }
    .compose(pose)
}
