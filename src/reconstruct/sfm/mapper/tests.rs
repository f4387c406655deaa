use glam::{DMat3, DQuat, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::{Mapped, MapperOptions, ModelStart, extend, map};
use crate::sfm::{IntrinsicsPrior, MapCamera, MapImage, MapProblem, VerifiedPair};
use ostra_core::job::Progress;
use ostra_geometry::{
    Alignment, Camera, Distortion, Pose, TrajectoryMetrics, TwoViewOptions, estimate_two_view,
};

/// A synthetic scene: cameras around a block of points, keypoints with noise, matches with outliers.
pub(super) struct Made {
    pub problem: MapProblem,
    truth: Vec<Pose>,
    camera: Camera,
}

pub(super) struct Recipe {
    pub views: usize,
    pub points: usize,
    pub noise_px: f64,
    pub outliers: f64,
    pub window: usize,
    pub focal_px: f64,
    pub poses: fn(usize) -> Pose,
}

pub(super) const RING: Recipe = Recipe {
    views: 30,
    points: 700,
    noise_px: 0.5,
    outliers: 0.3,
    window: 5,
    focal_px: 1100.0,
    poses: on_an_arc,
};

/// Returns a pose on an arc of 4 units around the origin, 6° apart, facing inwards, rising and falling.
fn on_an_arc(view: usize) -> Pose {
    on_an_arc_of(4.0, view)
}

fn on_a_far_arc(view: usize) -> Pose {
    on_an_arc_of(24.0, view)
}

fn on_an_arc_of(radius: f64, view: usize) -> Pose {
    let angle = (view as f64 * 6.0).to_radians();
    let centre = DVec3::new(
        radius * angle.sin(),
        0.1 * radius * (2.3 * angle).sin(),
        -radius * angle.cos(),
    );
    looking_at_origin(centre)
}

fn looking_at_origin(centre: DVec3) -> Pose {
    let forward = -centre.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let camera_from_world = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let rotation = DQuat::from_mat3(&camera_from_world);
    Pose {
        rotation,
        translation: -(rotation * centre),
    }
}

/// Returns a pose at a fixed position, rotating by 3°.
fn on_the_spot(view: usize) -> Pose {
    let turn = Pose {
        rotation: DQuat::from_rotation_y((view as f64 * 3.0).to_radians()),
        translation: DVec3::ZERO,
    };
    turn.compose(&looking_at_origin(DVec3::new(0.0, 0.0, -4.0)))
}

impl Made {
    pub fn new(recipe: &Recipe, seed: u64) -> Self {
        let mut rng = Pcg64Mcg::seed_from_u64(seed);
        let camera = Camera {
            distortion: Distortion::Radial { k: [-0.05, 0.01] },
            ..Camera::pinhole(1280, 960, [recipe.focal_px; 2], [640.0, 480.0])
        };
        let mut within = || rng.random_range(-1.0..1.0);
        let points: Vec<DVec3> = (0..recipe.points)
            .map(|_| DVec3::new(within(), within(), within()))
            .collect();
        let truth: Vec<Pose> = (0..recipe.views).map(recipe.poses).collect();
        let mut normal = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
        let images: Vec<MapImage> = truth
            .iter()
            .map(|pose| {
                // A point out of sight has a keypoint without matches.
                let seen = |x: &DVec3| {
                    camera
                        .project(pose.transform(*x))
                        .filter(|&at| camera.contains(at))
                };
                let noise = |at: DVec2, a: f64, b: f64| at + recipe.noise_px * DVec2::new(a, b);
                let keypoints = points
                    .iter()
                    .map(|x| seen(x).map_or(DVec2::NAN, |at| noise(at, normal(), normal())));
                MapImage {
                    camera: 0,
                    keypoints: keypoints.collect(),
                    given: None,
                }
            })
            .collect();
        let cameras = vec![MapCamera {
            intrinsics: camera,
            source: IntrinsicsPrior::Given,
        }];
        let mut made = Self {
            problem: MapProblem {
                cameras,
                images,
                pairs: Vec::new(),
            },
            truth,
            camera,
        };
        made.match_window(recipe, &mut rng);
        made
    }

    fn match_window(&mut self, recipe: &Recipe, rng: &mut Pcg64Mcg) {
        for first in 0..recipe.views {
            for second in first + 1..recipe.views.min(first + 1 + recipe.window) {
                let matches = self.matches(first, second, recipe.outliers, rng);
                self.problem
                    .pairs
                    .extend(self.verified([first, second], &matches));
            }
        }
    }

    fn matches(
        &self,
        first: usize,
        second: usize,
        outliers: f64,
        rng: &mut Pcg64Mcg,
    ) -> Vec<[u32; 2]> {
        let finite =
            |image: usize, index: usize| self.problem.images[image].keypoints[index].is_finite();
        let count = self.problem.images[first].keypoints.len();
        let seen: Vec<usize> = (0..count)
            .filter(|&i| finite(first, i) && finite(second, i))
            .collect();
        let wrong = |rng: &mut Pcg64Mcg, i: usize| {
            if rng.random_range(0.0..1.0) < outliers {
                seen[rng.random_range(0..seen.len())]
            } else {
                i
            }
        };
        seen.iter()
            .map(|&i| [i as u32, wrong(rng, i) as u32])
            .collect()
    }

    fn verified(&self, images: [usize; 2], matches: &[[u32; 2]]) -> Option<VerifiedPair> {
        let at = |image: usize, index: u32| self.problem.images[image].keypoints[index as usize];
        let at_px: Vec<[DVec2; 2]> = matches
            .iter()
            .map(|&[i, j]| [at(images[0], i), at(images[1], j)])
            .collect();
        let camera = &self.problem.cameras[0];
        let calibrated = camera.source == IntrinsicsPrior::Given;
        let both = [&camera.intrinsics, &camera.intrinsics];
        let found = estimate_two_view(both, calibrated, &at_px, &TwoViewOptions::default())?;
        Some(VerifiedPair {
            images: images.map(|image| image as u32),
            matches: found.inliers.iter().map(|&i| matches[i as usize]).collect(),
            kind: found.kind,
            second_from_first: found.second_from_first,
            parallax: found.parallax,
        })
    }

    pub fn map(&self) -> Vec<Mapped> {
        map(
            &self.problem,
            &MapperOptions::default(),
            &Progress::default(),
        )
        .unwrap()
    }

    /// Returns the largest centre error as a share of the extent, and the largest rotation error in
    /// degrees, after Sim(3).
    pub fn errors(&self, mapped: &Mapped) -> (f64, f64) {
        let placed = self
            .truth
            .iter()
            .zip(&mapped.model.poses)
            .filter_map(|(truth, found)| Some(((*found)?, *truth)));
        let (found, truth): (Vec<Pose>, Vec<Pose>) = placed.unzip();
        let error = TrajectoryMetrics::between(&found, &truth, Alignment::Sim3).unwrap();
        (error.centre.max / error.extent, error.rotation_deg.max)
    }
}

#[test]
fn thirty_views_are_placed_despite_noise_and_outliers() {
    for seed in 0..3 {
        let made = Made::new(&RING, seed);
        let models = made.map();
        assert_eq!(models.len(), 1);
        assert_eq!(models[0].model.placed().count(), 30);
        let (centre, rotation) = made.errors(&models[0]);
        assert!(
            centre < 1e-3 && rotation < 0.05,
            "seed {seed}: centre {centre:.2e}, rotation {rotation:.3}°"
        );
    }
}

#[test]
fn large_model_is_as_exact_with_bounded_adjustments() {
    let made = Made::new(&RING, 2);
    let options = MapperOptions {
        large_images: 5,
        ..MapperOptions::default()
    };
    let models = map(&made.problem, &options, &Progress::default()).unwrap();
    assert_eq!(models[0].model.placed().count(), 30);
    let (centre, rotation) = made.errors(&models[0]);
    let (whole, _) = made.errors(&made.map()[0]);
    assert!(
        centre < 1.2 * whole + 1e-5 && rotation < 0.05,
        "centre {centre:.2e} and {whole:.2e}, rotation {rotation:.3}°"
    );
}

#[test]
fn reversed_first_pair_is_replaced() {
    // From afar, the images of two cameras agree almost as well with the reversed relief and motion.
    let far = Recipe {
        focal_px: 6600.0,
        poses: on_a_far_arc,
        ..RING
    };
    let mut made = Made::new(&far, 4);
    let required = MapperOptions::default().first_pair_parallax;
    let first = made
        .problem
        .pairs
        .iter_mut()
        .filter(|pair| pair.parallax >= required)
        .max_by_key(|pair| (pair.matches.len(), std::cmp::Reverse(pair.images)))
        .unwrap();
    let [a, b] = first.images.map(|image| made.truth[image as usize]);
    let rotation = (b.rotation * a.rotation.conjugate()).conjugate();
    let translation = b.translation - rotation * a.translation;
    first.second_from_first = Some(Pose {
        rotation,
        translation: translation.normalize(),
    });
    let models = made.map();
    let (centre, rotation) = made.errors(&models[0]);
    assert!(
        centre < 2e-3 && rotation < 0.1,
        "centre {centre:.2e}, rotation {rotation:.3}°"
    );
    let right = models[0].contradiction;
    assert!(right < 0.1, "{right}");
}

#[test]
fn unknown_focal_length_is_found() {
    let mut made = Made::new(&RING, 5);
    let guess = Camera {
        distortion: Distortion::Radial { k: [0.0; 2] },
        ..made.camera
    };
    for factor in [0.8, 1.4] {
        let intrinsics = Camera {
            focal_px: made.camera.focal_px * factor,
            ..guess
        };
        made.problem.cameras = vec![MapCamera {
            intrinsics,
            source: IntrinsicsPrior::Guessed,
        }];
        made.problem.pairs.clear();
        made.match_window(&RING, &mut Pcg64Mcg::seed_from_u64(1));
        let models = made.map();
        assert_eq!(models[0].model.placed().count(), 30, "factor {factor}");
        let focal = models[0].model.cameras[0].focal_px.x / 1100.0;
        let (centre, _) = made.errors(&models[0]);
        assert!(
            (focal - 1.0).abs() < 5e-3 && centre < 5e-3,
            "factor {factor}: focal {focal:.4}, centre {centre:.2e}"
        );
    }
}

#[test]
fn rotating_camera_gives_no_model() {
    let made = Made::new(
        &Recipe {
            views: 8,
            outliers: 0.1,
            poses: on_the_spot,
            ..RING
        },
        1,
    );
    assert!(!made.problem.pairs.is_empty());
    assert!(made.map().is_empty());
}

#[test]
fn unconnected_images_become_separate_models() {
    let mut made = Made::new(&RING, 2);
    made.problem
        .pairs
        .retain(|pair| (pair.images[0] < 18) == (pair.images[1] < 18));
    let models = made.map();
    let placed: Vec<Vec<u32>> = models
        .iter()
        .map(|mapped| mapped.model.placed().collect())
        .collect();
    assert_eq!(placed, [(0..18).collect::<Vec<_>>(), (18..30).collect()]);
}

#[test]
fn given_poses_stay_and_the_rest_is_placed_relative_to_them() {
    let mut made = Made::new(&RING, 3);
    for (image, truth) in made.problem.images.iter_mut().zip(&made.truth).take(20) {
        image.given = Some(*truth);
    }
    let models = made.map();
    assert_eq!(models[0].start, ModelStart::Given);
    let poses = &models[0].model.poses;
    assert!(
        poses
            .iter()
            .zip(&made.truth)
            .take(20)
            .all(|(found, truth)| *found == Some(*truth))
    );
    for (found, truth) in poses.iter().zip(&made.truth).skip(20) {
        assert!(
            found.is_some_and(|found| found.centre().distance(truth.centre()) < 0.01),
            "{found:?} {truth:?}"
        );
    }
}

#[test]
fn stopped_run_keeps_what_it_placed() {
    let made = Made::new(&RING, 7);
    let progress = Progress::default();
    let watched = progress.clone();
    let watch = std::thread::spawn(move || {
        while watched.report().done < 8 {
            std::thread::yield_now();
        }
        watched.stop();
    });
    let models = map(&made.problem, &MapperOptions::default(), &progress).unwrap();
    watch.join().unwrap();
    let placed = models[0].model.placed().count();
    assert!(
        models.len() == 1 && models[0].stopped && (8..30).contains(&placed),
        "{placed} placed"
    );
    let (centre, rotation) = made.errors(&models[0]);
    assert!(
        centre < 1e-2 && rotation < 0.2,
        "centre {centre:.2e}, rotation {rotation:.3}°"
    );
    assert!(
        map(&made.problem, &MapperOptions::default(), &progress).is_err(),
        "stopped before anything was placed"
    );
}

#[test]
fn image_of_another_place_is_refused() {
    let mut made = Made::new(
        &Recipe {
            outliers: 0.0,
            ..RING
        },
        4,
    );
    let mut rng = Pcg64Mcg::seed_from_u64(9);
    for keypoint in &mut made.problem.images[29].keypoints {
        *keypoint = DVec2::new(rng.random_range(0.0..1280.0), rng.random_range(0.0..960.0));
    }
    let models = made.map();
    assert_eq!(
        models[0].model.placed().collect::<Vec<_>>(),
        (0..29).collect::<Vec<_>>()
    );
    let refusal = models[0].refused[&29];
    assert!(refusal.seen > 100 && refusal.agreeing < 30, "{refusal:?}");
}

#[test]
fn left_out_image_is_placed_in_the_standing_model() {
    let recipe = Recipe {
        outliers: 0.1,
        ..RING
    };
    let made = Made::new(&recipe, 8);
    let mut without = made.problem.clone();
    without.pairs.retain(|pair| !pair.images.contains(&29));
    let options = MapperOptions::default();
    let models = map(&without, &options, &Progress::default()).unwrap();
    assert_eq!(models[0].model.placed().count(), 29);
    let more = |problem: &MapProblem| extend(problem, &models, &options, &Progress::default());
    assert!(more(&without).unwrap().is_none(), "nothing was added");
    // Its keypoints may have become more.
    let mut problem = made.problem.clone();
    problem.images[29].keypoints.push(DVec2::new(3.0, 4.0));
    let extended = more(&problem).unwrap().unwrap();
    assert_eq!(extended.model.placed().count(), 30);
    let (centre, rotation) = made.errors(&extended);
    assert!(
        centre < 1e-3 && rotation < 0.05,
        "centre {centre:.2e}, rotation {rotation:.3}°"
    );
    // As exact as a map of all images from scratch.
    let (whole, _) = made.errors(&made.map()[0]);
    assert!(centre < 1.5 * whole + 1e-5, "{centre:.2e} {whole:.2e}");
}

#[test]
fn images_of_another_model_are_not_taken_over() {
    let mut made = Made::new(&RING, 2);
    let all = made.problem.pairs.clone();
    made.problem
        .pairs
        .retain(|pair| (pair.images[0] < 18) == (pair.images[1] < 18));
    let models = made.map();
    made.problem.pairs = all;
    let (options, progress) = (MapperOptions::default(), Progress::default());
    let extended = extend(&made.problem, &models, &options, &progress).unwrap();
    assert!(extended.is_none());
}

#[test]
fn model_does_not_depend_on_the_number_of_threads() {
    let made = Made::new(&Recipe { views: 12, ..RING }, 6);
    let with = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| made.map())
    };
    let (one, many) = (with(1), with(5));
    assert_eq!(one[0].model.poses, many[0].model.poses);
    assert!(one[0].model.points().eq(many[0].model.points()));
}
