use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};

use super::extract::ImageFeatures;
use super::request::SfmRequest;
use super::{IntrinsicsPrior, KeypointId, MapProblem, RegistrationStatus, SfmError, SparseModel};
use ostra_core::statistics::upper_median;
use ostra_frames::{Frame, FrameCamera, FrameStore};
use ostra_geometry::{
    AbsolutePoseOptions, Camera, Pose, estimate_absolute_pose, refine_absolute_pose,
};

/// Estimates poses of further frames in a map that stays fixed.
pub(super) struct Locator<'a> {
    pub request: &'a SfmRequest<'a>,
    pub problem: &'a MapProblem,
    pub model: &'a SparseModel,
    pub images: &'a [ImageFeatures],
}

/// Result for a frame between mapped ones.
pub(super) struct Located {
    pub camera: Option<FrameCamera>,
    pub outcome: RegistrationStatus,
    /// Observations that fit the pose; each keypoint and each point occurs once.
    pub seen: Vec<SeenPoint>,
}

impl Located {
    fn refused(outcome: RegistrationStatus) -> Self {
        Self {
            camera: None,
            outcome,
            seen: Vec::new(),
        }
    }
}

/// A keypoint of a frame that sees a point of the model.
#[derive(Debug, Clone, Copy)]
pub(super) struct SeenPoint {
    /// Index of the keypoint.
    keypoint: u32,
    pub at_px: DVec2,
    /// Number of the point in the model.
    pub point: u32,
    position: DVec3,
}

/// Model points that the matches of a frame lead to.
struct Observations {
    /// Pixels of the frame with the points that they see, each pair once.
    seen: Vec<SeenPoint>,
    /// The frame that shares most with it, and their number of matches.
    nearest: Option<(usize, usize)>,
}

/// Mapped frames on either side that a frame is matched with: first, and if these are not enough.
const REACH: [usize; 2] = [2, 8];
/// Observations with a reprojection error up to this, in pixels, refine the pose.
const FINE_ERROR_PX: f64 = 4.0;

