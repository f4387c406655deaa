//! Calibration of a recording: the parallax that most pairs of frames agree on.

use std::fmt;

use glam::{Vec2, Vec3};
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::pairs::{AlignedPair, Recording, Shared};
use super::parallax::{Matrix, Parallax, UNKNOWNS, Vector};
use crate::rgbd::pyramid::{LEVELS, PyramidLevel};
use ostra_core::job::{Progress, Stopped};
use ostra_core::statistics::upper_median;
use ostra_frames::{DepthCamera, DepthSource, Frame, FrameStore};
use ostra_geometry::{Camera, Distortion};

/// With fewer pairs of frames there is no result.
const LEAST_PAIRS: usize = 6;
/// A parallax is only accepted if it reduces the differences in brightness to this share, on pairs
/// that it was not fitted to.
const BETTER: f64 = 0.85;
/// Maximum disagreement of two halves of the pairs about the image's corners, as a share of how far these move.
///
/// Both halves together are then off by about half as much.
const AGREE: f64 = 0.5;
/// Maximum expected error of the corners by all pairs, as the same share.
///
/// A camera that hardly moves gives little information, and both halves then agree on little.
const CONFIDENT: f64 = 0.33;

/// The cameras of a sensor whose images are not aligned with its depths.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Numbers of the frames taken by this sensor, ascending.
    pub frames: Vec<usize>,
    /// Intrinsics of the images.
    pub image: Camera,
    /// The camera of the depths; its intrinsics are those that were given for both.
    pub depth: DepthCamera,
}

/// Estimates the cameras of images that are not aligned with their depths.
///
/// Most sensors have two cameras next to each other, and many recordings contain their images
/// unaligned. Only frames are considered whose depth has no camera of its own. The depths of some
/// pairs of frames are aligned; under the right parallax, the images then show the same where the
/// depths do.
///
/// A parallax is accepted only if both halves of the pairs find nearly the same, each half improves
/// by the result of the other, and all pairs together leave little uncertainty. Frames with the
/// same intrinsics as others with an earlier result are assumed to be from the same sensor. A given
/// lens distortion means that the image's camera was calibrated: such frames stay unchanged.
///
/// # Errors
/// If stopped.
pub fn calibrate(
    frames: &[Frame],
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<Calibration>, Stopped> {
    let mut found = Vec::new();
    for (given, numbers) in lenses(frames) {
        let cameras = match of_same_sensor(frames, &given) {
            Some(known) => Some(known),
            None => {
                let recording = Recording {
                    frames,
                    numbers: &numbers,
                    camera: given,
                    store,
                };
                parallax(&recording, progress)?.map(|found| found.cameras(&given))
            }
        };
        found.extend(cameras.map(|(image, depth)| Calibration {
            frames: numbers,
            image,
            depth,
        }));
    }
    Ok(found)
}

impl Calibration {
    /// Sets the cameras of the frames.
    pub fn apply(&self, frames: &mut [Frame]) {
        for &number in &self.frames {
            let frame = &mut frames[number];
            if let (Some(camera), Some(DepthSource::Sensor { camera: own, .. })) =
                (&mut frame.camera, &mut frame.depth)
            {
                camera.intrinsics = self.image;
                *own = Some(Box::new(self.depth));
            }
        }
    }
}

impl fmt::Display for Calibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let focal = |camera: &Camera| 0.5 * (camera.focal_px.x + camera.focal_px.y);
        write!(
            f,
            "the images' camera has a focal length of {:.0} px, not {:.0}, and is {:.3} from the depth camera",
            focal(&self.image),
            focal(&self.depth.intrinsics),
            self.depth.image_from_depth.translation.length()
        )
    }
}

fn depth_camera(frame: &Frame) -> Option<&DepthCamera> {
    match frame.depth.as_ref()? {
        DepthSource::Sensor { camera, .. } => camera.as_deref(),
        DepthSource::Estimated { .. } => None,
    }
}

/// Returns the cameras of a sensor with these depth intrinsics, if they were estimated earlier.
///
/// Cameras given for some frames do not count, because they say nothing about others.
fn of_same_sensor(frames: &[Frame], given: &Camera) -> Option<(Camera, DepthCamera)> {
    let of_frame = |frame: &Frame| {
        let depth =
            depth_camera(frame).filter(|depth| depth.estimated && depth.intrinsics == *given)?;
        Some((frame.camera?.intrinsics, *depth))
    };
    frames.iter().find_map(of_frame)
}

