use std::ops::ControlFlow;

use glam::{DVec2, DVec3};

use super::recovery::{errors, run};
use super::scene::{Noise, blur, cameras, disturb, dome, pinhole};
use crate::bundle::{
    Bundle, BundleImage, BundleObservation, BundleOptions, BundleSummary, Loss, Refine, adjust,
};

const ALL: Refine = Refine {
    focal: true,
    principal: true,
    distortion: true,
};

fn noisy(views: usize, points: usize, seed: u64) -> (Bundle, Bundle) {
    let truth = dome(vec![pinhole()], views, points, 0.6, seed);
    let mut found = truth.clone();
    blur(&mut found, 0.5, seed + 1);
    disturb(&mut found, 0.01, 0.02, seed + 2);
    (truth, found)
}

#[test]
fn outliers_do_not_distort_a_robust_adjustment() {
    let (truth, mut found) = noisy(30, 500, 10);
    let mut noise = Noise::new(3);
    for observation in &mut found.observations {
        if noise.uniform(0.0, 1.0) < 0.3 {
            observation.at_px +=
                DVec2::new(noise.uniform(-200.0, 200.0), noise.uniform(-200.0, 200.0));
        }
    }
    let mut bent = found.clone();
    run(
        &mut found,
        &BundleOptions {
            loss: Loss::SoftL1 { px: 1.0 },
            ..BundleOptions::default()
        },
    );
    let (turn, centre) = errors(&found, &truth);
    assert!(turn < 0.1 && centre < 0.002, "{turn}°, {centre}");
    let cauchy = BundleOptions {
        loss: Loss::Cauchy { px: 1.0 },
        ..BundleOptions::default()
    };
    run(&mut found, &cauchy);
    let (turn, centre) = errors(&found, &truth);
    assert!(turn < 0.05 && centre < 0.001, "{turn}°, {centre}");
    run(&mut bent, &BundleOptions::default());
    assert!(errors(&bent, &truth).0 > 0.2);
}

#[test]
fn fixed_parameters_stay_bit_identical() {
    let (truth, mut found) = noisy(10, 200, 20);
    for image in [0, 4] {
        found.images[image] = truth.images[image];
    }
    let start = found.clone();
    let fixed_images = vec![true, false, false, false, true];
    let summary = run(
        &mut found,
        &BundleOptions {
            fixed_images,
            ..BundleOptions::default()
        },
    );
    assert!(summary.converged);
    assert_eq!(
        (found.images[0], found.images[4]),
        (start.images[0], start.images[4])
    );
    assert_eq!(
        (&found.cameras, &found.observations),
        (&start.cameras, &start.observations)
    );
    // Two fixed poses determine the frame: the others reach their true poses without alignment.
    for (image, true_image) in found.images.iter().zip(&truth.images) {
        assert!(
            image
                .camera_from_world
                .centre()
                .distance(true_image.camera_from_world.centre())
                < 0.01
        );
    }
}

#[test]
fn only_poses_change_if_points_are_fixed() {
    let (truth, mut found) = noisy(6, 200, 30);
    found.points.clone_from(&truth.points);
    // If points are fixed, a point seen once constrains its camera too.
    found.observations.retain(|o| o.image != 5 || o.point < 10);
    found.observations.retain(|o| o.image == 5 || o.point >= 10);
    run(
        &mut found,
        &BundleOptions {
            fixed_points: true,
            ..BundleOptions::default()
        },
    );
    assert_eq!(found.points, truth.points);
    for (image, true_image) in found.images.iter().zip(&truth.images) {
        let (pose, truth) = (image.camera_from_world, true_image.camera_from_world);
        assert!(pose.rotation.angle_between(truth.rotation) < 2e-3);
        assert!(pose.centre().distance(truth.centre()) < 1e-2);
    }
}

#[test]
fn shared_and_own_intrinsics_are_recovered_together() {
    let [_, radial, _, full, ..] = cameras()[..] else {
        panic!()
    };
    let truth = dome(vec![radial, pinhole(), full], 30, 600, 0.6, 40);
    let mut found = truth.clone();
    disturb(&mut found, 0.005, 0.01, 41);
    for camera in &mut found.cameras {
        camera.focal_px *= 1.02;
    }
    let options = BundleOptions {
        refine: vec![
            ALL,
            Refine {
                focal: true,
                ..Refine::NOTHING
            },
        ],
        ..BundleOptions::default()
    };
    found.cameras[2] = truth.cameras[2];
    let summary = run(&mut found, &options);
    assert!(
        summary.final_cost < 1e-6 * summary.initial_cost,
        "{summary:?}"
    );
    assert!(
        (found.cameras[0].focal_px / truth.cameras[0].focal_px - 1.0)
            .abs()
            .max_element()
            < 1e-4
    );
    assert!(
        (found.cameras[1].focal_px / truth.cameras[1].focal_px - 1.0)
            .abs()
            .max_element()
            < 1e-4
    );
    assert_eq!(found.cameras[1].principal_px, truth.cameras[1].principal_px);
    assert_eq!(found.cameras[2], truth.cameras[2]);
}

