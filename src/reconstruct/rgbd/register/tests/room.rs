use glam::{DQuat, DVec3, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::rgbd::register::OrientedCloud;
use ostra_geometry::Pose;

/// Edge of the voxels with which rooms are registered, in metres.
pub const VOXEL: f32 = 0.08;
/// Standard deviation of the points along their normals, in metres.
const NOISE: f32 = 0.004;

/// A corner of a wall, floor or piece of furniture, and the two edges from it.
struct Patch([Vec3; 3]);

/// Floor, three walls and boxes; another seed gives another room.
pub struct SyntheticRoom {
    patches: Vec<Patch>,
    random: Pcg64Mcg,
}

impl SyntheticRoom {
    pub fn new(seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let (wide, deep, high) = (Vec3::X * 4.2, Vec3::Y * 3.0, Vec3::Z * 1.8);
        let mut patches = vec![
            Patch([Vec3::ZERO, wide, deep]),
            Patch([Vec3::ZERO, deep, high]),
            Patch([wide, high, deep]),
            Patch([deep, wide, high]),
        ];
        for _ in 0..14 {
            let mut length = |least: f32, most: f32| random.random_range(least..most);
            let turn = glam::Quat::from_rotation_z(length(0.0, 1.5));
            let corner = Vec3::new(
                length(0.2, 3.6),
                length(0.2, 2.4),
                length(-0.2, 0.9).max(0.0),
            );
            let [along, across] = [
                turn * Vec3::X * length(0.2, 0.9),
                turn * Vec3::Y * length(0.2, 0.7),
            ];
            let up = Vec3::Z * length(0.15, 0.8);
            let far = corner + along + across + up;
            patches.extend([Patch([corner, up, along]), Patch([corner, across, up])]);
            patches.extend([
                Patch([far, -along, -up]),
                Patch([far, -up, -across]),
                Patch([far, -along, -across]),
            ]);
        }
        for patch in &mut patches {
            // Normals face up or into the room.
            let [corner, a, b] = patch.0;
            let normal = a.cross(b);
            if corner.z == 0.0 && a.z == 0.0 && b.z == 0.0 && normal.z < 0.0 {
                patch.0 = [corner, b, a];
            }
        }
        Self { patches, random }
    }

    /// Samples random points over the part at `from..to` of the room's length, with noise.
    ///
    /// There are `per_area` points per square metre. Brightness is a pattern that depends on the
    /// position.
    pub fn scan(&mut self, from: f32, to: f32, per_area: f32) -> OrientedCloud {
        let mut cloud = OrientedCloud::default();
        for Patch([corner, a, b]) in &self.patches {
            let normal = a.cross(*b).normalize();
            for _ in 0..(a.cross(*b).length() * per_area) as usize {
                let [u, v] = [0, 1].map(|_| self.random.random_range(0.0..1.0f32));
                let place = corner + u * a + v * b;
                if place.x / 4.2 < from || place.x / 4.2 > to {
                    continue;
                }
                let mut error = || {
                    (0..3)
                        .map(|_| self.random.random_range(-1.0..1.0f32))
                        .sum::<f32>()
                };
                let tilt = Vec3::new(error(), error(), error()) * 0.05;
                cloud.positions.push(place + normal * error() * NOISE);
                cloud.normals.push((normal + tilt).normalize());
                cloud.intensities.push(brightness(place));
            }
        }
        cloud
    }

    /// Returns two scans that share about 0.6 of each, the first moved by the inverse of the pose: target_from_source.
    pub fn pair(seed: u64, per_area: f32) -> (OrientedCloud, OrientedCloud, Pose) {
        let mut room = Self::new(seed);
        let pose = random_pose(&mut room.random);
        let source = moved(&room.scan(0.0, 0.714, per_area), &pose.inverse());
        (source, room.scan(0.286, 1.0, per_area), pose)
    }
}

fn brightness(place: Vec3) -> f32 {
    0.5 + 0.2 * (place * Vec3::new(9.0, 5.0, 7.0)).element_sum().sin()
        + 0.2 * (place.x * 4.0 - place.y * 8.0).sin()
}

pub fn random_pose(random: &mut Pcg64Mcg) -> Pose {
    let mut vector = || DVec3::from_array(std::array::from_fn(|_| random.random_range(-1.0..1.0)));
    Pose {
        rotation: DQuat::from_scaled_axis(vector() * 3.0),
        translation: 2.0 * vector(),
    }
}

pub fn moved(cloud: &OrientedCloud, pose: &Pose) -> OrientedCloud {
    OrientedCloud {
        positions: cloud
            .positions
            .iter()
            .map(|x| pose.transform(x.as_dvec3()).as_vec3())
            .collect(),
        normals: cloud
            .normals
            .iter()
            .map(|n| (pose.rotation * n.as_dvec3()).as_vec3())
            .collect(),
        intensities: cloud.intensities.clone(),
    }
}

/// Returns the angle in degrees, and the distance by which the middle of the room is misplaced.
pub fn error(found: &Pose, truth: &Pose) -> (f64, f64) {
    let middle = truth.inverse().transform(DVec3::new(2.1, 1.5, 0.9));
    let turn = found.rotation.dot(truth.rotation).abs().min(1.0);
    (
        (2.0 * turn.acos()).to_degrees(),
        found.transform(middle).distance(truth.transform(middle)),
    )
}
