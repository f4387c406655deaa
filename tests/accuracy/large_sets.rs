//! Mapping of many images: two turns around a cylinder, from verified pairs to adjusted cameras.

use std::f64::consts::TAU;
use std::ops::ControlFlow;
use std::time::Instant;

use glam::{DMat3, DQuat, DVec2, DVec3};
use ostra_core::job::Progress;
use ostra_geometry::bundle::{Bundle, BundleImage, BundleObservation, BundleOptions, adjust};
use ostra_geometry::{
    Alignment, Camera, Pose, TrajectoryMetrics, TwoViewOptions, estimate_two_view,
};
use ostra_reconstruct::sfm::{
    IntrinsicsPrior, MapCamera, MapImage, MapProblem, MapperOptions, VerifiedPair, map,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use rayon::prelude::*;

const IMAGES: usize = 400;
const POINTS: usize = 800;
/// Number of images in a turn; those of the second turn are between those of the first one.
const TURN: f64 = 200.5;
/// Number of following images that an image is matched with.
const WINDOW: usize = 6;
/// Standard deviation of keypoints, pixels.
const NOISE_PX: f64 = 0.5;
/// Share of wrong matches.
const WRONG: f64 = 0.2;

/// Returns the pose of an image, 4 units from the axis; the second turn is higher.
fn pose(image: usize) -> Pose {
    let angle = TAU * image as f64 / TURN;
    let height = 0.8 * (2.0 * angle).sin() + if image as f64 > TURN { 1.0 } else { 0.0 };
    let centre = DVec3::new(4.0 * angle.sin(), height, -4.0 * angle.cos());
    let forward = -centre.normalize();
    let right = DVec3::Y.cross(forward).normalize();
    let camera_from_world = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let rotation = DQuat::from_mat3(&camera_from_world);
    Pose {
        rotation,
        translation: -(rotation * centre),
    }
}

/// The images that an image is matched with: its successors and those of the next turn.
fn partners(image: usize) -> impl Iterator<Item = usize> {
    let next_turn = image + TURN as usize;
    (image + 1..=image + WINDOW)
        .chain(next_turn..next_turn + 2)
        .filter(|&other| other < IMAGES)
}

/// The points, the keypoints of all images, and which point each of them shows.
struct Seen {
    places: Vec<DVec3>,
    keypoints: Vec<Vec<DVec2>>,
    points: Vec<Vec<usize>>,
}

fn seen(camera: &Camera, truth: &[Pose], rng: &mut Pcg64Mcg) -> Seen {
    let places: Vec<DVec3> = (0..POINTS)
        .map(|_| {
            let (angle, height) = (rng.random_range(0.0..TAU), rng.random_range(-1.0..1.0));
            DVec3::new(angle.sin(), height, angle.cos())
        })
        .collect();
    let mut seen = Seen {
        places,
        keypoints: Vec::new(),
        points: Vec::new(),
    };
    for pose in truth {
        let (mut keypoints, mut points) = (Vec::new(), Vec::new());
        for (number, place) in seen.places.iter().enumerate() {
            let towards = (pose.centre() - *place).normalize();
            let faces = towards.dot(DVec3::new(place.x, 0.0, place.z)) > 0.3;
            let at = camera.project(pose.transform(*place));
            if let Some(at) = at.filter(|at| faces && camera.contains(*at)) {
                let mut normal = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
                keypoints.push(at + NOISE_PX * DVec2::new(normal(), normal()));
                points.push(number);
            }
        }
        seen.keypoints.push(keypoints);
        seen.points.push(points);
    }
    seen
}

/// Returns the poses that fit all keypoints best, found from the true poses and points.
fn best_poses(camera: &Camera, truth: &[Pose], seen: &Seen) -> Vec<Pose> {
    let image = |&camera_from_world| BundleImage {
        camera: 0,
        camera_from_world,
    };
    let observations = (0..IMAGES).flat_map(|image| {
        let both = seen.points[image].iter().zip(&seen.keypoints[image]);
        both.map(move |(&point, &at_px)| BundleObservation {
            image: image as u32,
            point: point as u32,
            at_px,
        })
    });
    let mut bundle = Bundle {
        cameras: vec![*camera],
        images: truth.iter().map(image).collect(),
        points: seen.places.clone(),
        observations: observations.collect(),
    };
    let options = BundleOptions {
        function_tolerance: 1e-9,
        ..BundleOptions::default()
    };
    adjust(&mut bundle, &options, &mut |_, _| ControlFlow::Continue(()));
    let poses = bundle.images.iter().map(|image| image.camera_from_world);
    poses.collect()
}

/// Returns the largest centre error as a share of the extent, and the largest rotation error in
/// degrees.
fn errors(found: &[Pose], truth: &[Pose]) -> [f64; 2] {
    let error = TrajectoryMetrics::between(found, truth, Alignment::Sim3).unwrap();
    [error.centre.max / error.extent, error.rotation_deg.max]
}

/// Matches two images by the points that both see, some of them wrongly, and verifies the matches.
fn verified(camera: &Camera, seen: &Seen, [a, b]: [usize; 2]) -> Option<VerifiedPair> {
    let mut rng = Pcg64Mcg::seed_from_u64((a * IMAGES + b) as u64);
    let in_b: Vec<(usize, usize)> = seen.points[b]
        .iter()
        .enumerate()
        .map(|(keypoint, &point)| (point, keypoint))
        .collect();
    let mut matches: Vec<[u32; 2]> = Vec::new();
    for (keypoint, point) in seen.points[a].iter().enumerate() {
        let Ok(found) = in_b.binary_search_by_key(point, |&(point, _)| point) else {
            continue;
        };
        let other = if rng.random_range(0.0..1.0) < WRONG {
            rng.random_range(0..in_b.len())
        } else {
            in_b[found].1
        };
        matches.push([keypoint as u32, other as u32]);
    }
    let at_px: Vec<[DVec2; 2]> = matches
        .iter()
        .map(|&[i, j]| [seen.keypoints[a][i as usize], seen.keypoints[b][j as usize]])
        .collect();
    let found = estimate_two_view([camera; 2], true, &at_px, &TwoViewOptions::default())?;
    Some(VerifiedPair {
        images: [a as u32, b as u32],
        matches: found.inliers.iter().map(|&i| matches[i as usize]).collect(),
        kind: found.kind,
        second_from_first: found.second_from_first,
        parallax: found.parallax,
    })
}

fn four_hundred_images_are_placed_and_adjusted_together() {
    let mut rng = Pcg64Mcg::seed_from_u64(46);
    let camera = Camera::pinhole(1280, 960, [1100.0; 2], [640.0, 480.0]);
    let truth: Vec<Pose> = (0..IMAGES).map(pose).collect();
    let seen = seen(&camera, &truth, &mut rng);
    let pairs: Vec<[usize; 2]> = (0..IMAGES)
        .flat_map(|a| partners(a).map(move |b| [a, b]))
        .collect();
    let image = |keypoints: &Vec<DVec2>| MapImage {
        camera: 0,
        keypoints: keypoints.clone(),
        given: None,
    };
    let problem = MapProblem {
        cameras: vec![MapCamera {
            intrinsics: camera,
            source: IntrinsicsPrior::Given,
        }],
        images: seen.keypoints.iter().map(image).collect(),
        pairs: pairs
            .par_iter()
            .filter_map(|&pair| verified(&camera, &seen, pair))
            .collect(),
    };
    let begun = Instant::now();
    let models = map(&problem, &MapperOptions::default(), &Progress::default()).unwrap();
    let seconds = begun.elapsed().as_secs_f64();
    assert_eq!(models.len(), 1);
    let model = &models[0].model;
    assert_eq!(model.placed().count(), IMAGES);
    let found: Vec<Pose> = model.poses.iter().map(|pose| pose.unwrap()).collect();
    let mapped = errors(&found, &truth);
    let best = errors(&best_poses(&camera, &truth, &seen), &truth);
    println!(
        "{IMAGES} images: {seconds:.0} s; largest centre error {:.3} % of the extent (at best {:.3}), rotation {:.3}° ({:.3})",
        100.0 * mapped[0],
        100.0 * best[0],
        mapped[1],
        best[1]
    );
    // Wrong matches and keypoints that are left out cost a little.
    assert!(
        mapped[0] < 1.25 * best[0] && mapped[1] < 1.25 * best[1],
        "{mapped:?} {best:?}"
    );
}

crate::registry::tests! {
    Nothing => four_hundred_images_are_placed_and_adjusted_together;
}
