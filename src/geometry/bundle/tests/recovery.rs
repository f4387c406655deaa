use std::ops::ControlFlow;

use glam::DVec3;

use super::scene::{Noise, blur, cameras, disturb, dome, pinhole};
use crate::bundle::{
    Bundle, BundleImage, BundleObservation, BundleOptions, BundleSummary, Refine, adjust,
};
use crate::{Alignment, Pose, Similarity};

const ALL: Refine = Refine {
    focal: true,
    principal: true,
    distortion: true,
};

/// Adjusts until convergence.
pub fn run(bundle: &mut Bundle, options: &BundleOptions) -> BundleSummary {
    adjust(bundle, options, &mut |_, _| ControlFlow::Continue(()))
}

/// Returns the largest rotation error in degrees and the largest centre error, after alignment.
///
/// The centre error is relative to the dome's radius.
pub fn errors(found: &Bundle, truth: &Bundle) -> (f64, f64) {
    let centres = |b: &Bundle| {
        b.images
            .iter()
            .map(|i| i.camera_from_world.centre())
            .collect::<Vec<DVec3>>()
    };
    let world = Similarity::align(&centres(found), &centres(truth), Alignment::Sim3).unwrap();
    let of = |(f, t): (&BundleImage, &BundleImage)| {
        let pose = world.transform_camera(&f.camera_from_world);
        let turn = pose
            .rotation
            .angle_between(t.camera_from_world.rotation)
            .to_degrees();
        (
            turn,
            pose.centre().distance(t.camera_from_world.centre()) / 4.0,
        )
    };
    let each = found.images.iter().zip(&truth.images).map(of);
    each.fold((0.0, 0.0), |a, b| (f64::max(a.0, b.0), f64::max(a.1, b.1)))
}

#[test]
fn noisy_views_are_recovered() {
    let truth = dome(vec![pinhole()], 30, 500, 0.6, 1);
    let mut found = truth.clone();
    blur(&mut found, 0.5, 2);
    disturb(&mut found, 0.02, 0.05, 3);
    let summary = run(&mut found, &BundleOptions::default());
    let (turn, centre) = errors(&found, &truth);
    assert!(summary.converged && summary.iterations <= 12, "{summary:?}");
    assert!(turn < 0.05 && centre < 0.001, "{turn}°, {centre}");
    assert_eq!(found.cameras, truth.cameras);
    // Two residuals per observation of 0.25 px² each, minus the parameters.
    let free = 2 * truth.observations.len() - 6 * 30 - 3 * 500 + 7;
    let expected = 0.5 * 0.25 * free as f64;
    assert!(
        (summary.final_cost / expected - 1.0).abs() < 0.05,
        "{summary:?} {expected}"
    );
}

#[test]
fn intrinsics_of_every_model_are_recovered() {
    for camera in cameras() {
        let truth = dome(vec![camera], 30, 1500, 0.6, 4);
        let mut found = truth.clone();
        blur(&mut found, 0.5, 5);
        disturb(&mut found, 0.01, 0.02, 6);
        found.cameras[0].focal_px *= 1.03;
        found.cameras[0].principal_px += 5.0;
        let options = BundleOptions {
            refine: vec![ALL],
            ..BundleOptions::default()
        };
        run(&mut found, &options);
        let (turn, centre) = errors(&found, &truth);
        let camera = found.cameras[0];
        let focal = camera.focal_px / truth.cameras[0].focal_px;
        assert!(
            turn < 0.05 && centre < 0.001,
            "{camera:?}: {turn}°, {centre}"
        );
        assert!((focal - 1.0).abs().max_element() < 1e-3, "{camera:?}");
        assert!((focal.x - focal.y).abs() < 1e-12, "{camera:?}");
        assert!(
            camera.principal_px.distance(truth.cameras[0].principal_px) < 1.0,
            "{camera:?}"
        );
    }
}

#[test]
fn long_sequence_is_recovered() {
    // Each image of a corridor sees only its neighbours' points: the matrix is a narrow band.
    let mut truth = dome(vec![pinhole()], 120, 0, 1.0, 6);
    let mut noise = Noise::new(7);
    for (i, image) in truth.images.iter_mut().enumerate() {
        let rotation = glam::DQuat::from_scaled_axis(noise.vector(0.05));
        let centre = DVec3::new(0.3 * i as f64, (0.2 * i as f64).sin(), 0.0);
        image.camera_from_world = Pose {
            rotation,
            translation: -(rotation * centre),
        };
    }
    for i in 0..3000u32 {
        let along = 36.0 * f64::from(i) / 3000.0;
        truth.points.push(DVec3::new(
            along,
            noise.uniform(-1.0, 1.0),
            noise.uniform(2.0, 4.0),
        ));
        for (image, of) in truth.images.iter().enumerate() {
            let seen =
                truth.cameras[0].project(of.camera_from_world.transform(truth.points[i as usize]));
            let Some(at_px) = seen.filter(|&at| truth.cameras[0].contains(at)) else {
                continue;
            };
            truth.observations.push(BundleObservation {
                image: image as u32,
                point: i,
                at_px,
            });
        }
    }
    let mut found = truth.clone();
    blur(&mut found, 0.5, 8);
    disturb(&mut found, 0.005, 0.02, 9);
    let summary = run(&mut found, &BundleOptions::default());
    let (turn, centre) = errors(&found, &truth);
    assert!(
        summary.converged && turn < 0.1 && centre < 0.01,
        "{summary:?} {turn}°, {centre}"
    );
}