/// Returns the frames with a sensor's depth that has no camera of its own, by their intrinsics.
fn lenses(frames: &[Frame]) -> Vec<(Camera, Vec<usize>)> {
    let mut lenses: Vec<(Camera, Vec<usize>)> = Vec::new();
    for (number, frame) in frames.iter().enumerate() {
        let given = frame.camera.as_ref().filter(|camera| !camera.estimated);
        let Some(camera) = given.map(|camera| camera.intrinsics) else {
            continue;
        };
        if !frame.has_sensor_depth()
            || depth_camera(frame).is_some()
            || camera.distortion != Distortion::None
        {
            continue;
        }
        match lenses.iter_mut().find(|(lens, _)| *lens == camera) {
            Some((_, numbers)) => numbers.push(number),
            None => lenses.push((camera, vec![number])),
        }
    }
    lenses
}

/// Returns the parallax of a recording if it is reliable.
fn parallax(recording: &Recording<'_>, progress: &Progress) -> Result<Option<Parallax>, Stopped> {
    let pairs = recording.pairs(progress)?;
    if pairs.len() < LEAST_PAIRS {
        return Ok(None);
    }
    let all: Vec<&AlignedPair> = pairs.iter().collect();
    let (found, covariance) = fit(&all);
    let halves = [0, 1].map(|odd| {
        pairs
            .iter()
            .skip(odd)
            .step_by(2)
            .collect::<Vec<&AlignedPair>>()
    });
    let of_half = halves.each_ref().map(|half| fit(half).0);
    let is_better = |pairs: &[&AlignedPair], parallax: &Parallax| {
        let [with, without] = errors(pairs, parallax);
        with < BETTER * without
    };
    let typical = pairs.iter().map(AlignedPair::typical_depth).sum::<f32>() / pairs.len() as f32;
    let apart = |a: &Parallax, b: &Parallax| a.apart(b, &recording.camera, typical);
    let size = apart(&found, &Parallax::default());
    let agree = apart(&of_half[0], &of_half[1]) < AGREE * size;
    let confidence = found.uncertainty(&covariance, &recording.camera, typical) < CONFIDENT * size;
    let better = is_better(&halves[1], &of_half[0])
        && is_better(&halves[0], &of_half[1])
        && is_better(&all, &found);
    Ok((agree && confidence && better).then_some(found))
}

/// The unknowns of all pairs, then those of the pair's own pose.
type Own = SVector<f64, { UNKNOWNS + OF_POSE }>;
type OwnMatrix = SMatrix<f64, { UNKNOWNS + OF_POSE }, { UNKNOWNS + OF_POSE }>;
type PoseMatrix = SMatrix<f64, OF_POSE, OF_POSE>;

/// Maximum number of steps per level.
const STEPS: usize = 20;
/// A level has converged if the step, divided by the usual sizes, is below this.
const CONVERGED: f64 = 1e-4;
/// Degrees of freedom of the t-distribution that errors are assumed to follow.
const FREEDOM: f32 = 5.0;
/// Prior standard deviations of the unknowns.
///
/// A shifted principal point and a shifted camera have the same effect to first order, so that the
/// usual size of both has to decide between them: sensors have their cameras some centimetres
/// apart, and their principal points off by some pixels.
///
/// The price is that the shift of the camera is pulled towards zero: of a Kinect's 2.5 cm a whole
/// recording gives 1.1 cm, and 0.7 cm across ([`LAID_OFF`]). Objects much nearer than most are then
/// off by some pixels.
const USUAL: [f64; UNKNOWNS] = [0.1, 0.02, 0.005, 0.005, 0.03, 0.03];
/// Number of unknowns of the relative pose of a pair.
const OF_POSE: usize = 6;
/// Information that holds a pose where neither depth nor image does: one over the square of radians and world units.
const LEAST_HELD: f64 = 1.0;
/// Expected error of an alignment by depth alone, in each direction of the pose, divided by the typical depth.
///
/// With poses taken as exact, a whole recording gives 2.5 cm for the camera's shift and 0.4 across,
/// nearer to the truth. But the first 15 frames of it then put the camera 10 cm down, and seven
/// frames that hardly moved gave a focal length of 555 px instead of 526 with both halves agreeing.
/// With this allowance the remaining uncertainty shows that so few frames are not enough.
const LAID_OFF: f64 = 1e-3;
/// Number of pixels that carry as much information as one independent of all others.
const ALIKE: f64 = 300.0;
/// The finest level used.
const LEVEL: usize = 1;
/// Minimum standard deviation of luma.
const LEAST_SPREAD: f32 = 4e-3;

