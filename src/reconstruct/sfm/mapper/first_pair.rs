use std::collections::BTreeSet;

use super::MapperOptions;
use super::state::Mapper;
use crate::sfm::{KeypointId, VerifiedPair};
use ostra_core::job::Stopped;
use ostra_core::statistics::upper_median;
use ostra_geometry::{Pose, TwoViewKind, essential_from_pose, sampson_distance};

/// How a model was started.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ModelStart {
    /// From images with given poses.
    Given,
    /// From two images.
    Pair {
        /// The two images.
        images: [u32; 2],
        /// Number of matches that agree with their geometry.
        matches: usize,
        /// Median angle between the rays of these matches in radians.
        parallax: f64,
        /// What was required of it.
        required: FirstPairRequirement,
    },
}

/// What is required of the first pair; less than in the options if no pair has as much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstPairRequirement {
    /// Minimum number of matches.
    pub matches: usize,
    /// Minimum parallax in radians.
    pub parallax: f64,
}

/// Shares of the required matches and parallax, tried one after the other for the first pair.
const RELAXED: [(f64, f64); 5] = [
    (1.0, 1.0),
    (0.5, 1.0),
    (0.5, 0.5),
    (0.3, 0.25),
    (0.3, 0.125),
];
/// Number of pairs tried for each.
const TRIES: usize = 12;
/// Share of the required matches that must become points.
const POINT_SHARE: f64 = 0.5;

impl Mapper<'_> {
    /// Places two images that share enough points and are far enough apart, and creates these points.
    ///
    /// `avoided` has sets of images, by image number, that the pair may not contain: first the first
    /// set, and the next one if no pair is left.
    ///
    /// # Errors
    /// [`Stopped`]; `Ok(None)` if no pair is good enough.
    pub fn start_from_pair(
        &mut self,
        avoided: [&[bool]; 2],
    ) -> Result<Option<ModelStart>, Stopped> {
        for avoided in avoided {
            let start = self.start_outside(avoided)?;
            if start.is_some() {
                return Ok(start);
            }
        }
        Ok(None)
    }

    /// Places a pair of images that are not `avoided`.
    fn start_outside(&mut self, avoided: &[bool]) -> Result<Option<ModelStart>, Stopped> {
        let problem = self.problem;
        let mut tried = BTreeSet::new();
        for required in RELAXED.map(|(matches, parallax)| relaxed(self.options, matches, parallax))
        {
            let mut ranked: Vec<(usize, &VerifiedPair)> =
                problem.pairs.iter().enumerate().collect();
            ranked.retain(|(number, pair)| {
                let is_avoided = pair.images.iter().any(|&image| avoided[image as usize]);
                !is_avoided && !tried.contains(number) && self.may_start(pair, required)
            });
            ranked.sort_by_key(|(number, pair)| (std::cmp::Reverse(pair.matches.len()), *number));
            for (number, pair) in ranked.into_iter().take(TRIES) {
                self.progress.check()?;
                tried.insert(number);
                if self.try_pair(pair, required)? {
                    let (images, matches, parallax) =
                        (pair.images, pair.matches.len(), pair.parallax);
                    return Ok(Some(ModelStart::Pair {
                        images,
                        matches,
                        parallax,
                        required,
                    }));
                }
            }
        }
        Ok(None)
    }

    fn may_start(&self, pair: &VerifiedPair, required: FirstPairRequirement) -> bool {
        pair.images.iter().all(|&image| self.is_open(image))
            && pair.second_from_first.is_some()
            && pair.kind != TwoViewKind::Panoramic
            && pair.matches.len() >= required.matches
            && pair.parallax >= required.parallax
    }

    /// Places the pair; undoes this if it yields too few points.
    fn try_pair(
        &mut self,
        pair: &VerifiedPair,
        required: FirstPairRequirement,
    ) -> Result<bool, Stopped> {
        let Some(second_from_first) = pair.second_from_first else {
            return Ok(false);
        };
        let [first, second] = pair.images;
        self.place(first, Pose::IDENTITY);
        self.place(second, second_from_first);
        self.triangulate_image(second);
        self.adjust_around(second)?;
        let enough = self.model.points().count() as f64 >= POINT_SHARE * required.matches as f64;
        if enough && self.median_angle(pair) >= 0.5 * required.parallax {
            return Ok(true);
        }
        self.clear();
        Ok(false)
    }

    /// Returns the median angle between the rays of the points that a pair shares.
    fn median_angle(&self, pair: &VerifiedPair) -> f64 {
        let [Some(a), Some(b)] = pair.images.map(|image| self.model.poses[image as usize]) else {
            return 0.0;
        };
        let (a, b) = (a.centre(), b.centre());
        let mut angles: Vec<f64> = self
            .model
            .points()
            .map(|(_, point)| (point.position - a).angle_between(point.position - b))
            .collect();
        upper_median(&mut angles).unwrap_or(0.0)
    }

    /// Returns how much the matches between placed images contradict the poses, 0–1.
    ///
    /// This is the mean over the matches of the squared distance from their epipolar lines relative
    /// to its limit; 1 for matches beyond the limit.
    pub fn contradiction(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0usize);
        for pair in &self.problem.pairs {
            let [a, b] = pair.images;
            let (Some(first), Some(second)) =
                (self.model.poses[a as usize], self.model.poses[b as usize])
            else {
                continue;
            };
            let cameras =
                [a, b].map(|image| &self.model.cameras[self.problem.images[image as usize].camera]);
            // Images from one place say nothing of the motion.
            if first.centre().distance(second.centre()) <= f64::EPSILON {
                continue;
            }
            let essential = essential_from_pose(&second.compose(&first.inverse()));
            let px = 0.25
                * cameras
                    .iter()
                    .map(|camera| camera.focal_px.element_sum())
                    .sum::<f64>();
            for &[i, j] in pair.matches.iter() {
                let rays =
                    [(a, i), (b, j)].map(|(image, index)| self.ray(KeypointId { image, index }));
                let error_px = px * sampson_distance(&essential, rays);
                let share = (error_px / self.options.max_error_px).powi(2).min(1.0);
                sum += if share.is_finite() { share } else { 1.0 };
                count += 1;
            }
        }
        if count == 0 { 0.0 } else { sum / count as f64 }
    }

    /// Removes all points and poses.
    pub fn clear(&mut self) {
        for point in 0..self.model.point_slots() {
            self.remove_point(point);
        }
        self.model.poses.fill(None);
    }
}

/// Returns the given shares of what the options require.
fn relaxed(options: &MapperOptions, matches: f64, parallax: f64) -> FirstPairRequirement {
    FirstPairRequirement {
        matches: (options.first_pair_matches as f64 * matches) as usize,
        parallax: options.first_pair_parallax * parallax,
    }
}
