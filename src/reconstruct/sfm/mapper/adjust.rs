use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;

use super::state::Mapper;
use crate::sfm::{IntrinsicsPrior, KeypointId};
use ostra_core::job::Stopped;
use ostra_geometry::Distortion;
use ostra_geometry::bundle::{
    Bundle, BundleImage, BundleObservation, BundleOptions, Loss, Refine, adjust,
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

/// How thorough an adjustment is.
#[derive(Clone, Copy)]
struct Effort {
    loss: Loss,
    iterations: usize,
    tolerance: f64,
    /// Also refines the principal points of cameras that took few of the images.
    principal: bool,
}

/// A lens without distortion, written as a model that has some.
const STRAIGHT: Distortion = Distortion::Radial { k: [0.0; 2] };

const LOCAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 15,
    tolerance: 1e-4,
    principal: false,
};
const GLOBAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 30,
    tolerance: 1e-5,
    principal: false,
};
const FINAL: Effort = Effort {
    loss: Loss::SoftL1 { px: 1.0 },
    iterations: 100,
    tolerance: 1e-8,
    principal: true,
};

impl Mapper<'_> {
    /// Adjusts a new image together with those that share most points with it.
    pub fn adjust_around(&mut self, image: u32) -> Result<(), Stopped> {
        let free = self.neighbourhood(image);
        let seen: BTreeSet<u32> = free
            .iter()
            .flat_map(|&image| self.points_of(image))
            .collect();
        self.adjust(&free, &seen, LOCAL)?;
        self.filter(&seen);
        Ok(())
    }

    /// Adjusts all images and points, drops observations that do not fit and finds new ones, until little changes.
    pub fn adjust_all(&mut self) -> Result<(), Stopped> {
        self.rounds(GLOBAL, 1)
    }

    /// Runs [`Self::adjust_all`] with the final, thorough effort.
    pub fn adjust_finally(&mut self) -> Result<(), Stopped> {
        self.rounds(FINAL, ROUNDS)?;
        self.straighten()
    }

    /// Removes the distortion from all lenses where it trades off against the focal length.
    ///
    /// On an orbit around an object, distortion, focal length and the object's size are almost free
    /// together. The images are then explained as well without a distortion, which would put the
    /// other two off by some per cent.
    fn straighten(&mut self) -> Result<(), Stopped> {
        let free: BTreeSet<u32> = self.model.placed().collect();
        let all: BTreeSet<u32> = self.model.points().map(|(point, _)| point).collect();
        let bent: Vec<usize> = (0..self.model.cameras.len())
            .filter(|&camera| self.refine(camera, &free, FINAL).distortion)
            .filter(|&camera| self.model.cameras[camera].distortion != STRAIGHT)
            .collect();
        if bent.is_empty() {
            return Ok(());
        }
        let (mut distorted, images) = self.bundle(&all);
        let mut straight = distorted.clone();
        let with = self.adjusted(&mut distorted, &images, &free, FINAL);
        for &camera in &bent {
            self.straight[camera] = true;
            straight.cameras[camera].distortion = STRAIGHT;
        }
        let without = self.adjusted(&mut straight, &images, &free, FINAL);
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

    fn rounds(&mut self, effort: Effort, rounds: usize) -> Result<(), Stopped> {
        self.find_more();
        for _ in 0..rounds {
            let free: BTreeSet<u32> = self.model.placed().collect();
            let all: BTreeSet<u32> = self.model.points().map(|(point, _)| point).collect();
            let observations: usize = self
                .model
                .points()
                .map(|(_, point)| point.track.len())
                .sum();
            self.adjust(&free, &all, effort)?;
            let changes = self.filter(&all) + self.find_more();
            if (changes as f64) < CHANGE * observations as f64 {
                break;
            }
        }
        Ok(())
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
        let (mut bundle, images) = self.bundle(points);
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

    /// Collects the points with all their observations, and the image number of each image in the bundle.
    fn bundle(&self, points: &BTreeSet<u32>) -> (Bundle, Vec<u32>) {
        let tracks = || points.iter().filter_map(|&point| self.model.point(point));
        let images: Vec<u32> = tracks()
            .flat_map(|p| &p.track)
            .map(|k| k.image)
            .collect::<BTreeSet<_>>()
            .into_iter()
            .collect();
        let mut place = vec![0; self.problem.images.len()];
        for (i, &image) in images.iter().enumerate() {
            place[image as usize] = i as u32;
        }
        let observations = tracks().zip(0..).flat_map(|(known, point)| {
            let (this, place) = (&self, &place);
            known.track.iter().map(move |&keypoint| BundleObservation {
                image: place[keypoint.image as usize],
                point,
                at_px: this.at_px(keypoint),
            })
        });
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
            points: tracks().map(|known| known.position).collect(),
            observations: observations.collect(),
        };
        (bundle, images)
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
        let mut dropped = 0;
        for &point in points {
            let Some(known) = self.model.point(point) else {
                continue;
            };
            let (position, track) = (known.position, known.track.clone());
            let (fitting, wrong): (Vec<KeypointId>, Vec<KeypointId>) =
                track.into_iter().partition(|&keypoint| {
                    self.error_px(keypoint, position) <= self.options.max_error_px
                });
            if fitting.len() < 2 || !self.has_parallax(&fitting, position) {
                dropped += fitting.len() + wrong.len();
                self.remove_point(point);
            } else {
                dropped += wrong.len();
                wrong.into_iter().for_each(|keypoint| self.detach(keypoint));
            }
        }
        dropped
    }
}
