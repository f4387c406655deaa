use glam::DVec3;

use super::state::Mapper;
use crate::sfm::KeypointId;
use ostra_geometry::{RayObservation, TriangulationOptions, triangulate_robust};

impl Mapper<'_> {
    /// Triangulates keypoints of an image that see no point yet, or adds them to points of their matches.
    ///
    /// Returns how many keypoints got a point.
    pub fn triangulate_image(&mut self, image: u32) -> usize {
        let keypoints = self.problem.images[image as usize].keypoints.len() as u32;
        let mut found = 0;
        for keypoint in (0..keypoints).map(|index| KeypointId { image, index }) {
            if self.model.point_of(keypoint).is_none() && !self.links.of(keypoint).is_empty() {
                found += usize::from(self.continue_track(keypoint) || self.create_point(keypoint));
            }
        }
        found
    }

    /// Adds the keypoint to the best-fitting point among those of its matches.
    fn continue_track(&mut self, keypoint: KeypointId) -> bool {
        let points = self
            .links
            .of(keypoint)
            .iter()
            .filter_map(|&link| self.model.point_of(link));
        let errors = points.filter_map(|point| {
            Some((
                self.error_px(keypoint, self.model.point(point)?.position),
                point,
            ))
        });
        let best = errors.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let Some((_, point)) = best.filter(|&(error, _)| error <= self.options.max_error_px) else {
            return false;
        };
        self.extend_point(point, keypoint);
        true
    }

    /// Creates a point from the keypoint and its matches in placed images that see none.
    fn create_point(&mut self, keypoint: KeypointId) -> bool {
        let mut track = vec![keypoint];
        track.extend(
            self.links
                .of(keypoint)
                .iter()
                .filter(|&&link| self.model.point_of(link).is_none()),
        );
        track.retain(|&keypoint| self.observation(keypoint).is_some());
        if track.len() < 2 || track[0] != keypoint {
            return false;
        }
        let observations: Vec<RayObservation<'_>> = track
            .iter()
            .filter_map(|&keypoint| self.observation(keypoint))
            .collect();
        let options = TriangulationOptions {
            max_error_px: self.options.max_error_px,
            min_angle: self.options.min_angle,
        };
        let Some(made) = triangulate_robust(&observations, &options) else {
            return false;
        };
        let inliers = made.inliers.iter().map(|&i| track[i as usize]).collect();
        let point = self.add_point(made.position, inliers);
        self.complete(point);
        true
    }

    /// Extends the track of a point by matches of its keypoints that fit it, and matches of these.
    ///
    /// Returns how many were added.
    pub fn complete(&mut self, point: u32) -> usize {
        let Some(known) = self.model.point(point) else {
            return 0;
        };
        let (position, mut waiting) = (known.position, known.track.clone());
        let mut added = 0;
        while let Some(keypoint) = waiting.pop() {
            for &link in self.links.of(keypoint) {
                let fits = self.model.point_of(link).is_none()
                    && self.error_px(link, position) <= self.options.max_error_px;
                if fits {
                    self.extend_point(point, link);
                    waiting.push(link);
                    added += 1;
                }
            }
        }
        added
    }

    /// Merges a point with one that matches of its keypoints see, if one position fits all observations.
    ///
    /// Returns the number of the merged point and how many observations moved.
    pub fn merge(&mut self, point: u32) -> usize {
        let Some(known) = self.model.point(point) else {
            return 0;
        };
        let linked = known
            .track
            .iter()
            .flat_map(|&keypoint| self.links.of(keypoint));
        let mut others: Vec<u32> = linked
            .filter_map(|&link| self.model.point_of(link))
            .filter(|&other| other != point)
            .collect();
        others.sort_unstable();
        others.dedup();
        for other in others {
            let Some(position) = self.common_position(point, other) else {
                continue;
            };
            let moved = self.model.point(other).map_or(0, |other| other.track.len());
            let (Some(a), Some(b)) = (self.remove_point(point), self.remove_point(other)) else {
                continue;
            };
            let merged = self.add_point(position, [a.track, b.track].concat());
            return moved + self.merge(merged);
        }
        0
    }

    /// Returns the mean of two points, weighted by their observations, if it fits all of them.
    fn common_position(&self, a: u32, b: u32) -> Option<DVec3> {
        let (a, b) = (self.model.point(a)?, self.model.point(b)?);
        let (n, m) = (a.track.len() as f64, b.track.len() as f64);
        let position = (a.position * n + b.position * m) / (n + m);
        let mut all = a.track.iter().chain(&b.track);
        all.all(|&keypoint| self.error_px(keypoint, position) <= self.options.max_error_px)
            .then_some(position)
    }
}
