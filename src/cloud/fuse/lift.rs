use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::voxel_map::{GridFrame, Sample, VoxelPosition, cell_key, shard_of};
use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, PosedCamera};

/// Distance in pixels to the neighbours whose depths give the normal.
///
/// It is wide enough to be robust to the depth steps of a sensor.
const NORMAL_REACH: isize = 2;
/// The same distance as a number of rows.
const REACH: usize = NORMAL_REACH as usize;
/// Minimum number of the eight neighbours on the same surface. A line one pixel wide has two.
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
            camera
                .unproject(glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
                .as_vec2()
                .to_array()
        };
        let xy = (0..camera.height)
            .flat_map(|y| (0..camera.width).map(move |x| ray(x, y)))
            .collect();
        Self {
            camera: *camera,
            xy,
        }
    }

    /// Returns whether these are the rays of `camera`.
    pub(super) fn fit(&self, camera: &Camera) -> bool {
        self.camera == *camera
    }
}

/// The image and the depth map of a frame.
pub(super) struct FramePixels {
    pub(super) image: Arc<Image>,
    pub(super) depth: Arc<DepthMap>,
}

/// Unprojects the pixels of one frame into the grid.
pub(super) struct DepthUnprojection<'a> {
    image: &'a Image,
    depth: &'a DepthMap,
    rays: &'a Rays,
    /// Rotation from camera space, divided by the voxel size.
    ///
    /// `offset` is the position of the camera centre in the grid.
    grid_from_camera: Mat3,
    offset: Vec3,
    world_from_camera: Mat3,
    edge_tolerance: f32,
}

/// Numbers of pixels in the processed rows, by outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct LiftCount {
    /// Pixels with a depth.
    pub(super) measured: usize,
    /// Flying pixels between two surfaces, which are left out.
    pub(super) flying: usize,
    /// Pixels too far away for the grid.
    pub(super) beyond: usize,
}

impl<'a> DepthUnprojection<'a> {
    pub(super) fn new(
        view: &PosedCamera,
        rays: &'a Rays,
        pixels: &'a FramePixels,
        grid: GridFrame,
        edge_tolerance: f32,
    ) -> Self {
        let GridFrame { origin, voxel } = grid;
        let world_from_camera = view.rotation.transpose();
        Self {
            image: &pixels.image,
            depth: &pixels.depth,
            rays,
            grid_from_camera: (world_from_camera * (1.0 / voxel)).as_mat3(),
            offset: ((view.centre() - origin) / voxel).as_vec3(),
            world_from_camera: world_from_camera.as_mat3(),
            edge_tolerance,
        }
    }

    /// Unprojects some rows into samples, one list per shard of the grid.
    pub(super) fn rows(&self, rows: std::ops::Range<u32>, shards: &mut [Vec<Sample>]) -> LiftCount {
        let mut count = LiftCount::default();
        // Two rows are processed at a time: pixels above each other often fall into the same voxel,
        // which is then looked up once for both.
        for first in rows.clone().step_by(2) {
            let pair =
                [first, first + 1].map(|y| rows.contains(&y).then(|| self.around(y as usize)));
            for x in 0..self.depth.width as usize {
                for around in pair.iter().flatten() {
                    self.pixel(around, x, shards, &mut count);
                }
            }
        }
        count
    }

    /// Unprojects one pixel of a row.
    fn pixel(
        &self,
        around: &RowNeighbourhood<'_>,
        x: usize,
        shards: &mut [Vec<Sample>],
        count: &mut LiftCount,
    ) {
        let depth = around.rows[REACH][x];
        if !(depth > 0.0 && depth.is_finite()) {
            return;
        }
        count.measured += 1;
        if self.flies(around, x, depth) {
            count.flying += 1;
            return;
        }
        let here = point(around.rays[REACH][x], depth);
        let Some(cell) = VoxelPosition::holding(self.grid_from_camera * here + self.offset) else {
            count.beyond += 1;
            return;
        };
        let key = cell_key(cell.index);
        let normal = self.normal(around, x, here);
        shards[shard_of(key)].push(Sample::new(key, cell.fraction, around.colors[x], normal));
    }

    /// Returns the rows up to [`NORMAL_REACH`] above and below a row; rows outside are empty.
    fn around(&self, y: usize) -> RowNeighbourhood<'_> {
        let width = self.depth.width as usize;
        let range = |row: usize| {
            let first = (y + row).checked_sub(REACH)? * width;
            (first < self.depth.depths.len()).then_some(first..first + width)
        };
        RowNeighbourhood {
            colors: &self.image.pixels[y * width..(y + 1) * width],
            rows: std::array::from_fn(|row| {
                range(row).map_or(&[][..], |range| &self.depth.depths[range])
            }),
            rays: std::array::from_fn(|row| {
                range(row).map_or(&[][..], |range| &self.rays.xy[range])
            }),
        }
    }

    /// Returns whether too few neighbours lie on the same surface.
    ///
    /// Such a pixel is a blend of two surfaces at an edge.
    fn flies(&self, around: &RowNeighbourhood<'_>, x: usize, depth: f32) -> bool {
        if self.edge_tolerance >= 1.0 {
            return false;
        }
        let tolerance = self.edge_tolerance * depth;
        let mut support = 0;
        for (dx, dy) in [
            (-1, 0),
            (1, 0),
            (0, -1),
            (0, 1),
            (-1, -1),
            (1, -1),
            (-1, 1),
            (1, 1),
        ] {
            let (other, _) = around.at(x, dx, dy);
            support += usize::from(other > 0.0 && (other - depth).abs() <= tolerance);
            if support >= MIN_SUPPORT {
                return false;
            }
        }
        true
    }

    /// Returns the normal in world space, facing the camera.
    ///
    /// It is derived from the neighbours on the same surface, and is zero without such neighbours.
    fn normal(&self, around: &RowNeighbourhood<'_>, x: usize, here: Vec3) -> Vec3 {
        let tolerance = self.edge_tolerance * here.z * NORMAL_REACH as f32;
        let side = |dx: isize, dy: isize| {
            let (other, ray) = around.at(x, dx, dy);
            let is_same = other > 0.0 && (other - here.z).abs() <= tolerance;
            if is_same { point(ray, other) } else { here }
        };
        let along = |dx: isize, dy: isize| side(dx, dy) - side(-dx, -dy);
        let normal = along(NORMAL_REACH, 0)
            .cross(along(0, NORMAL_REACH))
            .normalize_or_zero();
        self.world_from_camera
            * if normal.dot(here) > 0.0 {
                -normal
            } else {
                normal
            }
    }
}

/// A row of an image with the rows above and below it.
struct RowNeighbourhood<'a> {
    colors: &'a [[u8; 3]],
    rows: [&'a [f32]; 2 * REACH + 1],
    rays: [&'a [[f32; 2]]; 2 * REACH + 1],
}

impl RowNeighbourhood<'_> {
    /// Returns the depth and ray of the pixel at an offset in columns and rows.
    ///
    /// The depth is 0 outside the image.
    fn at(&self, x: usize, dx: isize, dy: isize) -> (f32, [f32; 2]) {
        let (row, x) = (REACH.wrapping_add_signed(dy), x.wrapping_add_signed(dx));
        let depth = self.rows[row].get(x).copied().unwrap_or_default();
        (depth, self.rays[row].get(x).copied().unwrap_or_default())
    }
}

/// Returns the point in camera space on the ray `(x, y)` at `depth`.
fn point([x, y]: [f32; 2], depth: f32) -> Vec3 {
    Vec3::new(x * depth, y * depth, depth)
}
