use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::*;
use crate::fuse::Views;
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameCamera, Image, ImageSource, Orientation};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{LabelId, LabelMask};

const SIZE: u32 = 120;
const VOXEL: f64 = 0.05;

/// A surface that can be sampled and rendered.
enum Shape {
    /// Around the origin.
    Ball { radius: f64 },
    /// Perpendicular to an axis, from corner to corner.
    Sheet { axis: usize, from: DVec3, to: DVec3 },
}

/// Shapes seen by depth cameras.
struct Made {
    shapes: Vec<Shape>,
    frames: Vec<Frame>,
    depths: Vec<Arc<DepthMap>>,
}

impl Views for Made {
    fn frames(&self) -> &[Frame] {
        &self.frames
    }
    fn has_depth(&self, _: usize) -> bool {
        true
    }
    fn image(&self, _: usize) -> Result<Arc<Image>, SceneError> {
        Err(SceneError::Request("no image is needed".into()))
    }
    fn depth(&self, index: usize) -> Result<Option<Arc<DepthMap>>, SceneError> {
        Ok(Some(self.depths[index].clone()))
    }
    fn mask(&self, _: usize) -> Option<Arc<LabelMask>> {
        None
    }
}

impl Shape {
    /// Returns the ray parameter of the first hit, in lengths of the ray.
    fn hit(&self, eye: DVec3, ray: DVec3) -> f64 {
        match *self {
            Self::Ball { radius } => {
                let (a, b, c) = (
                    ray.length_squared(),
                    eye.dot(ray),
                    eye.length_squared() - radius * radius,
                );
                let hit = (-b - (b * b - a * c).sqrt()) / a;
                if hit > 0.0 { hit } else { f64::INFINITY }
            }
            Self::Sheet { axis, from, to } => {
                let hit = (from[axis] - eye[axis]) / ray[axis];
                let at = eye + ray * hit;
                let within = |other: usize| {
                    other == axis || (at[other] >= from[other] && at[other] <= to[other])
                };
                if hit > 0.0 && (0..3).all(within) {
                    hit
                } else {
                    f64::INFINITY
                }
            }
        }
    }

    fn points(&self) -> Vec<Vec3> {
        let step = VOXEL / 3.0;
        match *self {
            Self::Ball { radius } => {
                let count = (4.0 * std::f64::consts::PI * (radius / step).powi(2)) as usize;
                let point = |at: usize| {
                    let (z, turn) = (
                        1.0 - 2.0 * (at as f64 + 0.5) / count as f64,
                        at as f64 * 2.399_963,
                    );
                    let across = (1.0 - z * z).sqrt();
                    (DVec3::new(across * turn.cos(), across * turn.sin(), z) * radius).as_vec3()
                };
                (0..count).map(point).collect()
            }
            Self::Sheet { from, to, .. } => {
                let count = ((to - from) / step).ceil().as_uvec3();
                let at = |i: u32, n: u32, axis: usize| {
                    from[axis] + (to - from)[axis] * f64::from(i) / f64::from(n.max(1))
                };
                let mut points = Vec::new();
                for z in 0..=count.z {
                    for y in 0..=count.y {
                        for x in 0..=count.x {
                            points.push(
                                DVec3::new(at(x, count.x, 0), at(y, count.y, 1), at(z, count.z, 2))
                                    .as_vec3(),
                            );
                        }
                    }
                }
                points
            }
        }
    }
}

impl Made {
    fn new(shapes: Vec<Shape>) -> Self {
        Self {
            shapes,
            frames: Vec::new(),
            depths: Vec::new(),
        }
    }

    /// Returns the sides of a cube from −1 to 1, except those in `without`.
    ///
    /// Side 2·axis is the lower one, the next is the upper one.
    fn cube(without: &[usize]) -> Self {
        let side = |side: usize| {
            let (mut from, mut to) = (DVec3::NEG_ONE, DVec3::ONE);
            let along = if side.is_multiple_of(2) { -1.0 } else { 1.0 };
            (from[side / 2], to[side / 2]) = (along, along);
            Shape::Sheet {
                axis: side / 2,
                from,
                to,
            }
        };
        Self::new(
            (0..6)
                .filter(|side| !without.contains(side))
                .map(side)
                .collect(),
        )
    }

