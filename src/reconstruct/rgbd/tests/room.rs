use glam::{DQuat, DVec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, Pose};

/// Half the extent of the room, metres; y points down.
const ROOM: DVec3 = DVec3::new(2.0, 1.3, 2.2);
/// Middle and half extent of the furniture.
const FURNITURE: [[DVec3; 2]; 3] = [
    [DVec3::new(0.6, 0.7, 1.2), DVec3::new(0.3, 0.6, 0.25)],
    [DVec3::new(-0.7, 1.0, 1.0), DVec3::new(0.35, 0.3, 0.3)],
    [DVec3::new(-0.2, -0.2, 1.9), DVec3::new(0.5, 0.15, 0.3)],
];

/// Middle and radius of balls, which make the corners of the room distinguishable.
const BALLS: [(DVec3, f64); 5] = [
    (DVec3::new(-1.2, 0.3, 1.8), 0.45),
    (DVec3::new(1.3, -0.3, 1.7), 0.3),
    (DVec3::new(0.2, 0.35, 1.5), 0.2),
    (DVec3::new(0.0, 1.1, 0.9), 0.25),
    (DVec3::new(-0.6, -0.7, 2.0), 0.35),
];

/// Returns the camera that records the room.
pub fn camera() -> Camera {
    Camera::pinhole(320, 240, [290.0, 290.0], [160.5, 119.0])
}

/// Returns the camera's pose after `step` steps of a hand that rotates 2.5° and moves some 3 cm with each.
pub fn hand_at(step: f64) -> Pose {
    let turn = DQuat::from_rotation_y((2.5 * step - 20.0).to_radians())
        * DQuat::from_rotation_x(0.05 * (0.9 * step).sin());
    let centre = DVec3::new(
        0.03 * step - 0.3,
        0.4 + 0.02 * (1.3 * step).sin(),
        -0.8 + 0.01 * step,
    );
    let rotation = turn.inverse();
    Pose {
        rotation,
        translation: -(rotation * centre),
    }
}

/// Renders what the camera sees; depth scatters by `noise` times its square, in metres.
pub fn seen(camera_from_world: &Pose, noise: f64, seed: u64) -> (Image, DepthMap) {
    seen_through(&camera(), camera_from_world, noise, seed)
}

/// Renders what another camera sees.
pub fn seen_through(
    camera: &Camera,
    camera_from_world: &Pose,
    noise: f64,
    seed: u64,
) -> (Image, DepthMap) {
    let world_from_camera = camera_from_world.inverse();
    let rng = &mut Pcg64Mcg::seed_from_u64(seed);
    let (mut pixels, mut depths) = (Vec::new(), Vec::new());
    for y in 0..camera.height {
        for x in 0..camera.width {
            let ray = camera
                .unproject(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
                .extend(1.0);
            let (origin, along) = (
                world_from_camera.translation,
                world_from_camera.rotation * ray,
            );
            let depth = first_hit(origin, along);
            let grey = texture(origin + depth * along);
            pixels.push([grey; 3]);
            let gauss: f64 = (0..6).map(|_| rng.random_range(-0.7..0.7)).sum();
            depths.push((depth + noise * gauss * depth * depth) as f32);
        }
    }
    let (width, height) = (camera.width, camera.height);
    (
        Image {
            width,
            height,
            pixels,
        },
        DepthMap {
            width,
            height,
            depths,
        },
    )
}

fn first_hit(origin: DVec3, along: DVec3) -> f64 {
    let walls = ((ROOM * along.signum() - origin) / along).min_element();
    let things = FURNITURE.iter().filter_map(|[middle, half]| {
        let (a, b) = (
            (middle - half - origin) / along,
            (middle + half - origin) / along,
        );
        let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
        (enter > 0.0 && enter < leave).then_some(enter)
    });
    let balls = BALLS.iter().filter_map(|&(middle, radius)| {
        let from = origin - middle;
        let (a, b, c) = (
            along.length_squared(),
            along.dot(from),
            from.length_squared() - radius * radius,
        );
        let enter = (-b - (b * b - a * c).sqrt()) / a;
        (enter > 0.0).then_some(enter)
    });
    things.chain(balls).fold(walls, f64::min)
}

/// Returns smooth noise of three sizes.
fn texture(at: DVec3) -> u8 {
    let value = 0.5 * noise(at / 0.7, 3) + 0.3 * noise(at / 0.16, 1) + 0.2 * noise(at / 0.05, 2);
    (40.0 + 180.0 * value) as u8
}

fn noise(at: DVec3, seed: u64) -> f64 {
    let (cell, share) = (at.floor(), at - at.floor());
    let corner = |x: f64, y: f64, z: f64| {
        let place = [cell.x + x, cell.y + y, cell.z + z].map(|v| v as i64 as u64);
        let mixed = place.iter().fold(seed, |sum, v| {
            (sum ^ v)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(29)
        });
        (mixed >> 40) as f64 / f64::from(1u32 << 24)
    };
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t * t * (3.0 - 2.0 * t);
    let row = |y: f64, z: f64| lerp(corner(0.0, y, z), corner(1.0, y, z), share.x);
    let plane = |z: f64| lerp(row(0.0, z), row(1.0, z), share.y);
    lerp(plane(0.0), plane(1.0), share.z)
}
