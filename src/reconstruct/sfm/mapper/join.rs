//! Joining of models that matches connect, although no image of one could be placed in the other.
//!
//! An image is placed by the points that it sees alone. Several images together may still see enough
//! points of the other model, so that the models can be aligned by the points that both contain.

use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};

use super::MapperOptions;
use super::grow::Mapped;
use super::state::Mapper;
use crate::sfm::{Correspondences, MapProblem, ModelPoint, SparseModel};
use ostra_core::job::{Progress, Stopped};
use ostra_geometry::ransac::{Estimator, RansacOptions, consensus};
use ostra_geometry::{Alignment, Camera, Pose, Similarity};

/// The points that two models share must be seen by at least this many images of each.
const LEAST_IMAGES: usize = 3;
/// Maximum number of shared points that models are aligned by; those with most matches come first.
///
/// The rest is found when all is adjusted. This bounds the time of models that share much but do not
/// fit each other.
const MOST_POINTS: usize = 1000;
/// Number of images of a model by which a shared point is judged.
const MOST_VIEWS: usize = 6;
/// Share of the images that may get lost when two models are joined.
const LOST: f64 = 0.1;
/// Contradiction up to which joined models are kept, if neither had more before.
///
/// Good models have up to 0.08, and 0.15 is reported as contradictory; see `CONTRADICTORY`.
const MOST_CONTRADICTION: f64 = 0.1;

/// Joins models that share enough points, and places further images in the result.
///
/// Models are aligned by a similarity, estimated from three points at a time by RANSAC (least squares
/// after S. Umeyama, PAMI 1991), whose error is that of the points in the images of the other model.
/// All is then adjusted together. What does not fit stays as it was.
///
/// `problem` is that of the models, with further matches and, in images that are in no model, further
/// keypoints. When stopped, models that are not joined yet stay apart.
#[must_use]
pub fn join_models(
    problem: &MapProblem,
    mut models: Vec<Mapped>,
    options: &MapperOptions,
    progress: &Progress,
) -> Vec<Mapped> {
    if models.len() < 2 {
        return models;
    }
    let links = Correspondences::new(problem);
    let joining = Joining {
        problem,
        links: &links,
        options,
        progress,
    };
    while let Ok(Some((pair, joined))) = joining.next(&models) {
        models[pair[0]] = joined;
        models.remove(pair[1]);
        Mapped::sort(&mut models);
    }
    models
}

/// Input of the joining of models.
struct Joining<'a> {
    problem: &'a MapProblem,
    links: &'a Correspondences,
    options: &'a MapperOptions,
    progress: &'a Progress,
}

/// How the second of two models lies in the first one.
struct ModelAlignment {
    first_from_second: Similarity,
    /// Points that are the same: number in the first model by number in the second one.
    same: BTreeMap<u32, u32>,
}