/// Fits the parallax under which the images of pairs show the same where their depths do.
///
/// Gauss–Newton steps on brightness, coarse to fine. Without information it stays at the prior.
/// Also returns the covariance of its unknowns, by the pixels used.
#[must_use]
pub fn fit(pairs: &[&AlignedPair]) -> (Parallax, Matrix) {
    let usual = Vector::from(USUAL);
    let held = usual.map(|spread| spread.powi(-2));
    let mut unknowns = Vector::zeros();
    let mut covariance = Matrix::from_diagonal(&usual.map(|spread| spread * spread));
    let parallax = |unknowns: &Vector| Parallax::of(std::array::from_fn(|i| unknowns[i] as f32));
    for level in (LEVEL..LEVELS).rev() {
        let shared: Vec<Vec<Shared>> = pairs.par_iter().map(|pair| pair.shared(level)).collect();
        for _ in 0..STEPS {
            let at = parallax(&unknowns);
            let of_pair = |(pair, shared): (&&AlignedPair, &Vec<Shared>)| {
                CalibrationSums::of(pair, shared, level, &at)
            };
            let sums: Vec<CalibrationSums> = pairs.par_iter().zip(&shared).map(of_pair).collect();
            let hessian = sums
                .iter()
                .fold(Matrix::from_diagonal(&held), |all, one| all + one.hessian);
            let gradient = sums
                .iter()
                .fold(held.component_mul(&unknowns), |all, one| all + one.gradient);
            let Some(solved) = hessian.cholesky() else {
                break;
            };
            let step = solved.solve(&-gradient);
            unknowns += step;
            covariance = solved.inverse();
            if step.component_div(&usual).amax() < CONVERGED {
                break;
            }
        }
    }
    (parallax(&unknowns), covariance)
}

/// Measures how much luma differs where the depths of pairs show the same, under a parallax and under none.
///
/// The difference is relative to the standard deviation of luma, over the points that are seen
/// under both. A pair that loses more than half of them counts as no better.
#[must_use]
pub fn errors(pairs: &[&AlignedPair], parallax: &Parallax) -> [f64; 2] {
    let of_pair = |pair: &&AlignedPair| {
        let shared = pair.shared(LEVEL);
        let reported = |shared: &Shared, parallax: &Parallax| {
            let luma = |view: usize| seen(pair, LEVEL, shared, view, parallax).map(|seen| seen.0);
            Some([luma(0)?, luma(1)?])
        };
        let both = shared.iter().filter_map(|shared| {
            Some((
                reported(shared, parallax)?,
                reported(shared, &Parallax::default())?,
            ))
        });
        let (with, without): (Vec<[f32; 2]>, Vec<[f32; 2]>) = both.unzip();
        let before = unlikeness(&without);
        [
            if 2 * with.len() < shared.len() {
                before
            } else {
                unlikeness(&with)
            },
            before,
        ]
    };
    let all: Vec<[f64; 2]> = pairs.par_iter().map(of_pair).collect();
    [0, 1]
        .map(|which| all.iter().map(|errors| errors[which]).sum::<f64>() / all.len().max(1) as f64)
}

/// Returns the mean difference of luma after subtracting its mean, divided by the standard
/// deviation in the first view of both.
fn unlikeness(points: &[[f32; 2]]) -> f64 {
    let mean = |value: &dyn Fn([f32; 2]) -> f64| {
        points.iter().map(|&point| value(point)).sum::<f64>() / points.len().max(1) as f64
    };
    let brighter = mean(&|[a, b]| f64::from(b - a));
    let middle = mean(&|[a, _]| f64::from(a));
    let spread = mean(&|[a, _]| (f64::from(a) - middle).powi(2)).sqrt();
    mean(&|[a, b]| (f64::from(b - a) - brighter).abs()) / spread.max(f64::from(LEAST_SPREAD))
}

/// Returns luma where a view of a pair sees a point, with its slope on the plane at depth 1; `None`
/// if it does not see it.
fn seen(
    pair: &AlignedPair,
    level: usize,
    shared: &Shared,
    view: usize,
    parallax: &Parallax,
) -> Option<(f32, Vec2)> {
    let level: &PyramidLevel = &pair.views[view].levels[level];
    let at_px = parallax.project(shared[view]) * level.focal + level.principal;
    level
        .grey_at(at_px)
        .map(|(luma, slope)| (luma, slope * level.focal))
}

