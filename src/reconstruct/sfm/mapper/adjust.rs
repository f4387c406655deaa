use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::ControlFlow;

use rayon::prelude::*;

use super::effort::{Effort, FINAL, GLOBAL, LARGE_ALMOST_FINAL, LARGE_FINAL, LOCAL, TrackSample};
use super::state::Mapper;
use crate::sfm::{IntrinsicsPrior, KeypointId};
use ostra_core::job::Stopped;
use ostra_geometry::Distortion;
use ostra_geometry::bundle::{
    Bundle, BundleImage, BundleObservation, BundleOptions, Refine, adjust,
};

/// A camera's intrinsics are refined once it took at least this many images.
const REFINE_FROM_IMAGES: usize = 3;
/// A camera took few of the images if this many times as many were placed.
const FEW_SHARE: usize = 3;
/// Rounds of global adjustment; each then finds observations that fit and drops those that do not.
const ROUNDS: usize = 5;
/// Share of all observations that must change for another round.
const CHANGE: f64 = 5e-4;
/// A lens counts as straight if the loss without distortion is at most this many times the loss with it.
const NEEDLESS: f64 = 1.003;
/// In addition, the focal length must differ by more than this share without distortion.
const AMBIGUOUS: f64 = 0.005;

/// A lens without distortion, written as a model that has some.
const STRAIGHT: Distortion = Distortion::Radial { k: [0.0; 2] };

