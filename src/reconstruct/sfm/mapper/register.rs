use glam::{DVec2, DVec3};

use super::state::Mapper;
use crate::sfm::KeypointId;
use ostra_geometry::{
    AbsolutePose, AbsolutePoseOptions, Camera, estimate_absolute_pose,
    estimate_absolute_pose_and_focal,
};

/// Why an image could not be placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal {
    /// Keypoints matched with one that sees a point of the model.
    pub seen: usize,
    /// Of these, how many agreed on a pose.
    pub agreeing: usize,
}

/// Focal lengths that are tried where nothing is known, relative to the guess.
const FOCAL_FACTORS: [f64; 9] = [1.0, 0.84, 1.19, 0.71, 1.41, 0.59, 1.68, 0.5, 2.0];

impl Mapper<'_> {
    /// Finds an image's pose from the points that it sees, and adds it to their sightings.
    pub fn register(&mut self, image: u32) -> Result<(), Refusal> {
        let seen = self.points_in_view(image);
        let (at_px, positions): (Vec<DVec2>, Vec<DVec3>) = seen
            .iter()
            .filter_map(|&(index, point)| {
                Some((
                    self.at_px(KeypointId { image, index }),
                    self.model.point(point)?.position,
                ))
            })
            .unzip();
        let camera = self.problem.images[image as usize].camera;
        let found = self.pose(image, camera, &at_px, &positions);
        let agreeing = found
            .as_ref()
            .map_or(0, |(_, pose)| distinct(&seen, &pose.inliers));
        let distinct_seen = distinct(&seen, &(0..seen.len() as u32).collect::<Vec<_>>());
        let enough = (self.options.pose_inlier_share * distinct_seen as f64)
            .max(self.options.pose_inliers as f64);
        let Some((intrinsics, pose)) = found.filter(|_| agreeing as f64 >= enough) else {
            return Err(Refusal {
                seen: distinct_seen,
                agreeing,
            });
        };
        if self.model.cameras[camera] != intrinsics {
            self.model.cameras[camera] = intrinsics;
            self.cast_rays(camera);
        }
        self.focal_known[camera] = true;
        self.place(image, pose.camera_from_world);
        for &inlier in &pose.inliers {
            let (index, point) = seen[inlier as usize];
            let keypoint = KeypointId { image, index };
            if self.model.point_of(keypoint).is_none() {
                self.extend_point(point, keypoint);
            }
        }
        Ok(())
    }

    /// Keypoints of an image with the points that their links see, each pair once.
    fn points_in_view(&self, image: u32) -> Vec<(u32, u32)> {
        let mut seen = Vec::new();
        for (index, _) in self
            .support(image)
            .iter()
            .enumerate()
            .filter(|&(_, &count)| count > 0)
        {
            let index = index as u32;
            let begun = seen.len();
            for &link in self.links.of(KeypointId { image, index }) {
                let Some(point) = self.model.point_of(link) else {
                    continue;
                };
                if !seen[begun..].contains(&(index, point)) {
                    seen.push((index, point));
                }
            }
        }
        seen
    }

    fn pose(
        &self,
        image: u32,
        camera: usize,
        at_px: &[DVec2],
        positions: &[DVec3],
    ) -> Option<(Camera, AbsolutePose)> {
        let options = AbsolutePoseOptions {
            max_error_px: self.options.pose_error_px,
            seed: self.options.seed ^ u64::from(image),
            ..AbsolutePoseOptions::default()
        };
        let intrinsics = self.model.cameras[camera];
        if self.focal_known[camera] {
            return Some((
                intrinsics,
                estimate_absolute_pose(&intrinsics, at_px, positions, &options)?,
            ));
        }
        let (factor, pose) = estimate_absolute_pose_and_focal(
            &intrinsics,
            &FOCAL_FACTORS,
            at_px,
            positions,
            &options,
        )?;
        Some((
            Camera {
                focal_px: intrinsics.focal_px * factor,
                ..intrinsics
            },
            pose,
        ))
    }
}

/// How many different keypoints are among the chosen sightings, which are in the order of the keypoints.
fn distinct(seen: &[(u32, u32)], chosen: &[u32]) -> usize {
    let mut keypoints: Vec<u32> = chosen.iter().map(|&i| seen[i as usize].0).collect();
    keypoints.dedup();
    keypoints.len()
}
