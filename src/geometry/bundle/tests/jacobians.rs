use glam::{DVec2, DVec3};

use super::scene::{cameras, dome};
use crate::blocks::{BLOCK, Column6};
use crate::bundle::layout::Layout;
use crate::bundle::layout::Observation;
use crate::bundle::state::CameraState;
use crate::bundle::{Bundle, BundleOptions, Refine};

const STEP: f64 = 1e-6;

/// One view of one camera with everything refined: the pose is block 0, the intrinsics follow.
fn single_view(bundle: &Bundle) -> (CameraState, Layout) {
    let refine = vec![Refine {
        focal: true,
        principal: true,
        distortion: true,
    }];
    let state = CameraState::new(
        bundle,
        &BundleOptions {
            refine,
            ..BundleOptions::default()
        },
    );
    let blocks = 1 + state.intrinsics(0).div_ceil(BLOCK);
    let layout = Layout {
        poses: vec![Some(0)],
        intrinsics: std::iter::once(1..blocks).collect(),
        first: vec![0; blocks],
        fixed_points: false,
    };
    (state, layout)
}

/// Returns the derivative of a residual by one unknown of poses and intrinsics.
///
/// It is computed by central differences.
fn difference(
    state: &CameraState,
    layout: &Layout,
    point: DVec3,
    observation: &Observation,
    unknown: usize,
) -> DVec2 {
    let residual = |by: f64| {
        let mut step: Vec<Column6> = vec![[0.0; BLOCK]; layout.len()];
        step[unknown / BLOCK][unknown % BLOCK] = by;
        state
            .moved(layout, &step)
            .observe(point, observation)
            .unwrap()
            .residual
    };
    (residual(STEP) - residual(-STEP)) / (2.0 * STEP)
}

#[test]
fn derivatives_match_finite_differences_for_every_lens() {
    for camera in cameras() {
        let bundle = dome(vec![camera], 1, 40, 1.0, 7);
        let (state, layout) = single_view(&bundle);
        for seen in &bundle.observations {
            let point = bundle.points[seen.point as usize];
            let observation = Observation {
                image: 0,
                at_px: seen.at_px + DVec2::new(3.0, -2.0),
            };
            let observed = state.observe(point, &observation).unwrap();
            assert!(
                observed.residual.abs_diff_eq(DVec2::new(-3.0, 2.0), 1e-9),
                "{camera:?}"
            );
            let close = |exact: DVec2, differenced: DVec2, what: &str| {
                let scale = 1.0 + exact.length();
                assert!(
                    exact.abs_diff_eq(differenced, 1e-5 * scale),
                    "{what} of {camera:?}: {exact} {differenced}"
                );
            };
            for axis in 0..3 {
                let shift = STEP * DVec3::AXES[axis];
                let residual = |x: DVec3| state.observe(x, &observation).unwrap().residual;
                let differenced =
                    (residual(point + shift) - residual(point - shift)) / (2.0 * STEP);
                close(
                    DVec2::from(observed.by_point.map(|d| d[axis])),
                    differenced,
                    "point",
                );
            }
            for unknown in 0..BLOCK {
                let differenced = difference(&state, &layout, point, &observation, unknown);
                close(
                    DVec2::from(observed.by_pose().map(|row| row[unknown])),
                    differenced,
                    "pose",
                );
            }
            let [first, second] = observed.by_intrinsics();
            for unknown in 0..(layout.len() - 1) * BLOCK {
                let differenced = difference(&state, &layout, point, &observation, BLOCK + unknown);
                let rows = if unknown < BLOCK { &first } else { &second };
                close(
                    DVec2::from(rows.map(|row| row[unknown % BLOCK])),
                    differenced,
                    "intrinsics",
                );
            }
        }
    }
}

#[test]
fn lens_projects_like_the_camera() {
    for camera in cameras() {
        let (state, _) = single_view(&Bundle {
            images: dome(vec![camera], 1, 1, 1.0, 8).images,
            cameras: vec![camera],
            ..Bundle::default()
        });
        let pose = dome(vec![camera], 1, 1, 1.0, 8).images[0].camera_from_world;
        for i in 0..400 {
            let at = DVec3::new(f64::from(i % 20) - 9.5, f64::from(i / 20) - 9.5, 0.0) * 0.3;
            let x = at + DVec3::Z;
            let world = pose.inverse().transform(x);
            // The fold is searched with other steps than in the camera: near it, they may differ.
            let expected = camera.project(pose.transform(world));
            let observation = |at_px| Observation { image: 0, at_px };
            match (expected, state.sees(world, 0)) {
                (Some(at_px), true) => {
                    assert!(
                        state
                            .observe(world, &observation(at_px))
                            .unwrap()
                            .residual
                            .length()
                            < 1e-6,
                        "{camera:?}"
                    );
                }
                (seen, sees) => assert_eq!(seen.is_some(), sees, "{camera:?} at {x}"),
            }
        }
        assert!(!state.sees(pose.inverse().transform(-DVec3::Z), 0));
    }
}