impl Mapper<'_> {
    /// Adjusts a new image together with those that share most points with it.
    pub fn adjust_around(&mut self, image: u32) -> Result<(), Stopped> {
        let free = self.neighbourhood(image);
        let seen: BTreeSet<u32> = free
            .iter()
            .flat_map(|&image| self.points_of(image))
            .collect();
        self.adjust(&free, &seen, LOCAL)?;
        let doubtful = if self.is_large() {
            self.doubtful(&seen, &free)
        } else {
            seen
        };
        self.filter(&doubtful);
        Ok(())
    }

    /// Adjusts all images and points, drops observations that do not fit and finds new ones, until little changes.
    pub fn adjust_all(&mut self) -> Result<(), Stopped> {
        self.rounds(GLOBAL, 1)
    }

    /// Runs [`Self::adjust_all`] with the final, thorough effort.
    pub fn adjust_finally(&mut self) -> Result<(), Stopped> {
        if !self.is_large() {
            self.rounds(FINAL, ROUNDS)?;
            return self.straighten(FINAL);
        }
        self.rounds(LARGE_ALMOST_FINAL, ROUNDS)?;
        self.straighten(LARGE_ALMOST_FINAL)?;
        self.rounds(LARGE_FINAL, 1)
    }

    /// Removes the distortion from all lenses where it trades off against the focal length.
    ///
    /// On an orbit around an object, distortion, focal length and the object's size are almost free
    /// together. The images are then explained as well without a distortion, which would put the
    /// other two off by some per cent.
    fn straighten(&mut self, effort: Effort) -> Result<(), Stopped> {
        let free: BTreeSet<u32> = self.model.placed().collect();
        let all: BTreeSet<u32> = self.model.points().map(|(point, _)| point).collect();
        let bent: Vec<usize> = (0..self.model.cameras.len())
            .filter(|&camera| self.refine(camera, &free, effort).distortion)
            .filter(|&camera| self.model.cameras[camera].distortion != STRAIGHT)
            .collect();
        if bent.is_empty() {
            return Ok(());
        }
        let (mut distorted, images) = self.bundle(&all, &free, self.sample(effort));
        let mut straight = distorted.clone();
        let with = self.adjusted(&mut distorted, &images, &free, effort);
        for &camera in &bent {
            self.straight[camera] = true;
            straight.cameras[camera].distortion = STRAIGHT;
        }
        let without = self.adjusted(&mut straight, &images, &free, effort);
        self.progress.check()?;
        let focal = |bundle: &Bundle, camera: usize| bundle.cameras[camera].focal_px.x;
        let changes = |&camera: &usize| {
            (focal(&straight, camera) / focal(&distorted, camera) - 1.0).abs() > AMBIGUOUS
        };
        if without > NEEDLESS * with || !bent.iter().any(changes) {
            bent.into_iter()
                .for_each(|camera| self.straight[camera] = false);
            return Ok(());
        }
        self.take(&straight, &images, &all);
        self.filter(&all);
        Ok(())
    }

    /// Adjusts everything, drops observations that do not fit and finds new ones, in rounds until
    /// little changes.
    ///
    /// Rounds may alternate: one drops a few points, and the next one finds them again. They end when
    /// the observations are those before an earlier round, because what follows would repeat.
    fn rounds(&mut self, effort: Effort, rounds: usize) -> Result<(), Stopped> {
        self.find_more();
        let mut before = BTreeSet::new();
        for _ in 0..rounds {
            before.insert(self.observations_digest());
            let free: BTreeSet<u32> = self.model.placed().collect();
            let all: BTreeSet<u32> = self.model.points().map(|(point, _)| point).collect();
            let observations: usize = self
                .model
                .points()
                .map(|(_, point)| point.track.len())
                .sum();
            self.adjust(&free, &all, effort)?;
            let changes = self.filter(&all) + self.find_more();
            if (changes as f64) < CHANGE * observations as f64
                || before.contains(&self.observations_digest())
            {
                break;
            }
        }
        Ok(())
    }

    /// Returns a number that depends on which keypoints see the same points, in any order.
    fn observations_digest(&self) -> u64 {
        let digest = |track: &[KeypointId]| {
            let mut track = track.to_vec();
            track.sort_unstable();
            let mut hasher = DefaultHasher::new();
            track.hash(&mut hasher);
            hasher.finish()
        };
        let points = self.model.points();
        points.fold(0, |sum, (_, point)| sum.wrapping_add(digest(&point.track)))
    }

    /// Completes and merges points and creates new ones; returns how many observations changed.
    fn find_more(&mut self) -> usize {
        let mut changes = 0;
        for point in 0..self.model.point_slots() {
            changes += self.complete(point) + self.merge(point);
        }
        let placed: Vec<u32> = self.model.placed().collect();
        changes
            + placed
                .into_iter()
                .map(|image| self.triangulate_image(image))
                .sum::<usize>()
    }

    fn points_of(&self, image: u32) -> impl Iterator<Item = u32> + '_ {
        let keypoints = self.problem.images[image as usize].keypoints.len() as u32;
        (0..keypoints).filter_map(move |index| self.model.point_of(KeypointId { image, index }))
    }

    /// Returns the image and those that share most points with it.
    fn neighbourhood(&self, image: u32) -> BTreeSet<u32> {
        let mut shared: BTreeMap<u32, usize> = BTreeMap::new();
        for point in self
            .points_of(image)
            .filter_map(|point| self.model.point(point))
        {
            for keypoint in point
                .track
                .iter()
                .filter(|keypoint| keypoint.image != image)
            {
                *shared.entry(keypoint.image).or_default() += 1;
            }
        }
        let mut ranked: Vec<(usize, u32)> = shared
            .into_iter()
            .map(|(image, count)| (count, image))
            .collect();
        ranked.sort_unstable_by_key(|&(count, image)| (std::cmp::Reverse(count), image));
        let neighbours = ranked
            .into_iter()
            .take(self.options.local_images - 1)
            .map(|(_, image)| image);
        neighbours.chain([image]).collect()
    }

    /// Runs bundle adjustment of the free images and the points; other images that see these points stay fixed.
    fn adjust(
        &mut self,
        free: &BTreeSet<u32>,
        points: &BTreeSet<u32>,
        effort: Effort,
    ) -> Result<(), Stopped> {
        let (mut bundle, images) = self.bundle(points, free, self.sample(effort));
        self.adjusted(&mut bundle, &images, free, effort);
        self.take(&bundle, &images, points);
        self.progress.check()
    }

    /// Adjusts a bundle in which only the free images move; returns the remaining loss.
    fn adjusted(
        &self,
        bundle: &mut Bundle,
        images: &[u32],
        free: &BTreeSet<u32>,
        effort: Effort,
    ) -> f64 {
        let is_fixed = |image: &u32| {
            !free.contains(image) || self.problem.images[*image as usize].given.is_some()
        };
        let options = BundleOptions {
            loss: effort.loss,
            max_iterations: effort.iterations,
            function_tolerance: effort.tolerance,
            refine: (0..self.model.cameras.len())
                .map(|camera| self.refine(camera, free, effort))
                .collect(),
            fixed_images: images.iter().map(is_fixed).collect(),
            ..BundleOptions::default()
        };
        let progress = self.progress;
        let mut step = |_, _| {
            if progress.check().is_ok() {
                ControlFlow::Continue(())
            } else {
                ControlFlow::Break(())
            }
        };
        adjust(bundle, &options, &mut step).final_cost
    }

    /// Collects the points with their observations, and the image number of each image in the bundle.
    fn bundle(
        &self,
        points: &BTreeSet<u32>,
        free: &BTreeSet<u32>,
        sample: TrackSample,
    ) -> (Bundle, Vec<u32>) {
        let mut positions = Vec::with_capacity(points.len());
        let mut observations = Vec::new();
        let mut is_seen = vec![false; self.problem.images.len()];
        let is_free = self.flags(free);
        for &point in points {
            let Some(known) = self.model.point(point) else {
                continue;
            };
            for keypoint in sample.of(&known.track, point, &is_free) {
                is_seen[keypoint.image as usize] = true;
                observations.push(BundleObservation {
                    image: keypoint.image,
                    point: positions.len() as u32,
                    at_px: self.at_px(keypoint),
                });
            }
            positions.push(known.position);
        }
        let images: Vec<u32> = (0..is_seen.len() as u32)
            .filter(|&image| is_seen[image as usize])
            .collect();
        let mut place = vec![0; is_seen.len()];
        for (i, &image) in images.iter().enumerate() {
            place[image as usize] = i as u32;
        }
        for observation in &mut observations {
            observation.image = place[observation.image as usize];
        }
        let bundle = Bundle {
            cameras: self.model.cameras.clone(),
            images: images
                .iter()
                .filter_map(|&image| {
                    let camera = self.problem.images[image as usize].camera as u32;
                    Some(BundleImage {
                        camera,
                        camera_from_world: self.model.poses[image as usize]?,
                    })
                })
                .collect(),
            points: positions,
            observations,
        };
        (bundle, images)
    }

    /// Returns which observations of points an adjustment uses.
    fn sample(&self, effort: Effort) -> TrackSample {
        if self.is_large() {
            effort.sample
        } else {
            TrackSample::ALL
        }
    }

    /// Returns whether each image is in a set.
    fn flags(&self, images: &BTreeSet<u32>) -> Vec<bool> {
        let mut flags = vec![false; self.problem.images.len()];
        for &image in images {
            flags[image as usize] = true;
        }
        flags
    }

    /// Returns the points of a local adjustment that do not fit what it used of their observations.
    fn doubtful(&self, points: &BTreeSet<u32>, free: &BTreeSet<u32>) -> BTreeSet<u32> {
        let is_free = self.flags(free);
        let fits = |point: u32| {
            let Some(known) = self.model.point(point) else {
                return true;
            };
            let used = LOCAL.sample.of(&known.track, point, &is_free);
            let fits = |&keypoint: &KeypointId| {
                self.error_px(keypoint, known.position) <= self.options.max_error_px
            };
            used.iter().all(fits) && self.has_parallax(&used, known.position)
        };
        let points: Vec<u32> = points.iter().copied().collect();
        let doubtful = points.into_par_iter().filter(|&point| !fits(point));
        doubtful.collect()
    }

    /// Copies adjusted values back into the model.
    fn take(&mut self, bundle: &Bundle, images: &[u32], points: &BTreeSet<u32>) {
        for (&image, adjusted) in images.iter().zip(&bundle.images) {
            self.place(image, adjusted.camera_from_world);
        }
        let known: Vec<u32> = points
            .iter()
            .copied()
            .filter(|&point| self.model.point(point).is_some())
            .collect();
        for (point, &position) in known.into_iter().zip(&bundle.points) {
            self.model.move_to(point, position);
        }
        for (camera, adjusted) in bundle.cameras.iter().enumerate() {
            if self.model.cameras[camera] != *adjusted {
                self.model.cameras[camera] = *adjusted;
                self.cast_rays(camera);
            }
        }
    }

    /// Returns which intrinsics of a camera are refined.
    ///
    /// Nothing is refined if the intrinsics are given, if some of the camera's images stay fixed,
    /// or if it has few images. The principal point of a camera with few of the images, which may
    /// be crops, is held well enough by what the others see.
    fn refine(&self, camera: usize, free: &BTreeSet<u32>, effort: Effort) -> Refine {
        let own = || {
            self.model
                .placed()
                .filter(|&image| self.problem.images[image as usize].camera == camera)
        };
        let all_free = own().all(|image| free.contains(&image));
        let given = self.problem.cameras[camera].source == IntrinsicsPrior::Given;
        let placed = self.model.placed().count();
        if given || !all_free || placed < REFINE_FROM_IMAGES {
            return Refine::NOTHING;
        }
        let few = own().count() * FEW_SHARE <= placed;
        Refine {
            focal: true,
            principal: effort.principal && few,
            distortion: !self.straight[camera],
        }
    }

    /// Drops observations with a large error and points without enough parallax; returns how many
    /// observations were dropped.
    pub fn filter(&mut self, points: &BTreeSet<u32>) -> usize {
        let points: Vec<u32> = points.iter().copied().collect();
        let faults: Vec<(u32, Fault)> = points
            .par_iter()
            .filter_map(|&point| Some((point, self.fault(point)?)))
            .collect();
        let mut dropped = 0;
        for (point, fault) in faults {
            match fault {
                Fault::Point { observations } => {
                    dropped += observations;
                    self.remove_point(point);
                }
                Fault::Observations(wrong) => {
                    dropped += wrong.len();
                    wrong.into_iter().for_each(|keypoint| self.detach(keypoint));
                }
            }
        }
        dropped
    }

    /// Returns what is wrong with a point; `None` if nothing is, or there is no such point.
    fn fault(&self, point: u32) -> Option<Fault> {
        let known = self.model.point(point)?;
        let (fitting, wrong): (Vec<KeypointId>, Vec<KeypointId>) =
            known.track.iter().partition(|&&keypoint| {
                self.error_px(keypoint, known.position) <= self.options.max_error_px
            });
        if fitting.len() < 2 || !self.has_parallax(&fitting, known.position) {
            let observations = known.track.len();
            return Some(Fault::Point { observations });
        }
        (!wrong.is_empty()).then_some(Fault::Observations(wrong))
    }
}

/// What is wrong with a point.
enum Fault {
    /// The whole point: too few observations fit, or it has no parallax.
    Point {
        /// Number of its observations.
        observations: usize,
    },
    /// These observations.
    Observations(Vec<KeypointId>),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn part_of_a_long_track_is_used_and_every_image_keeps_its_share() {
        let track: Vec<KeypointId> = (0..40)
            .map(|image| KeypointId { image, index: 7 })
            .collect();
        let is_free: Vec<bool> = (0..40).map(|image| image < 5).collect();
        let sample = TrackSample {
            moving: 3,
            fixed: 7,
        };
        let mut uses = [0; 40];
        for point in 0..175 {
            for keypoint in sample.of(&track, point, &is_free) {
                uses[keypoint.image as usize] += 1;
            }
        }
        assert_eq!(uses[..5], [175 * 3 / 5; 5]);
        assert_eq!(uses[5..], [175 * 7 / 35; 35]);
        assert_eq!(TrackSample::ALL.of(&track, 3, &is_free), track);
        let short = &track[..3];
        assert_eq!(sample.of(short, 3, &is_free), short);
    }
}