    fn seen(mut self, eye: DVec3, target: DVec3) -> Self {
        let forward = (target - eye).normalize();
        let right = DVec3::new(0.1, 1.0, 0.2).cross(forward).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let pose = Pose::from_matrix(rotation, rotation * -eye).unwrap();
        let middle = f64::from(SIZE) / 2.0;
        let camera = Camera::pinhole(SIZE, SIZE, [70.0, 70.0], [middle, middle]);
        let depth = |index: u32| {
            let at = DVec2::new(f64::from(index % SIZE) + 0.5, f64::from(index / SIZE) + 0.5);
            let ray = pose.rotation.conjugate() * camera.unproject(at).extend(1.0);
            let hit = self
                .shapes
                .iter()
                .map(|shape| shape.hit(eye, ray))
                .fold(f64::INFINITY, f64::min);
            if hit.is_finite() { hit as f32 } else { 0.0 }
        };
        let depths = (0..SIZE * SIZE).map(depth).collect();
        self.depths.push(Arc::new(DepthMap {
            width: SIZE,
            height: SIZE,
            depths,
        }));
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
        self
    }

    fn seen_from_all_sides(self) -> Self {
        let eyes = [
            DVec3::X,
            DVec3::NEG_X,
            DVec3::Y,
            DVec3::NEG_Y,
            DVec3::Z,
            DVec3::NEG_Z,
        ];
        eyes.into_iter()
            .fold(self, |made, eye| made.seen(eye * 4.0 + 0.3, DVec3::ZERO))
    }

    /// Returns the voxels of the surface, labelled 2 where x > 0 and 1 elsewhere.
    fn voxels(&self) -> LabelledCloud {
        let mut cloud =
            LabelledCloud::from_positions(self.shapes.iter().flat_map(Shape::points).collect());
        cloud.labels = cloud
            .positions
            .iter()
            .map(|at| LabelId(if at.x > 0.0 { 2 } else { 1 }))
            .collect();
        voxelize(&cloud, None, VOXEL).unwrap()
    }

    fn filled(&self, voxels: &LabelledCloud, surface: &LabelledMesh) -> LabelledCloud {
        fill_interior(voxels, VOXEL, surface, self, &Progress::default()).unwrap()
    }

    /// Returns the number of voxels added to those of the surface.
    fn added(&self) -> usize {
        let voxels = self.voxels();
        self.filled(&voxels, &LabelledMesh::default()).len() - voxels.len()
    }
}

#[test]
fn ball_seen_from_all_sides_is_filled() {
    let made = Made::new(vec![Shape::Ball { radius: 1.0 }]).seen_from_all_sides();
    let voxels = made.voxels();
    let filled = made.filled(&voxels, &LabelledMesh::default());
    let ball = |radius: f64| 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    let volume = filled.len() as f64 * VOXEL.powi(3);
    assert!(volume > ball(1.0) && volume < ball(1.0 + VOXEL), "{volume}");
    assert!(filled.len() > voxels.len() * 2);
    let added = (0..filled.len())
        .filter(|&at| filled.normals[at] == Vec3::ZERO && filled.positions[at].x.abs() > 0.06);
    for at in added {
        let x = filled.positions[at];
        assert_eq!(
            filled.labels[at],
            LabelId(if x.x > 0.0 { 2 } else { 1 }),
            "{x}"
        );
    }
    let order = |x: &Vec3| (x / VOXEL as f32).floor().as_ivec3().to_array();
    assert!(filled.positions.windows(2).all(|two| {
        let [[a, b, c], [d, e, f]] = [order(&two[0]), order(&two[1])];
        [c, b, a] < [f, e, d]
    }));
}

#[test]
fn open_box_seen_from_above_stays_empty() {
    let made = Made::cube(&[3]).seen(DVec3::new(0.1, 3.0, 0.2), DVec3::ZERO);
    assert_eq!(made.added(), 0);
}

#[test]
fn closed_box_is_filled_unless_seen_from_inside() {
    let inner = (2.0 / VOXEL - 1.0).powi(3) as usize;
    let made = Made::cube(&[]).seen_from_all_sides();
    assert_eq!(made.added(), inner);
    // Most of the room is outside this view, and is reached from what it shows.
    let inside = Made::cube(&[]).seen(DVec3::new(-0.8, -0.7, -0.75), DVec3::splat(0.9));
    assert_eq!(inside.added(), 0);
}

