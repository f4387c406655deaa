use glam::{DMat3, DVec2, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::bundle::{Bundle, BundleImage, BundleObservation};
use crate::{Camera, Distortion, Pose};

/// Seeded noise.
pub struct Noise(Pcg64Mcg);

impl Noise {
    pub fn new(seed: u64) -> Self {
        Self(Pcg64Mcg::seed_from_u64(seed))
    }

    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        self.0.random_range(low..high)
    }

    pub fn normal(&mut self) -> f64 {
        let near: f64 = self.0.random_range(f64::EPSILON..1.0);
        (-2.0 * near.ln()).sqrt() * self.0.random_range(0.0..std::f64::consts::TAU).cos()
    }

    pub fn vector(&mut self, deviation: f64) -> DVec3 {
        deviation * DVec3::new(self.normal(), self.normal(), self.normal())
    }
}

/// Returns a camera of every model, with realistic coefficients.
pub fn cameras() -> Vec<Camera> {
    let models = [
        Distortion::None,
        Distortion::Radial { k: [-0.2, 0.03] },
        Distortion::OpenCv {
            k: [-0.28, 0.07],
            p: [1e-3, -2e-3],
        },
        Distortion::FullOpenCv {
            k: [0.3, 0.05, 0.002, 0.5, 0.03, 0.001],
            p: [-1e-3, 5e-4],
        },
        Distortion::OpenCvFisheye {
            k: [0.05, -0.01, 0.004, -0.001],
        },
        Distortion::ThinPrismFisheye {
            k: [0.02, -0.01, 0.003, 1e-3],
            p: [4e-3, -7e-3],
            s: [3e-3, 5e-3],
        },
    ];
    models
        .into_iter()
        .map(|distortion| Camera {
            distortion,
            ..pinhole()
        })
        .collect()
}

pub fn pinhole() -> Camera {
    Camera::pinhole(1600, 1200, [1400.0, 1420.0], [805.0, 590.0])
}

/// Returns a camera at `centre` that looks at `target`, rotated about its axis by `roll`.
fn looking(centre: DVec3, target: DVec3, roll: f64) -> Pose {
    let z = (target - centre).normalize();
    let x = DVec3::Y.cross(z).normalize();
    let world_from_camera = DMat3::from_cols(x, z.cross(x), z) * DMat3::from_rotation_z(roll);
    Pose::from_matrix(
        world_from_camera.transpose(),
        -(world_from_camera.transpose() * centre),
    )
    .unwrap()
}

/// Returns points in a cube of side 2, observed exactly by `views` images on a dome around it.
///
/// The images use the cameras in turn. Each point is observed by about `share` of the images that
/// contain it.
pub fn dome(cameras: Vec<Camera>, views: usize, points: usize, share: f64, seed: u64) -> Bundle {
    let mut noise = Noise::new(seed);
    let images: Vec<BundleImage> = (0..views)
        .map(|i| {
            let turn = i as f64 * 2.4;
            let height = 0.3 + 2.0 * (i as f64 + 0.5) / views as f64;
            let centre = DVec3::new(turn.cos(), 0.0, turn.sin()) * noise.uniform(3.0, 4.5)
                - DVec3::Y * height;
            let pose = looking(centre, noise.vector(0.1), noise.uniform(-1.5, 1.5));
            BundleImage {
                camera: (i % cameras.len()) as u32,
                camera_from_world: pose,
            }
        })
        .collect();
    let mut side = || noise.uniform(-1.0, 1.0);
    let points: Vec<DVec3> = (0..points)
        .map(|_| DVec3::new(side(), side(), side()))
        .collect();
    let mut bundle = Bundle {
        cameras,
        images,
        points,
        observations: Vec::new(),
    };
    for point in 0..bundle.points.len() {
        for image in 0..views {
            let of = &bundle.images[image];
            let camera = &bundle.cameras[of.camera as usize];
            let seen = camera.project(of.camera_from_world.transform(bundle.points[point]));
            let Some(at_px) = seen.filter(|&at| camera.contains(at)) else {
                continue;
            };
            if noise.uniform(0.0, 1.0) < share {
                bundle.observations.push(BundleObservation {
                    image: image as u32,
                    point: point as u32,
                    at_px,
                });
            }
        }
    }
    bundle
}

/// Adds noise of `px` to every observation, along both axes.
pub fn blur(bundle: &mut Bundle, px: f64, seed: u64) {
    let mut noise = Noise::new(seed);
    for observation in &mut bundle.observations {
        observation.at_px += px * DVec2::new(noise.normal(), noise.normal());
    }
}

/// Rotates poses by about `turn` radians and moves poses and points by about `shift`.
pub fn disturb(bundle: &mut Bundle, turn: f64, shift: f64, seed: u64) {
    let mut noise = Noise::new(seed);
    for image in &mut bundle.images {
        let rotation = glam::DQuat::from_scaled_axis(noise.vector(turn));
        let off = Pose {
            rotation,
            translation: noise.vector(shift),
        };
        image.camera_from_world = off.compose(&image.camera_from_world);
    }
    for point in &mut bundle.points {
        *point += noise.vector(shift);
    }
}
