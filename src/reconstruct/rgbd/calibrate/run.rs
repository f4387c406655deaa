use std::fmt;

use super::fit::{errors, fit};
use super::pairs::{Pair, Recording};
use super::parallax::Parallax;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::{DepthCamera, DepthSource, Frame, FrameStore};
use ostra_geometry::{Camera, Distortion};

/// Pairs of frames without which nothing is told.
const LEAST_PAIRS: usize = 6;
/// What differences in brightness must come down to, on pairs that were not fitted to, for a parallax to be believed.
const BETTER: f64 = 0.85;
/// How far apart two halves of the pairs may put the picture's corners, as a share of how far these move: both together are
/// then off by about half as much.
const AGREE: f64 = 0.5;
/// How far off they must be expected to lie by all pairs, as the same share: a camera that hardly moves tells little, and both halves
/// the same little.
const SURE: f64 = 0.33;

/// The camera of pictures that do not lie on their depths.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// Numbers of the frames that were taken with it, ascending.
    pub frames: Vec<usize>,
    /// Intrinsics of the pictures.
    pub picture: Camera,
    /// The camera of the depths, whose intrinsics are those that were given for both.
    pub depth: DepthCamera,
}

/// Finds the cameras of pictures that do not lie on their depths, for frames whose depth has no camera of its own: two
/// cameras stand side by side in most sensors, and many recordings hold what they saw as they saw it. The depths of some
/// pairs of frames are laid onto each other; under the right parallax the pictures then show the same where the depths do.
/// It is believed only where half of the pairs finds nearly what the other half does, each is better by it on the other, and what
/// all tell leaves little open.
/// Frames that share the intrinsics of others for which this was found earlier are taken to be from the same sensor. A
/// given lens distortion tells that the picture's camera was calibrated: such frames are left as they are.
///
/// # Errors
/// When stopped.
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
        found.extend(cameras.map(|(picture, depth)| Calibration {
            frames: numbers,
            picture,
            depth,
        }));
    }
    Ok(found)
}

impl Calibration {
    /// Gives the frames their cameras.
    pub fn apply(&self, frames: &mut [Frame]) {
        for &number in &self.frames {
            let frame = &mut frames[number];
            if let (Some(camera), Some(DepthSource::Sensor { camera: own, .. })) =
                (&mut frame.camera, &mut frame.depth)
            {
                camera.intrinsics = self.picture;
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
            "the pictures' camera has a focal length of {:.0} px, not {:.0}, and stands {:.3} beside the depths'",
            focal(&self.picture),
            focal(&self.depth.intrinsics),
            self.depth.picture_from_depth.translation.length()
        )
    }
}

fn depth_camera(frame: &Frame) -> Option<&DepthCamera> {
    match frame.depth.as_ref()? {
        DepthSource::Sensor { camera, .. } => camera.as_deref(),
        DepthSource::Made { .. } => None,
    }
}

/// The cameras of picture and depth of a sensor whose depth camera has these intrinsics, where they were found earlier: what
/// is given for some frames says nothing of others.
fn of_same_sensor(frames: &[Frame], given: &Camera) -> Option<(Camera, DepthCamera)> {
    let of_frame = |frame: &Frame| {
        let depth =
            depth_camera(frame).filter(|depth| depth.estimated && depth.intrinsics == *given)?;
        Some((frame.camera?.intrinsics, *depth))
    };
    frames.iter().find_map(of_frame)
}

/// Frames with a sensor's depth that has no camera of its own, by their intrinsics.
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

/// The parallax of a recording, where it is beyond doubt.
fn parallax(recording: &Recording<'_>, progress: &Progress) -> Result<Option<Parallax>, Stopped> {
    let pairs = recording.pairs(progress)?;
    if pairs.len() < LEAST_PAIRS {
        return Ok(None);
    }
    let all: Vec<&Pair> = pairs.iter().collect();
    let (found, covariance) = fit(&all);
    let halves = [0, 1].map(|odd| pairs.iter().skip(odd).step_by(2).collect::<Vec<&Pair>>());
    let of_half = halves.each_ref().map(|half| fit(half).0);
    let is_better = |pairs: &[&Pair], parallax: &Parallax| {
        let [with, without] = errors(pairs, parallax);
        with < BETTER * without
    };
    let typical = pairs.iter().map(Pair::typical_depth).sum::<f32>() / pairs.len() as f32;
    let apart = |a: &Parallax, b: &Parallax| a.apart(b, &recording.camera, typical);
    let size = apart(&found, &Parallax::default());
    let agree = apart(&of_half[0], &of_half[1]) < AGREE * size;
    let sure = found.doubt(&covariance, &recording.camera, typical) < SURE * size;
    let better = is_better(&halves[1], &of_half[0])
        && is_better(&halves[0], &of_half[1])
        && is_better(&all, &found);
    Ok((agree && sure && better).then_some(found))
}
