//! Choice of the next image, and its registration by resection.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use super::state::Mapper;
use crate::sfm::KeypointId;
use ostra_core::image::halve;
use ostra_geometry::{
    AbsolutePose, AbsolutePoseOptions, Camera, estimate_absolute_pose,
    estimate_absolute_pose_and_focal,
};

/// Why an image could not be placed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal {
    /// Keypoints matched with one that sees a point of the model.
    pub seen: usize,
    /// Number of these that agreed on a pose.
    pub agreeing: usize,
}

/// Focal lengths tried if nothing is known, relative to the guess.
const FOCAL_FACTORS: [f64; 9] = [1.0, 0.84, 1.19, 0.71, 1.41, 0.59, 1.68, 0.5, 2.0];

impl Mapper<'_> {
    /// Estimates an image's pose from the points that it sees, and adds it to their observations.
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

    /// Returns keypoints of an image with the points that their matches see, each pair once.
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

/// Counts the different keypoints among the chosen observations, which are in the order of the keypoints.
fn distinct(seen: &[(u32, u32)], chosen: &[u32]) -> usize {
    let mut keypoints: Vec<u32> = chosen.iter().map(|&i| seen[i as usize].0).collect();
    keypoints.dedup();
    keypoints.len()
}

/// Levels of the grids in which an image's observations are counted: 2 × 2, 4 × 4, … cells.
const LEVELS: u32 = 5;

impl Mapper<'_> {
    /// Returns the images that may be placed, best covered by observations of points first.
    ///
    /// The order is that of Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016. A
    /// refused image is tried again once it sees a fifth more.
    pub fn candidates(&self, refused: &BTreeMap<u32, usize>) -> Vec<u32> {
        let open = (0..self.problem.images.len() as u32).filter(|&image| self.is_open(image));
        let mut ranked: Vec<(u64, u32)> = open
            .filter_map(|image| {
                let seen = self.supported(image);
                let again = refused
                    .get(&image)
                    .is_none_or(|&before| seen * 5 >= before * 6 + 5);
                (seen >= self.options.pose_inliers && again).then(|| (self.coverage(image), image))
            })
            .collect();
        ranked.sort_unstable_by_key(|&(coverage, image)| (std::cmp::Reverse(coverage), image));
        ranked.into_iter().map(|(_, image)| image).collect()
    }

    /// Returns how many of an image's keypoints are matched with one that sees a point.
    pub fn supported(&self, image: u32) -> usize {
        self.support(image)
            .iter()
            .filter(|&&count| count > 0)
            .count()
    }

    /// Sums the occupied cells over all levels, each weighted by the squared number of cells along a side.
    fn coverage(&self, image: u32) -> u64 {
        let seen = &self.problem.images[image as usize];
        let camera = &self.model.cameras[seen.camera];
        let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
        let finest = 1usize << LEVELS;
        let mut occupied = vec![false; finest * finest];
        for (at_px, _) in seen
            .keypoints
            .iter()
            .zip(self.support(image))
            .filter(|&(_, &count)| count > 0)
        {
            let cell = (*at_px / size * finest as f64)
                .clamp(DVec2::ZERO, DVec2::splat(finest as f64 - 1.0));
            occupied[cell.y as usize * finest + cell.x as usize] = true;
        }
        let mut score = 0;
        let mut side = finest;
        while side > 1 {
            score += occupied.iter().filter(|&&taken| taken).count() as u64 * (side * side) as u64;
            occupied = halve(&occupied, side, side, |four| four.contains(&true));
            side /= 2;
        }
        score
    }
}