/// Sums over the points of a pair.
struct CalibrationSums {
    hessian: Matrix,
    gradient: Vector,
}

impl CalibrationSums {
    /// Computes the sums of one pair.
    ///
    /// A pair is weighted by its own spread and difference in brightness. Its pose may be slightly
    /// off, the more so the less the depth constrains it. Otherwise the error of the pose would be
    /// taken for parallax, and for a certain one.
    fn of(pair: &AlignedPair, shared: &[Shared], level: usize, parallax: &Parallax) -> Self {
        let turn = pair.turn_of_image();
        let reported = |shared: &Shared| {
            let seen = |view: usize| seen(pair, level, shared, view, parallax);
            let ((a, slope_a), (b, slope_b)) = (seen(0)?, seen(1)?);
            // How a small shift in the source's image appears in the target's.
            let transferred = turn * (shared[0].z / shared[1].z);
            // The mean of both images' slopes. With the slope of one alone, the noise of texture
            // that is not yet aligned exceeds the signal, and the fit stops halfway (546 px for a
            // focal length of 527).
            let slope = 0.5 * (slope_b + transferred.inverse().transpose() * slope_a);
            let [by_a, by_b] = shared.map(|point: Vec3| parallax.slopes(point));
            let by_pose = parallax.slopes_of_pose(shared[1]);
            let by = Own::from_fn(|i, _| {
                let moved = if i < UNKNOWNS {
                    by_b[i] - transferred * by_a[i]
                } else {
                    by_pose[i - UNKNOWNS]
                };
                f64::from(slope.dot(moved))
            });
            Some((b - a, by))
        };
        let reported: Vec<(f32, Own)> = shared.iter().filter_map(reported).collect();
        let (brighter, spread) = middle(reported.iter().map(|reported| reported.0).collect());
        let (mut hessian, mut gradient) = (OwnMatrix::zeros(), Own::zeros());
        for (difference, by) in reported {
            let error = (difference - brighter) / spread;
            let weight = f64::from((FREEDOM + 1.0) / (FREEDOM + error * error)) / ALIKE;
            let by = by / f64::from(spread);
            hessian += weight * by * by.transpose();
            gradient += weight * f64::from(error) * by;
        }
        Self::without_pose(&hessian, &gradient, &held(pair))
    }

    /// Returns the information about the parallax after eliminating the error of the pose; zero if
    /// a value is not finite.
    fn without_pose(hessian: &OwnMatrix, gradient: &Own, held: &PoseMatrix) -> Self {
        let shared = hessian.fixed_view::<OF_POSE, UNKNOWNS>(UNKNOWNS, 0);
        let Some(of_pose) =
            (hessian.fixed_view::<OF_POSE, OF_POSE>(UNKNOWNS, UNKNOWNS) + held).cholesky()
        else {
            return Self {
                hessian: Matrix::zeros(),
                gradient: Vector::zeros(),
            };
        };
        let by_pose = of_pose.solve(&shared).transpose();
        Self {
            hessian: hessian.fixed_view::<UNKNOWNS, UNKNOWNS>(0, 0) - by_pose * shared,
            gradient: gradient.fixed_rows::<UNKNOWNS>(0)
                - by_pose * gradient.fixed_rows::<OF_POSE>(UNKNOWNS),
        }
    }
}

/// Returns how strongly depth constrains the pose of a pair.
fn held(pair: &AlignedPair) -> PoseMatrix {
    let laid_off = LAID_OFF * f64::from(pair.typical_depth());
    let reported = PoseMatrix::from_fn(|row, column| pair.information()[row][column]);
    reported / (laid_off * laid_off) + PoseMatrix::identity() * LEAST_HELD
}

/// Returns the median, and a standard deviation from the median distance to it.
fn middle(mut values: Vec<f32>) -> (f32, f32) {
    let Some(median) = upper_median(&mut values) else {
        return (0.0, LEAST_SPREAD);
    };
    values
        .iter_mut()
        .for_each(|value| *value = (*value - median).abs());
    let spread = 1.4826 * upper_median(&mut values).unwrap_or(0.0);
    (median, spread.max(LEAST_SPREAD))
}