#[test]
fn box_on_the_ground_is_filled_with_its_bottom_unseen() {
    let made = Made::cube(&[2])
        .seen(DVec3::new(2.0, 3.0, 1.0), DVec3::ZERO)
        .seen(DVec3::new(-2.0, 3.0, -1.0), DVec3::ZERO);
    let inner = (2.0 / VOXEL - 1.0).powi(2) as usize * (2.0 / VOXEL) as usize;
    assert_eq!(made.added(), inner);
}

#[test]
fn space_under_a_table_is_not_filled() {
    // A top, and two legs as wide as the top.
    let made = Made::cube(&[1, 2, 4, 5]).seen(DVec3::new(0.1, 4.0, 0.2), DVec3::ZERO);
    assert_eq!(made.added(), 0);
}

#[test]
fn space_hidden_by_a_wall_is_not_filled() {
    // A floor, a wall across it and a side wall, which do not close.
    let made = Made::cube(&[1, 3, 5]).seen(DVec3::new(0.5, 0.5, -4.0), DVec3::ZERO);
    assert_eq!(made.added(), 0);
}

/// Returns the ball of radius 1 as triangles.
fn ball_mesh() -> LabelledMesh {
    let (rings, spokes) = (40u32, 80u32);
    let at = |ring: u32, spoke: u32| {
        let (tilt, turn) = (
            ring as f32 / rings as f32 * PI,
            spoke as f32 / spokes as f32 * TAU,
        );
        Vec3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos())
    };
    let vertices = (0..=rings)
        .flat_map(|ring| (0..=spokes).map(move |spoke| at(ring, spoke)))
        .collect();
    let square = |first: u32| {
        [
            [first, first + 1, first + spokes + 1],
            [first + 1, first + spokes + 2, first + spokes + 1],
        ]
    };
    let triangles = (0..rings)
        .flat_map(|ring| (0..spokes).flat_map(move |spoke| square(ring * (spokes + 1) + spoke)));
    LabelledMesh {
        vertices: LabelledCloud::from_positions(vertices),
        triangles: triangles.collect(),
    }
}

#[test]
fn mesh_closes_gaps_between_voxels() {
    let made = Made::new(vec![Shape::Ball { radius: 1.0 }]).seen_from_all_sides();
    let voxels = made.voxels();
    let whole = made.filled(&voxels, &LabelledMesh::default()).len();
    let some = voxels.select(&(0..voxels.len() as u32).step_by(3).collect::<Vec<_>>());
    let leaky = made.filled(&some, &LabelledMesh::default()).len();
    let closed = made.filled(&some, &ball_mesh()).len();
    assert!(
        leaky * 10 < whole && closed * 100 > whole * 99,
        "{leaky} and {closed} of {whole}"
    );
}

#[test]
fn hole_loses_only_the_space_behind_it() {
    let made = Made::new(vec![Shape::Ball { radius: 1.0 }]).seen_from_all_sides();
    let voxels = made.voxels();
    let is_kept = |at: &u32| voxels.positions[*at as usize].distance(Vec3::X) > 0.2;
    let holed = voxels.select(&(0..voxels.len() as u32).filter(is_kept).collect::<Vec<_>>());
    let whole = made.filled(&voxels, &LabelledMesh::default()).len();
    let filled = made.filled(&holed, &LabelledMesh::default()).len();
    assert!(filled * 100 > whole * 98, "{filled} of {whole}");
}

#[test]
fn interior_does_not_depend_on_thread_count() {
    let made = Made::new(vec![Shape::Ball { radius: 0.7 }]).seen_from_all_sides();
    let voxels = made.voxels();
    let alone = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let filled = || made.filled(&voxels, &LabelledMesh::default());
    assert!(alone.install(filled) == filled());
}

#[test]
fn box_with_too_many_cells_is_an_error() {
    let made = Made::cube(&[]);
    let mut voxels = made.voxels();
    voxels.positions[0] = Vec3::new(-1e4, -1e4, -1e4);
    let filled = fill_interior(
        &voxels,
        VOXEL,
        &LabelledMesh::default(),
        &made,
        &Progress::default(),
    );
    assert!(matches!(filled, Err(SceneError::Request(_))));
    assert!(
        fill_interior(
            &voxels,
            0.0,
            &LabelledMesh::default(),
            &made,
            &Progress::default()
        )
        .is_err()
    );
}
