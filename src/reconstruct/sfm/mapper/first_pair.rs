use std::collections::BTreeSet;

use super::MapperOptions;
use super::state::Mapper;
use crate::sfm::VerifiedPair;
use ostra_core::job::Stopped;
use ostra_core::statistics::upper_median;
use ostra_geometry::{Pose, TwoViewKind};

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
    /// # Errors
    /// [`Stopped`]; `Ok(None)` if no pair is good enough.
    pub fn start_from_pair(&mut self) -> Result<Option<ModelStart>, Stopped> {
        let problem = self.problem;
        let mut tried = BTreeSet::new();
        for required in RELAXED.map(|(matches, parallax)| relaxed(self.options, matches, parallax))
        {
            let mut ranked: Vec<(usize, &VerifiedPair)> =
                problem.pairs.iter().enumerate().collect();
            ranked
                .retain(|(number, pair)| !tried.contains(number) && self.may_start(pair, required));
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
