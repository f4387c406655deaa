//! The model that is being grown, and the options.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::sfm::{
    Correspondences, IntrinsicsPrior, KeypointId, MapProblem, ModelPoint, SparseModel,
};
use ostra_core::job::Progress;
use ostra_geometry::{Pose, RayObservation};

/// Options of incremental mapping.
///
/// The defaults follow Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapperOptions {
    /// Matches that the first pair must have.
    pub first_pair_matches: usize,
    /// Median angle between the rays of the first pair's matches, in radians.
    pub first_pair_parallax: f64,
    /// Observations with a reprojection error up to this, in pixels, support a camera's pose.
    pub pose_error_px: f64,
    /// Minimum number of observations that support a camera's pose.
    pub pose_inliers: usize,
    /// Minimum share of an image's observations that support its pose, 0–1.
    pub pose_inlier_share: f64,
    /// Observations with a larger reprojection error, in pixels, are dropped.
    pub max_error_px: f64,
    /// Smallest angle between two rays of a point, in radians.
    pub min_angle: f64,
    /// Number of images whose poses are adjusted together with a new one.
    pub local_images: usize,
    /// Growth of the number of images or points after which all is adjusted.
    pub global_growth: f64,
    /// The same for a large model.
    pub large_growth: f64,
    /// Number of images from which a model is large: it is then adjusted less often, and with a
    /// part of the observations of points that many images see.
    pub large_images: usize,
    /// Models with fewer images are not kept.
    pub min_model_images: usize,
    /// Models with fewer points are not kept.
    pub min_model_points: usize,
    /// Seed of all random choices.
    pub seed: u64,
}

impl Default for MapperOptions {
    fn default() -> Self {
        Self {
            first_pair_matches: 100,
            first_pair_parallax: 16f64.to_radians(),
            pose_error_px: 12.0,
            pose_inliers: 30,
            pose_inlier_share: 0.25,
            max_error_px: 4.0,
            min_angle: 1.5f64.to_radians(),
            local_images: 6,
            global_growth: 1.1,
            large_growth: 1.25,
            large_images: 60,
            min_model_images: 2,
            min_model_points: 60,
            seed: 0,
        }
    }
}

/// A growing model, with the data that is updated along with it.
pub(super) struct Mapper<'a> {
    pub problem: &'a MapProblem,
    pub links: &'a Correspondences,
    pub options: &'a MapperOptions,
    pub progress: &'a Progress,
    pub model: SparseModel,
    /// Images that may not be placed because they are in another model.
    pub closed: Vec<bool>,
    /// By camera, whether its focal length is more than a guess.
    pub focal_known: Vec<bool>,
    /// By camera, whether its lens is assumed to have no distortion.
    pub straight: Vec<bool>,
    /// Keypoints on the plane z = 1, by image.
    rays: Vec<Vec<DVec2>>,
    /// By image and keypoint, how many of its matches see a point.
    support: Vec<Vec<u16>>,
}

impl<'a> Mapper<'a> {
    pub fn new(
        problem: &'a MapProblem,
        links: &'a Correspondences,
        options: &'a MapperOptions,
        progress: &'a Progress,
    ) -> Self {
        let model = SparseModel::new(problem);
        let mut mapper = Self {
            problem,
            links,
            options,
            progress,
            model,
            closed: vec![false; problem.images.len()],
            focal_known: problem
                .cameras
                .iter()
                .map(|camera| camera.source != IntrinsicsPrior::Guessed)
                .collect(),
            straight: vec![false; problem.cameras.len()],
            rays: vec![Vec::new(); problem.images.len()],
            support: problem
                .images
                .iter()
                .map(|image| vec![0; image.keypoints.len()])
                .collect(),
        };
        (0..problem.cameras.len()).for_each(|camera| mapper.cast_rays(camera));
        mapper
    }

    /// Takes over a model of the same problem, in which images outside it may have more keypoints now.
    pub fn adopt(&mut self, standing: &SparseModel) {
        self.model.cameras.clone_from(&standing.cameras);
        (0..self.problem.cameras.len()).for_each(|camera| self.cast_rays(camera));
        for image in standing.placed() {
            self.model.poses[image as usize] = standing.poses[image as usize];
            self.focal_known[self.problem.images[image as usize].camera] = true;
        }
        for (_, point) in standing.points() {
            self.add_point(point.position, point.track.clone());
        }
    }