#[test]
fn result_does_not_depend_on_the_number_of_threads() {
    let (_, start) = noisy(20, 600, 50);
    let on = |threads: usize| {
        let mut found = start.clone();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let options = BundleOptions {
            refine: vec![ALL],
            ..BundleOptions::default()
        };
        let summary = pool.install(|| run(&mut found, &options));
        (found, summary)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn order_of_observations_hardly_matters() {
    let (truth, mut found) = noisy(10, 200, 60);
    found.observations.reverse();
    assert!(run(&mut found, &BundleOptions::default()).converged);
    assert!(errors(&found, &truth).0 < 0.1);
}

#[test]
fn stopping_keeps_the_best_state() {
    let (_, mut found) = noisy(20, 300, 70);
    disturb(&mut found, 0.03, 0.1, 71);
    let mut costs = Vec::new();
    let summary = adjust(
        &mut found,
        &BundleOptions::default(),
        &mut |iteration, cost| {
            assert_eq!(iteration, costs.len());
            costs.push(cost);
            if iteration == 2 {
                ControlFlow::Break(())
            } else {
                ControlFlow::Continue(())
            }
        },
    );
    assert!(summary.stopped && !summary.converged && summary.iterations == 2);
    assert_eq!(
        (summary.initial_cost, summary.final_cost),
        (costs[0], costs[2])
    );
    assert!(costs.is_sorted_by(|a, b| a >= b) && costs[2] < costs[0]);
    let again = run(
        &mut found,
        &BundleOptions {
            max_iterations: 0,
            ..BundleOptions::default()
        },
    );
    assert!((again.initial_cost / summary.final_cost - 1.0).abs() < 1e-9);
}

#[test]
fn unobserved_parameters_do_not_change() {
    let (_, mut found) = noisy(6, 100, 80);
    let lonely = BundleImage {
        camera: 0,
        ..found.images[0]
    };
    found.images.push(lonely);
    found.points.extend([DVec3::splat(9.0), DVec3::ZERO]);
    let at_px = DVec2::splat(600.0);
    // Seen once; not finite; of an image and a point that do not exist.
    let odd = [
        (0, 101, at_px),
        (1, 3, DVec2::NAN),
        (77, 3, at_px),
        (1, 770, at_px),
    ];
    found
        .observations
        .extend(odd.map(|(image, point, at_px)| BundleObservation {
            image,
            point,
            at_px,
        }));
    found.images.push(BundleImage {
        camera: 9,
        ..lonely
    });
    found.observations.push(BundleObservation {
        image: 7,
        point: 3,
        at_px,
    });
    let summary = run(
        &mut found,
        &BundleOptions {
            refine: vec![ALL],
            ..BundleOptions::default()
        },
    );
    assert!(summary.converged && summary.final_cost < summary.initial_cost);
    assert_eq!(found.images[6], lonely);
    assert_eq!(found.points[100..], [DVec3::splat(9.0), DVec3::ZERO]);
    assert!(
        found
            .images
            .iter()
            .all(|image| image.camera_from_world.translation.is_finite())
    );
}

#[test]
fn empty_problems_succeed() {
    let nothing = BundleSummary {
        iterations: 0,
        initial_cost: 0.0,
        final_cost: 0.0,
        converged: true,
        stopped: false,
    };
    assert_eq!(
        run(&mut Bundle::default(), &BundleOptions::default()),
        nothing
    );
    let (_, mut unseen) = noisy(3, 10, 90);
    unseen.observations.clear();
    let before = unseen.clone();
    assert_eq!(
        run(
            &mut unseen,
            &BundleOptions {
                refine: vec![ALL],
                ..BundleOptions::default()
            }
        ),
        nothing
    );
    assert_eq!(unseen, before);
    let (_, mut held) = noisy(3, 30, 91);
    let options = BundleOptions {
        fixed_points: true,
        fixed_images: vec![true; 3],
        ..BundleOptions::default()
    };
    let before = held.clone();
    assert!(run(&mut held, &options).converged);
    assert_eq!(held, before);
}

#[test]
fn two_views_of_few_points_stay_finite() {
    for points in 1..8 {
        let mut found = dome(vec![pinhole()], 2, points, 1.0, 100 + points as u64);
        blur(&mut found, 5.0, 101);
        let summary = run(
            &mut found,
            &BundleOptions {
                refine: vec![ALL],
                ..BundleOptions::default()
            },
        );
        assert!(summary.final_cost.is_finite() && summary.final_cost <= summary.initial_cost);
        assert!(found.points.iter().all(|x| x.is_finite()));
        assert!(
            found
                .images
                .iter()
                .all(|i| (i.camera_from_world.rotation.length() - 1.0).abs() < 1e-9)
        );
    }
}

#[test]
fn point_behind_a_camera_is_ignored() {
    let (truth, mut found) = noisy(12, 300, 110);
    let behind = found.images[3]
        .camera_from_world
        .inverse()
        .transform(-DVec3::Z);
    found.points[7] = behind;
    let (cost_with, cost_without) = {
        let mut without = found.clone();
        without
            .observations
            .retain(|o| !(o.point == 7 && o.image == 3));
        let options = BundleOptions {
            max_iterations: 0,
            ..BundleOptions::default()
        };
        (
            run(&mut found.clone(), &options).initial_cost,
            run(&mut without, &options).initial_cost,
        )
    };
    assert_eq!(cost_with, cost_without);
    let summary = run(
        &mut found,
        &BundleOptions {
            loss: Loss::SoftL1 { px: 1.0 },
            ..BundleOptions::default()
        },
    );
    assert!(summary.final_cost.is_finite());
    assert!(errors(&found, &truth).0 < 0.1);
}