impl Joining<'_> {
    /// Returns the first two models that can be joined, by index, and the result.
    fn next(&self, models: &[Mapped]) -> Result<Option<([usize; 2], Mapped)>, Stopped> {
        for second in 1..models.len() {
            for first in 0..second {
                self.progress.check()?;
                let Some(aligned) = self.align([&models[first].model, &models[second].model])
                else {
                    continue;
                };
                if let Some(joined) = self.joined(models, [first, second], &aligned)? {
                    return Ok(Some(([first, second], joined)));
                }
            }
        }
        Ok(None)
    }

    /// Estimates how the second model lies in the first one; `None` if they share too few points.
    fn align(&self, models: [&SparseModel; 2]) -> Option<ModelAlignment> {
        let pairs = self.shared_points(models);
        let seen: Vec<SharedPoint> = pairs
            .iter()
            .filter_map(|&[p, q]| {
                Some([
                    self.viewed_point(models[0], models[0].point(p)?),
                    self.viewed_point(models[1], models[1].point(q)?),
                ])
            })
            .collect();
        let enough = (self.options.pose_inlier_share * seen.len() as f64).ceil() as usize;
        let options = RansacOptions {
            confidence: 0.999,
            max_iterations: 10_000,
            max_vain: 2_000,
            min_inliers: enough.max(self.options.pose_inliers),
            seed: self.options.seed,
        };
        let shared = SharedPoints {
            points: seen,
            limit_px: self.options.pose_error_px,
        };
        let found = consensus(&shared, &options)?;
        let same: BTreeMap<u32, u32> = found
            .inliers
            .iter()
            .map(|&inlier| pairs[inlier as usize])
            .map(|[p, q]| (q, p))
            .collect();
        let images = |model: &SparseModel, points: &mut dyn Iterator<Item = u32>| {
            let tracks = points.filter_map(|point| model.point(point));
            let images = tracks.flat_map(|point| &point.track).map(|seen| seen.image);
            images.collect::<BTreeSet<u32>>().len()
        };
        let counts = [
            images(models[0], &mut same.values().copied()),
            images(models[1], &mut same.keys().copied()),
        ];
        let is_enough = counts.iter().all(|&count| count >= LEAST_IMAGES);
        is_enough.then_some(ModelAlignment {
            first_from_second: found.model,
            same,
        })
    }

    /// Returns points of both models that matches connect, each point once, most matches first, up to
    /// a maximum number.
    fn shared_points(&self, models: [&SparseModel; 2]) -> Vec<[u32; 2]> {
        let mut matches: BTreeMap<[u32; 2], usize> = BTreeMap::new();
        for (q, point) in models[1].points() {
            let links = point.track.iter().flat_map(|&seen| self.links.of(seen));
            // Only images of a model are known to have the keypoints of the problem.
            let placed = links.filter(|link| models[0].is_placed(link.image));
            for p in placed.filter_map(|&link| models[0].point_of(link)) {
                *matches.entry([p, q]).or_default() += 1;
            }
        }
        let mut ranked: Vec<([u32; 2], usize)> = matches.into_iter().collect();
        ranked.sort_by_key(|&(pair, count)| (std::cmp::Reverse(count), pair));
        let mut taken = [BTreeSet::new(), BTreeSet::new()];
        ranked.retain(|([p, q], _)| {
            let is_free = !taken[0].contains(p) && !taken[1].contains(q);
            if is_free {
                taken[0].insert(*p);
                taken[1].insert(*q);
            }
            is_free
        });
        ranked.truncate(MOST_POINTS);
        ranked.into_iter().map(|(pair, _)| pair).collect()
    }

    fn viewed_point(&self, model: &SparseModel, point: &ModelPoint) -> ViewedPoint {
        let views = point.track.iter().filter_map(|seen| {
            let image = &self.problem.images[seen.image as usize];
            Some(View {
                camera: model.cameras[image.camera],
                camera_from_world: model.poses[seen.image as usize]?,
                at_px: image.keypoints[seen.index as usize],
            })
        });
        ViewedPoint {
            position: point.position,
            views: views.take(MOST_VIEWS).collect(),
        }
    }

    /// Joins two aligned models and adjusts all; `None` if they do not fit each other.
    fn joined(
        &self,
        models: &[Mapped],
        [first, second]: [usize; 2],
        aligned: &ModelAlignment,
    ) -> Result<Option<Mapped>, Stopped> {
        let mut mapper = Mapper::new(self.problem, self.links, self.options, self.progress);
        for (index, other) in models.iter().enumerate() {
            if index != first && index != second {
                for image in other.model.placed() {
                    mapper.closed[image as usize] = true;
                }
            }
        }
        let [first, second] = [&models[first], &models[second]];
        mapper.adopt(&first.model);
        mapper.adopt_aligned(&first.model, &second.model, aligned);
        mapper.adjust_finally()?;
        let mut refused = BTreeMap::new();
        mapper.drop_lost(&mut refused);
        let parts = [&first.model, &second.model].map(|model| model.placed().count());
        let lost = (parts[0] + parts[1]).saturating_sub(mapper.model.placed().count());
        let contradiction = mapper.contradiction();
        let most = MOST_CONTRADICTION
            .max(first.contradiction)
            .max(second.contradiction);
        let fits = lost as f64 <= LOST * parts[1].min(parts[0]) as f64
            && mapper.seen_by_both([&first.model, &second.model]) >= self.options.pose_inliers
            && contradiction <= most;
        if !fits {
            return Ok(None);
        }
        let refused = mapper.place_more(refused)?;
        Ok(Some(Mapped {
            contradiction: mapper.contradiction(),
            model: mapper.model,
            start: first.start,
            refused,
            stopped: first.stopped || second.stopped,
        }))
    }
}