impl Locator<'_> {
    /// Estimates the pose of a frame from its matches with mapped frames near it in the sequence.
    pub fn locate(&self, number: usize, store: &FrameStore) -> Result<Located, SfmError> {
        let frame = &self.request.frames[number];
        let query = self.request.frame_extractor(store).of_frame(number)?;
        if let Some(why) = query.unreadable {
            return Ok(Located::refused(RegistrationStatus::Unreadable { why }));
        }
        let mut outcome = RegistrationStatus::NoPair { nearest: None };
        for reach in REACH {
            let near = self.near(number, reach);
            let seen = self.observations(&query, &near)?;
            match self.pose(frame, &near, &seen) {
                Ok(located) => return Ok(located),
                Err(why) => outcome = why,
            }
        }
        Ok(Located::refused(outcome))
    }

    /// Returns the nearest placed images in the sequence, up to `reach` on either side.
    fn near(&self, number: usize, reach: usize) -> Vec<usize> {
        let mapped = self.request.mapped;
        let middle = mapped.partition_point(|&other| other < number);
        let is_placed = |&image: &usize| self.model.is_placed(image as u32);
        let before = (0..middle).rev().filter(is_placed).take(reach);
        let after = (middle..mapped.len()).filter(is_placed).take(reach);
        let mut near: Vec<usize> = before.chain(after).collect();
        near.sort_by_key(|&image| (mapped[image].abs_diff(number), image));
        near
    }

    fn observations(
        &self,
        query: &ImageFeatures,
        near: &[usize],
    ) -> Result<Observations, SfmError> {
        let mut seen: BTreeMap<(u32, u32), DVec3> = BTreeMap::new();
        let mut nearest: Option<(usize, usize)> = None;
        for &image in near {
            let matches = self
                .request
                .matcher
                .matches(&query.features, &self.images[image].features)?;
            if matches.len() > nearest.map_or(0, |(_, most)| most) {
                nearest = Some((self.request.mapped[image], matches.len()));
            }
            for (own, index) in matches {
                let point = self.model.point_of(KeypointId {
                    image: image as u32,
                    index,
                });
                if let Some((point, known)) =
                    point.and_then(|point| Some((point, self.model.point(point)?)))
                {
                    seen.insert((own, point), known.position);
                }
            }
        }
        let seen = seen
            .into_iter()
            .map(|((own, point), position)| SeenPoint {
                keypoint: own,
                at_px: query.features.keypoints[own as usize],
                point,
                position,
            })
            .collect();
        Ok(Observations { seen, nearest })
    }

    fn pose(
        &self,
        frame: &Frame,
        near: &[usize],
        observations: &Observations,
    ) -> Result<Located, RegistrationStatus> {
        let needed = self.request.mapper.pose_inliers;
        let Observations { seen, nearest } = observations;
        if seen.len() < needed {
            return Err(RegistrationStatus::FewPoints {
                seen: seen.len(),
                needed,
                nearest: *nearest,
            });
        }
        let (intrinsics, estimated) = self.intrinsics(frame, near);
        let pairs = seen.iter().map(|seen| (seen.at_px, seen.position));
        let (at_px, points): (Vec<DVec2>, Vec<DVec3>) = pairs.unzip();
        let options = AbsolutePoseOptions {
            max_error_px: self.request.mapper.pose_error_px,
            seed: self.request.mapper.seed,
            ..AbsolutePoseOptions::default()
        };
        let found = estimate_absolute_pose(&intrinsics, &at_px, &points, &options);
        let agreeing = found.as_ref().map_or(0, |pose| pose.inliers.len());
        let Some(found) = found.filter(|_| agreeing >= needed) else {
            return Err(RegistrationStatus::NoPose {
                seen: seen.len(),
                agreeing,
            });
        };
        let (pose, errors) = refined(&intrinsics, found.camera_from_world, &at_px, &points);
        let fitting = fitting(seen, &errors);
        let mut errors = errors;
        errors.retain(|&error| error <= FINE_ERROR_PX);
        let error_px = upper_median(&mut errors).unwrap_or(0.0);
        let camera = FrameCamera {
            intrinsics,
            camera_from_world: Some(pose),
            estimated,
        };
        Ok(Located {
            camera: Some(camera),
            outcome: RegistrationStatus::Placed {
                points: errors.len(),
                error_px,
            },
            seen: fitting,
        })
    }

    /// Returns the frame's given intrinsics, or those of the nearest mapped frame of the same size.
    fn intrinsics(&self, frame: &Frame, near: &[usize]) -> (Camera, bool) {
        let camera_of = |image: usize| self.problem.images[image].camera;
        let of_size =
            |camera: &Camera| (camera.width, camera.height) == (frame.width, frame.height);
        let alike = near
            .iter()
            .map(|&image| camera_of(image))
            .find(|&camera| of_size(&self.model.cameras[camera]));
        match (
            frame.camera.filter(|camera| !camera.estimated),
            alike.or(near.first().map(|&image| camera_of(image))),
        ) {
            (Some(given), _) => (given.intrinsics, false),
            (None, Some(camera)) => (
                self.model.cameras[camera],
                self.problem.cameras[camera].source != IntrinsicsPrior::Given,
            ),
            (None, None) => (self.model.cameras[0], true),
        }
    }
}

/// Returns the observations that fit the pose, in their order; the best ones where a keypoint or a
/// point occurs more than once.
fn fitting(seen: &[SeenPoint], errors_px: &[f64]) -> Vec<SeenPoint> {
    let mut ranked: Vec<usize> = (0..seen.len()).collect();
    ranked.retain(|&at| errors_px[at] <= FINE_ERROR_PX);
    ranked.sort_by(|&a, &b| errors_px[a].total_cmp(&errors_px[b]).then(a.cmp(&b)));
    let (mut keypoints, mut points) = (BTreeSet::new(), BTreeSet::new());
    ranked.retain(|&at| {
        let SeenPoint {
            keypoint, point, ..
        } = seen[at];
        !keypoints.contains(&keypoint) && points.insert(point) && keypoints.insert(keypoint)
    });
    ranked.sort_unstable();
    ranked.into_iter().map(|at| seen[at]).collect()
}

/// Refines the pose over the observations that fit it well; also returns the error of each in pixels.
fn refined(camera: &Camera, start: Pose, at_px: &[DVec2], points: &[DVec3]) -> (Pose, Vec<f64>) {
    let error = |pose: &Pose, (at_px, point): (&DVec2, &DVec3)| {
        camera
            .project(pose.transform(*point))
            .map_or(f64::INFINITY, |at| at.distance(*at_px))
    };
    let fitting = at_px
        .iter()
        .zip(points)
        .filter(|&seen| error(&start, seen) <= FINE_ERROR_PX);
    let (fine_px, fine_points): (Vec<DVec2>, Vec<DVec3>) = fitting.map(|(&at, &x)| (at, x)).unzip();
    let pose = if fine_px.len() < 6 {
        start
    } else {
        refine_absolute_pose(camera, &start, &fine_px, &fine_points)
    };
    let errors = at_px.iter().zip(points).map(|seen| error(&pose, seen));
    (pose, errors.collect())
}
