//! Surfaces of a ball and of sheets seen from all sides.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, Weak};

use glam::{DMat3, DVec2, DVec3, Vec3};
use rustc_hash::FxHashMap;

use super::*;
use crate::fuse::Views;
use crate::{LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameCamera, Image, ImageSource, Orientation};
use ostra_geometry::{Camera, Distortion, Pose};
use ostra_masks::LabelMask;

const SIZE: u32 = 160;

/// A ball of radius 1 at the origin, rendered exactly from all sides.
///
/// It is red where x > 0 and blue elsewhere.
#[derive(Default)]
struct Ball {
    frames: Vec<Frame>,
    images: Vec<Arc<Image>>,
    depths: Vec<Arc<DepthMap>>,
}

impl Views for Ball {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }
    fn has_depth(&self, _: usize) -> bool {
        true
    }
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        Ok(self.images[index].clone())
    }
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(Some(self.depths[index].clone()))
    }
    fn mask(&self, _: usize) -> Option<Arc<LabelMask>> {
        None
    }
}

impl Ball {
    fn new(distortion: Distortion) -> Self {
        let mut ball = Self::default();
        for turn in 0..10 {
            let angle = f64::from(turn) * std::f64::consts::TAU / 10.0;
            let height = if turn % 2 == 0 { 1.2 } else { -1.2 };
            ball.add(
                DVec3::new(angle.cos() * 3.0, height, angle.sin() * 3.0),
                distortion,
            );
        }
        // Straight from above and below, slightly off the axis so that "up" is defined.
        ball.add(DVec3::new(0.01, 3.2, 0.0), distortion);
        ball.add(DVec3::new(0.01, -3.2, 0.0), distortion);
        ball
    }

    fn add(&mut self, eye: DVec3, distortion: Distortion) {
        let forward = -eye.normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let pose = Pose::from_matrix(rotation, rotation * -eye).unwrap();
        let middle = f64::from(SIZE) / 2.0;
        let camera = Camera {
            distortion,
            ..Camera::pinhole(SIZE, SIZE, [190.0, 190.0], [middle, middle])
        };
        let seen = |index: u32| {
            let at = DVec2::new(f64::from(index % SIZE) + 0.5, f64::from(index / SIZE) + 0.5);
            let ray = pose.rotation.conjugate() * camera.unproject(at).extend(1.0);
            let (a, b, c) = (
                ray.length_squared(),
                eye.dot(ray),
                eye.length_squared() - 1.0,
            );
            let root = b * b - a * c;
            let depth = if root > 0.0 {
                (-b - root.sqrt()) / a
            } else {
                0.0
            };
            let color = if (eye + ray * depth).x > 0.0 {
                [200, 10, 10]
            } else {
                [10, 10, 200]
            };
            (depth as f32, color)
        };
        let (depths, pixels) = (0..SIZE * SIZE).map(seen).unzip();
        self.frames.push(Frame {
            name: format!("{:03}", self.frames.len()),
            width: SIZE,
            height: SIZE,
            image: ImageSource::File {
                path: "none".into(),
                orientation: Orientation(1),
            },
            depth: None,
            camera: Some(FrameCamera::given(camera, Some(pose))),
        });
        self.images.push(Arc::new(Image {
            width: SIZE,
            height: SIZE,
            pixels,
        }));
        self.depths.push(Arc::new(DepthMap {
            width: SIZE,
            height: SIZE,
            depths,
        }));
    }

    fn surface(&self, voxel: f64) -> LabelledMesh {
        let options = VolumeOptions {
            voxel,
            ..VolumeOptions::default()
        };
        reconstruct_surface(self, &options, &Progress::default())
            .unwrap()
            .mesh
    }
}

fn enclosed(mesh: &LabelledMesh) -> f32 {
    let of = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|vertex| mesh.vertices.positions[vertex as usize]);
        a.dot(b.cross(c)) / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

#[test]
fn ball_becomes_a_closed_ball() {
    let mesh = Ball::new(Distortion::None).surface(0.04);
    let mut sides: FxHashMap<(u32, u32), i32> = FxHashMap::default();
    for &[a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            *sides.entry((from.min(to), from.max(to))).or_default() +=
                if from < to { 1 } else { -1 };
        }
    }
    let open = sides.values().filter(|&&balance| balance != 0).count();
    assert_eq!(
        open,
        0,
        "of {} sides: every one is met by one the other way",
        sides.len()
    );
    let volume = enclosed(&mesh) / (4.0 / 3.0 * std::f32::consts::PI);
    assert!((volume - 1.0).abs() < 0.01, "{volume}");
    let mut errors: Vec<f32> = mesh
        .vertices
        .positions
        .iter()
        .map(|x| (x.length() - 1.0).abs())
        .collect();
    errors.sort_by(f32::total_cmp);
    let (median, most) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    assert!(
        median < 0.0015 && most < 0.02,
        "median {median}, most {most}"
    );
    let outward = |(x, normal): &(&Vec3, &Vec3)| x.normalize().dot(**normal) > 0.97;
    let outward = mesh
        .vertices
        .positions
        .iter()
        .zip(&mesh.vertices.normals)
        .filter(outward)
        .count();
    assert!(
        outward * 100 > mesh.vertices.len() * 99,
        "{outward} of {}",
        mesh.vertices.len()
    );
    let right = mesh
        .vertices
        .positions
        .iter()
        .zip(&mesh.vertices.colors)
        .filter(|(x, _)| x.x.abs() > 0.1);
    for (x, color) in right {
        assert_eq!(color[0] > color[2], x.x > 0.0, "{x} is {color:?}");
    }
}

