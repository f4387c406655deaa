use glam::{DVec3, Mat3, Vec3};

use super::grid::{Cell, Sample, cell_key, shard_of};
use super::view::View;
use crate::frames::{DepthMap, Image};
use crate::geometry::Camera;

/// Distance in pixels to the neighbours whose depths give the normal: wide enough to stand above a sensor's steps.
const NORMAL_REACH: i64 = 2;
/// Neighbours of eight on the same surface that a pixel needs. A line one pixel wide has two.
const MIN_SUPPORT: usize = 2;

/// The viewing rays of one camera: (x, y) on the plane z = 1 for every pixel.
#[derive(Debug)]
pub(super) struct Rays {
    camera: Camera,
    xy: Vec<[f32; 2]>,
}

impl Rays {
    pub(super) fn new(camera: &Camera) -> Self {
        let ray = |x: u32, y: u32| {
            camera.unproject(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).as_vec2().to_array()
        };
        let xy = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| ray(x, y))).collect();
        Self { camera: *camera, xy }
    }

    /// Whether these are the rays of `camera`.
    pub(super) fn fit(&self, camera: &Camera) -> bool {
        self.camera == *camera
    }
}

/// One frame's pixels on their way into the grid.
pub(super) struct Lift<'a> {
    image: &'a Image,
    depth: &'a DepthMap,
    rays: &'a Rays,
    /// Grid units from camera space: rotation over voxel size, and the camera's place in the grid.
    grid_from_camera: Mat3,
    offset: Vec3,
    world_from_camera: Mat3,
    edge_tolerance: f32,
}

/// What became of the pixels of some rows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct LiftCount {
    /// Pixels with a depth.
    pub(super) measured: usize,
    /// Pixels left out as flying between two surfaces.
    pub(super) flying: usize,
    /// Pixels too far away for the grid.
    pub(super) beyond: usize,
}

impl<'a> Lift<'a> {
    pub(super) fn new(
        view: &View,
        rays: &'a Rays,
        image: &'a Image,
        depth: &'a DepthMap,
        grid: (DVec3, f64),
        edge_tolerance: f32,
    ) -> Self {
        let (origin, voxel) = grid;
        let world_from_camera = view.rotation.transpose();
        Self {
            image,
            depth,
            rays,
            grid_from_camera: (world_from_camera * (1.0 / voxel)).as_mat3(),
            offset: ((view.centre() - origin) / voxel).as_vec3(),
            world_from_camera: world_from_camera.as_mat3(),
            edge_tolerance,
        }
    }

    /// Lifts some rows into samples, one list for each shard of the grid.
    pub(super) fn rows(&self, rows: std::ops::Range<u32>, shards: &mut [Vec<Sample>]) -> LiftCount {
        let mut count = LiftCount::default();
        for y in rows {
            for x in 0..self.depth.width {
                let index = y as usize * self.depth.width as usize + x as usize;
                let depth = self.depth.depths[index];
                if !(depth > 0.0 && depth.is_finite()) {
                    continue;
                }
                count.measured += 1;
                if self.flies(i64::from(x), i64::from(y), depth) {
                    count.flying += 1;
                    continue;
                }
                let in_grid = self.grid_from_camera * self.point(index, depth) + self.offset;
                let Some(cell) = Cell::holding(in_grid) else {
                    count.beyond += 1;
                    continue;
                };
                let key = cell_key(cell.index);
                let normal = self.normal(i64::from(x), i64::from(y), depth);
                shards[shard_of(key)].push(Sample::new(key, cell.fraction, self.image.pixels[index], normal));
            }
        }
        count
    }

    fn point(&self, index: usize, depth: f32) -> Vec3 {
        let [x, y] = self.rays.xy[index];
        Vec3::new(x * depth, y * depth, depth)
    }

    /// Depth of a pixel if it lies on the surface of a pixel with `depth` that is `reach` pixels away.
    fn same_surface(&self, x: i64, y: i64, depth: f32, reach: f32) -> Option<(usize, f32)> {
        if x < 0 || y < 0 || x >= i64::from(self.depth.width) || y >= i64::from(self.depth.height) {
            return None;
        }
        let index = y as usize * self.depth.width as usize + x as usize;
        let other = self.depth.depths[index];
        (other > 0.0 && (other - depth).abs() <= self.edge_tolerance * depth * reach).then_some((index, other))
    }

    /// Whether too few neighbours lie on the same surface: such pixels are blends of two surfaces at an edge.
    fn flies(&self, x: i64, y: i64, depth: f32) -> bool {
        if self.edge_tolerance >= 1.0 {
            return false;
        }
        let around = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];
        let mut support = 0;
        for (dx, dy) in around {
            support += usize::from(self.same_surface(x + dx, y + dy, depth, 1.0).is_some());
            if support >= MIN_SUPPORT {
                return false;
            }
        }
        true
    }

    /// The normal in world space, towards the camera, from the neighbours on the same surface; zero without such.
    fn normal(&self, x: i64, y: i64, depth: f32) -> Vec3 {
        let here = self.point(y as usize * self.depth.width as usize + x as usize, depth);
        let along = |dx: i64, dy: i64| {
            let side = |sign: i64| {
                let found = self.same_surface(x + sign * dx, y + sign * dy, depth, NORMAL_REACH as f32);
                found.map_or(here, |(index, other)| self.point(index, other))
            };
            side(1) - side(-1)
        };
        let normal = along(NORMAL_REACH, 0).cross(along(0, NORMAL_REACH)).normalize_or_zero();
        self.world_from_camera * if normal.dot(here) > 0.0 { -normal } else { normal }
    }
}