    /// Computes the undistorted keypoints of a camera's images again.
    pub fn cast_rays(&mut self, camera: usize) {
        let intrinsics = self.model.cameras[camera];
        let images = self.problem.images.par_iter().zip(&mut self.rays);
        images
            .filter(|(image, _)| image.camera == camera)
            .for_each(|(image, rays)| {
                let keypoints = image.keypoints.iter();
                rays.clear();
                rays.extend(keypoints.map(|&at_px| intrinsics.unproject(at_px)));
            });
    }

    pub fn at_px(&self, keypoint: KeypointId) -> DVec2 {
        self.problem.images[keypoint.image as usize].keypoints[keypoint.index as usize]
    }

    /// Returns an undistorted keypoint on the plane z = 1.
    pub fn ray(&self, keypoint: KeypointId) -> DVec2 {
        self.rays[keypoint.image as usize][keypoint.index as usize]
    }

    /// Returns the observation of a keypoint by its image, if that is placed.
    pub fn observation(&self, keypoint: KeypointId) -> Option<RayObservation<'_>> {
        let image = keypoint.image as usize;
        let at_plane = self.ray(keypoint);
        let camera_from_world = self.model.poses[image]
            .as_ref()
            .filter(|_| at_plane.is_finite())?;
        let camera = &self.model.cameras[self.problem.images[image].camera];
        Some(RayObservation {
            camera,
            camera_from_world,
            at_px: self.at_px(keypoint),
            at_plane,
        })
    }

    /// Returns the reprojection error of a point in pixels; infinite if the image does not see it.
    pub fn error_px(&self, keypoint: KeypointId, position: DVec3) -> f64 {
        let Some(pose) = self.model.poses[keypoint.image as usize] else {
            return f64::INFINITY;
        };
        let camera = &self.model.cameras[self.problem.images[keypoint.image as usize].camera];
        let seen = camera.project(pose.transform(position));
        seen.map_or(f64::INFINITY, |at| at.distance(self.at_px(keypoint)))
    }

    /// Returns whether any two of the keypoints see the position under a large enough angle.
    pub fn has_parallax(&self, track: &[KeypointId], position: DVec3) -> bool {
        let rays: Vec<DVec3> = track
            .iter()
            .filter_map(|keypoint| self.model.poses[keypoint.image as usize])
            .map(|pose| (position - pose.centre()).normalize_or_zero())
            .collect();
        let limit = self.options.min_angle.cos();
        rays.iter()
            .enumerate()
            .any(|(i, a)| rays[..i].iter().any(|b| a.dot(*b) < limit))
    }

    /// Returns whether an image may still be placed.
    pub fn is_open(&self, image: u32) -> bool {
        !self.closed[image as usize] && !self.model.is_placed(image)
    }

    /// Returns whether so many images are placed that adjustments have to be bounded.
    pub fn is_large(&self) -> bool {
        self.model.placed().count() >= self.options.large_images
    }

    pub fn place(&mut self, image: u32, camera_from_world: Pose) {
        self.model.poses[image as usize] = Some(camera_from_world);
    }

    /// Removes an image and its observations.
    pub fn displace(&mut self, image: u32) {
        for index in 0..self.problem.images[image as usize].keypoints.len() as u32 {
            let keypoint = KeypointId { image, index };
            if self.model.point_of(keypoint).is_some() {
                self.detach(keypoint);
            }
        }
        self.model.poses[image as usize] = None;
    }

    /// Returns by keypoint of an image how many of its matches see a point.
    pub fn support(&self, image: u32) -> &[u16] {
        &self.support[image as usize]
    }

    pub fn add_point(&mut self, position: DVec3, track: Vec<KeypointId>) -> u32 {
        for &keypoint in &track {
            self.count_support(keypoint, 1);
        }
        self.model.add(position, track)
    }

    pub fn extend_point(&mut self, point: u32, keypoint: KeypointId) {
        self.count_support(keypoint, 1);
        self.model.extend(point, keypoint);
    }

    pub fn detach(&mut self, keypoint: KeypointId) {
        self.count_support(keypoint, -1);
        self.model.detach(keypoint);
    }

    pub fn remove_point(&mut self, point: u32) -> Option<ModelPoint> {
        let removed = self.model.remove(point)?;
        for &keypoint in &removed.track {
            self.count_support(keypoint, -1);
        }
        Some(removed)
    }

    fn count_support(&mut self, keypoint: KeypointId, by: i16) {
        for link in self.links.of(keypoint) {
            let count = &mut self.support[link.image as usize][link.index as usize];
            *count = count.saturating_add_signed(by);
        }
    }
}
