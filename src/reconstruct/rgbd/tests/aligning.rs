use glam::{DQuat, DVec3};

use super::room::{camera, hand_at, seen};
use crate::rgbd::align::align;
use crate::rgbd::link::ViewAgreement;
use crate::rgbd::pyramid::{LEVELS, Pyramid};
use crate::rgbd::rgbd_image::RgbdImage;
use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, Distortion, Pose};

fn pyramid(pose: &Pose, seed: u64) -> Pyramid {
    let (image, depth) = seen(pose, 0.0015, seed);
    Pyramid::new(&RgbdImage::new(&image, &depth, &camera()))
}

fn errors(found: &Pose, truth: &Pose) -> (f64, f64) {
    (
        found.rotation.angle_between(truth.rotation).to_degrees(),
        found.centre().distance(truth.centre()),
    )
}

#[test]
fn neighbouring_views_are_aligned_without_a_guess() {
    for k in 0..6 {
        let (a, b) = (
            hand_at(3.0 * f64::from(k)),
            hand_at(3.0 * f64::from(k) + 1.0),
        );
        let truth = b.compose(&a.inverse());
        let (source, target) = (pyramid(&a, 1), pyramid(&b, 2));
        let found = align(&source, &target, &Pose::IDENTITY, LEVELS - 1).unwrap();
        let (turn, shift) = errors(&found.target_from_source, &truth);
        assert!(turn < 0.1 && shift < 0.004, "{k}: {turn} deg, {shift} m");
        let agreement = ViewAgreement::of(&source, &target, &found.target_from_source);
        assert!(
            agreement.overlap > 0.6 && agreement.consistent > 0.98 && agreement.likeness > 0.9,
            "{agreement:?}"
        );
    }
}

#[test]
fn wrong_pose_lowers_the_agreement() {
    let (a, b) = (hand_at(0.0), hand_at(3.0));
    let truth = b.compose(&a.inverse());
    let (source, target) = (pyramid(&a, 1), pyramid(&b, 2));
    for (turn, shift) in [
        (DVec3::new(0.0, 0.12, 0.0), DVec3::ZERO),
        (DVec3::ZERO, DVec3::new(0.15, 0.0, 0.2)),
    ] {
        let off = Pose {
            rotation: DQuat::from_scaled_axis(turn),
            translation: shift,
        }
        .compose(&truth);
        let wrong = ViewAgreement::of(&source, &target, &off);
        assert!(wrong.consistent < 0.85 || wrong.likeness < 0.5, "{wrong:?}");
    }
}

/// The rows of the information for a shift along a wall are almost zero, those for a shift against it are not.
#[test]
fn information_shows_what_a_bare_wall_leaves_open() {
    let camera = camera();
    let pixels = camera.width as usize * camera.height as usize;
    let image = Image {
        width: camera.width,
        height: camera.height,
        pixels: vec![[128; 3]; pixels],
    };
    let depth = DepthMap {
        width: camera.width,
        height: camera.height,
        depths: vec![2.0; pixels],
    };
    let wall = Pyramid::new(&RgbdImage::new(&image, &depth, &camera));
    let found = align(&wall, &wall, &Pose::IDENTITY, LEVELS - 1).unwrap();
    let [along, against] = [3, 5].map(|axis| found.information[axis][axis]);
    assert!(against > 0.5 && along < 1e-3 * against, "{along} {against}");
}

#[test]
fn view_is_small_and_undistorted_and_keeps_depth() {
    let large = Camera::pinhole(1280, 960, [1160.0, 1160.0], [642.0, 476.0]);
    let bent = Camera {
        distortion: Distortion::Radial { k: [-0.15, 0.02] },
        ..large
    };
    // A slanted plane: z = 2 + 0.3 x.
    let depth_at = |ray: glam::DVec2| 2.0 / (1.0 - 0.3 * ray.x);
    let depths = (0..960 * 1280).map(|at| {
        let at_px = glam::DVec2::new(f64::from(at % 1280) + 0.5, f64::from(at / 1280) + 0.5);
        depth_at(bent.unproject(at_px)) as f32
    });
    let depth = DepthMap {
        width: 1280,
        height: 960,
        depths: depths.collect(),
    };
    let image = Image {
        width: 1280,
        height: 960,
        pixels: vec![[255, 0, 0]; 1280 * 960],
    };
    let view = RgbdImage::new(&image, &depth, &bent);
    assert_eq!(
        (
            view.camera.width,
            view.camera.height,
            view.camera.distortion
        ),
        (320, 240, Distortion::None)
    );
    assert!(view.grey.iter().all(|&grey| grey == 76));
    for pixel in (0..320 * 240).step_by(97) {
        let point = view.point(pixel).unwrap().as_dvec3();
        assert!(
            (point.z - depth_at(point.truncate() / point.z)).abs() < 2e-3,
            "{point}"
        );
    }
    let normals = &Pyramid::new(&view).levels[0].normals;
    let truth = DVec3::new(0.3, 0.0, -1.0).normalize().as_vec3();
    let near = normals
        .iter()
        .filter(|normal| normal.dot(truth) > 0.995)
        .count();
    assert!(near > normals.len() * 9 / 10, "{near}");
}