#[test]
fn lens_distortion_is_corrected() {
    let mesh = Ball::new(Distortion::Radial { k: [-0.25, 0.05] }).surface(0.04);
    let far = mesh
        .vertices
        .positions
        .iter()
        .filter(|x| (x.length() - 1.0).abs() > 0.015)
        .count();
    assert!(
        mesh.vertices.len() > 5000 && far * 200 < mesh.vertices.len(),
        "{far} of {}",
        mesh.vertices.len()
    );
}

#[test]
fn result_does_not_depend_on_thread_count() {
    let ball = Ball::new(Distortion::None);
    let alone = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert!(alone.install(|| ball.surface(0.06)) == ball.surface(0.06));
}

#[test]
fn sheet_thinner_than_the_truncation_keeps_both_sides() {
    // Two planes 3 voxels apart, each seen from its own side only.
    let mut scene = Ball::default();
    for side in [-1.0, 1.0] {
        for aside in [-0.3, 0.0, 0.3] {
            scene.add(DVec3::new(aside, 0.2, 3.0 * side), Distortion::None);
            let plane = side * 0.06;
            let frame = scene.frames.last().unwrap();
            let (camera, pose) = frame.posed_camera().unwrap();
            let eye = pose.centre();
            let depth = |index: u32| {
                let at = DVec2::new(f64::from(index % SIZE) + 0.5, f64::from(index / SIZE) + 0.5);
                let ray = pose.rotation.conjugate() * camera.unproject(at).extend(1.0);
                let depth = (plane - eye.z) / ray.z;
                let x = eye + ray * depth;
                if x.x.abs().max(x.y.abs()) < 0.6 {
                    depth as f32
                } else {
                    0.0
                }
            };
            let depths = (0..SIZE * SIZE).map(depth).collect();
            *scene.depths.last_mut().unwrap() = Arc::new(DepthMap {
                width: SIZE,
                height: SIZE,
                depths,
            });
        }
    }
    let mesh = scene.surface(0.04);
    let inner = mesh
        .vertices
        .positions
        .iter()
        .filter(|x| x.x.abs().max(x.y.abs()) < 0.45);
    let off: Vec<f32> = inner.map(|x| (x.z.abs() - 0.06).abs()).collect();
    let worst = off.iter().copied().fold(0.0, f32::max);
    assert!(
        off.len() > 800 && worst < 0.012,
        "{} vertices, up to {worst} off",
        off.len()
    );
}

#[test]
fn surface_beyond_its_memory_limit_is_an_error() {
    let options = VolumeOptions {
        voxel: 0.01,
        max_bytes: 1 << 20,
        ..VolumeOptions::default()
    };
    let made = reconstruct_surface(&Ball::new(Distortion::None), &options, &Progress::default());
    assert!(matches!(made, Err(SceneError::TooLarge { .. })));
}

/// Creates each depth map on request, and counts those that are still held.
struct Lent {
    ball: Ball,
    lent: Mutex<Vec<Weak<DepthMap>>>,
    most: AtomicUsize,
}

impl Views for Lent {
    fn frames(&self) -> &[Frame] {
        self.ball.frames()
    }
    fn has_depth(&self, index: usize) -> bool {
        self.ball.has_depth(index)
    }
    fn image(&self, index: usize) -> Result<Arc<Image>, SceneError> {
        self.ball.image(index)
    }
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        let depth = Arc::new((*self.ball.depths[index]).clone());
        let mut lent = self.lent.lock().unwrap();
        lent.push(Arc::downgrade(&depth));
        let held = lent.iter().filter(|depth| depth.strong_count() > 0).count();
        self.most.fetch_max(held, Ordering::Relaxed);
        Ok(Some(depth))
    }
    fn mask(&self, index: usize) -> Option<Arc<LabelMask>> {
        self.ball.mask(index)
    }
}

#[test]
fn depth_maps_are_released_after_they_are_added() {
    let lent = Lent {
        ball: Ball::new(Distortion::None),
        lent: Mutex::default(),
        most: AtomicUsize::new(0),
    };
    let options = VolumeOptions {
        voxel: 0.06,
        ..VolumeOptions::default()
    };
    let surface = reconstruct_surface(&lent, &options, &Progress::default()).unwrap();
    assert_eq!(surface.frames, lent.ball.frames.len());
    let most = lent.most.into_inner();
    assert!(most <= 2, "{most} of {} at a time", lent.ball.frames.len());
}

#[test]
fn options_out_of_range_are_errors() {
    let ball = Ball::new(Distortion::None);
    for options in [
        VolumeOptions {
            voxel: 0.0,
            ..VolumeOptions::default()
        },
        VolumeOptions {
            voxel: f64::NAN,
            ..VolumeOptions::default()
        },
        VolumeOptions {
            truncation: 1.0,
            ..VolumeOptions::default()
        },
        VolumeOptions {
            min_weight: -1.0,
            ..VolumeOptions::default()
        },
    ] {
        assert!(
            reconstruct_surface(&ball, &options, &Progress::default()).is_err(),
            "{options:?}"
        );
    }
}