impl Mapper<'_> {
    /// Adds an aligned model to the adopted first one; points that are the same become one.
    fn adopt_aligned(
        &mut self,
        first: &SparseModel,
        second: &SparseModel,
        aligned: &ModelAlignment,
    ) {
        let camera_of = |image: u32| self.problem.images[image as usize].camera;
        let known: BTreeSet<usize> = first.placed().map(camera_of).collect();
        let own: BTreeSet<usize> = second.placed().map(camera_of).collect();
        for &camera in own.difference(&known) {
            self.model.cameras[camera] = second.cameras[camera];
            self.cast_rays(camera);
        }
        own.iter()
            .for_each(|&camera| self.focal_known[camera] = true);
        let first_from_second = &aligned.first_from_second;
        for image in second.placed() {
            if let Some(pose) = &second.poses[image as usize] {
                self.place(image, first_from_second.transform_camera(pose));
            }
        }
        // The adopted points are numbered in their order.
        let numbers: BTreeMap<u32, u32> = first.points().map(|(point, _)| point).zip(0..).collect();
        for (number, point) in second.points() {
            let same = aligned.same.get(&number).and_then(|p| numbers.get(p));
            match same {
                Some(&same) => {
                    for &keypoint in &point.track {
                        self.extend_point(same, keypoint);
                    }
                }
                None => {
                    let position = first_from_second.transform(point.position);
                    self.add_point(position, point.track.clone());
                }
            }
        }
    }

    /// Returns how many points are seen by images of both parts.
    fn seen_by_both(&self, parts: [&SparseModel; 2]) -> usize {
        let has = |point: &ModelPoint, part: &SparseModel| {
            point.track.iter().any(|seen| part.is_placed(seen.image))
        };
        self.model
            .points()
            .filter(|(_, point)| parts.iter().all(|part| has(point, part)))
            .count()
    }
}

/// An image that sees a point.
struct View {
    camera: Camera,
    camera_from_world: Pose,
    at_px: DVec2,
}

/// A point of a model with images that see it.
struct ViewedPoint {
    position: DVec3,
    views: Vec<View>,
}

impl ViewedPoint {
    /// Returns the mean reprojection error in pixels of another position in the images.
    fn error_px(&self, position: DVec3) -> f64 {
        let error = |view: &View| {
            let seen = view
                .camera
                .project(view.camera_from_world.transform(position));
            seen.map_or(f64::INFINITY, |at| at.distance(view.at_px))
        };
        self.views.iter().map(error).sum::<f64>() / self.views.len() as f64
    }
}

/// A point as the first and as the second model have it.
type SharedPoint = [ViewedPoint; 2];

/// Points of two models that may be the same.
struct SharedPoints {
    points: Vec<SharedPoint>,
    limit_px: f64,
}

impl SharedPoints {
    /// Returns the larger of the errors of a point in the images of the other model, at most the
    /// limit.
    fn error_px(&self, both: [&Similarity; 2], [first, second]: &SharedPoint) -> f64 {
        let [first_from_second, second_from_first] = both;
        let errors = [
            first.error_px(first_from_second.transform(second.position)),
            second.error_px(second_from_first.transform(first.position)),
        ];
        let error = errors[0].max(errors[1]);
        if error < self.limit_px {
            error
        } else {
            self.limit_px
        }
    }

    fn fitted(&self, chosen: impl Iterator<Item = usize>) -> Option<Similarity> {
        let (source, target): (Vec<DVec3>, Vec<DVec3>) = chosen
            .map(|index| &self.points[index])
            .map(|[first, second]| (second.position, first.position))
            .unzip();
        let found = Similarity::align(&source, &target, Alignment::Sim3).ok()?;
        (found.scale.is_finite() && found.scale > 0.0).then_some(found)
    }
}

impl Estimator for SharedPoints {
    type Model = Similarity;
    const SAMPLE: usize = 3;

    fn count(&self) -> usize {
        self.points.len()
    }

    fn fit(&self, sample: &[usize], found: &mut Vec<Similarity>) {
        found.extend(self.fitted(sample.iter().copied()));
    }

    fn cost(&self, model: &Similarity, enough: f64) -> f64 {
        let inverse = model.inverse();
        let mut sum = 0.0;
        for point in &self.points {
            sum += self.error_px([model, &inverse], point).powi(2);
            if sum > enough {
                break;
            }
        }
        sum
    }

    fn inliers(&self, model: &Similarity) -> Vec<u32> {
        let inverse = model.inverse();
        let fits = |index: &u32| {
            let point = &self.points[*index as usize];
            self.error_px([model, &inverse], point) < self.limit_px
        };
        (0..self.points.len() as u32).filter(fits).collect()
    }

    fn refine(&self, model: &Similarity) -> Option<Similarity> {
        self.fitted(self.inliers(model).into_iter().map(|index| index as usize))
    }
}

#[cfg(test)]
mod tests;
