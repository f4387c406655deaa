//! The walls of a cloud in a bit grid, and the free space that views carve between them.

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::bits::Bits;
use crate::fuse::{GRID_REACH, Views};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_frames::DepthMap;
use ostra_geometry::{Camera, Pose};

/// Memory limit of each bit set in bytes.
const MOST_BYTES: usize = 128 << 20;
/// Maximum grid coordinate along an axis, in cells.
const REACH: f64 = GRID_REACH as f64;

/// A grid of cells around the voxels with a margin of one cell, and the cells a surface crosses.
pub(super) struct Walls {
    /// Edge length of a cell in world units.
    pub(super) voxel: f64,
    /// Grid position of the first cell of the box.
    first: IVec3,
    pub(super) size: [usize; 3],
    /// Cells that hold voxels or are crossed by the mesh.
    pub(super) cells: Bits,
    /// Number of each voxel's cell in the box, in ascending order, with the index of the voxel.
    pub(super) occupied: Vec<(u64, u32)>,
}

impl Walls {
    /// Creates the walls, or returns `None` if there are no voxels.
    ///
    /// Parts of the mesh outside the box of the voxels are left out.
    pub(super) fn new(
        voxels: &LabelledCloud,
        voxel: f64,
        mesh: &LabelledMesh,
    ) -> Result<Option<Self>, SceneError> {
        let too_large = || {
            SceneError::Request(format!(
                "voxels of {voxel} over the whole cloud are too many to find what they enclose; give a larger size or remove distant points"
            ))
        };
        let place = |at: &Vec3| (at.as_dvec3() / voxel).floor();
        let places = || voxels.positions.iter().map(place);
        let Some((least, most)) = places()
            .map(|at| (at, at))
            .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
        else {
            return Ok(None);
        };
        let farthest = least.abs().max(most.abs()).max_element();
        if !farthest.is_finite() || farthest >= REACH {
            return Err(too_large());
        }
        let first = least.as_ivec3() - 1;
        let size = (most.as_ivec3() + 2 - first)
            .to_array()
            .map(|along| along as usize);
        let cells = Bits::new(size, MOST_BYTES).ok_or_else(too_large)?;
        let mut walls = Self {
            voxel,
            first,
            size,
            cells,
            occupied: Vec::new(),
        };
        for (point, at) in (0..).zip(places()) {
            let cell = (at.as_ivec3() - first)
                .to_array()
                .map(|along| along as usize);
            walls.cells.set(cell);
            walls.occupied.push((walls.number(cell), point));
        }
        walls.occupied.sort_unstable();
        walls.occupied.dedup_by_key(|&mut (number, _)| number);
        for triangle in &mesh.triangles {
            walls.add_triangle(
                triangle.map(|vertex| mesh.vertices.positions[vertex as usize].as_dvec3()),
            );
        }
        Ok(Some(walls))
    }

    /// Sets the cells that a triangle passes through.
    ///
    /// Every point of the triangle has a sample less than half an edge length away. A line between
    /// the centres of two neighbouring cells therefore only meets the triangle if one of the cells
    /// is set.
    fn add_triangle(&mut self, [a, b, c]: [DVec3; 3]) {
        let longest = (b - a).length().max((c - a).length()).max((c - b).length());
        let steps = (longest * 2.0 / self.voxel).ceil().max(1.0);
        for i in 0..=steps as u32 {
            for j in 0..=steps as u32 - i {
                let at = a + (b - a) * (f64::from(i) / steps) + (c - a) * (f64::from(j) / steps);
                let cell = (at / self.voxel).floor().as_ivec3() - self.first;
                if cell.cmpge(IVec3::ONE).all()
                    && (cell + 1)
                        .cmplt(IVec3::from_array(self.size.map(|n| n as i32)))
                        .all()
                {
                    self.cells.set(cell.to_array().map(|along| along as usize));
                }
            }
        }
    }

    /// Returns the number of a cell in the box, which grows with z, then y, then x.
    pub(super) fn number(&self, [x, y, z]: [usize; 3]) -> u64 {
        ((z * self.size[1] + y) * self.size[0] + x) as u64
    }

    /// Returns the difference of the numbers of neighbouring cells along each axis.
    pub(super) fn steps(&self) -> [u64; 3] {
        [1, self.size[0] as u64, (self.size[0] * self.size[1]) as u64]
    }

    /// Returns the numbers of the cells that share a face with a cell.
    ///
    /// The cell must not be at the border of the box.
    pub(super) fn around(&self, number: u64) -> impl Iterator<Item = u64> + use<> {
        self.steps()
            .into_iter()
            .flat_map(move |step| [number - step, number + step])
    }

    /// Returns the voxel in the cell with this number, if there is one.
    pub(super) fn voxel_at(&self, number: u64) -> Option<u32> {
        let at = self
            .occupied
            .binary_search_by_key(&number, |&(number, _)| number)
            .ok()?;
        Some(self.occupied[at].1)
    }

    /// Returns the centre of a cell in world space.
    pub(super) fn middle(&self, cell: [usize; 3]) -> DVec3 {
        (self.first + IVec3::from_array(cell.map(|along| along as i32))).as_dvec3() * self.voxel
            + 0.5 * self.voxel
    }

    /// Returns the cell with this number.
    pub(super) fn cell(&self, number: u64) -> [usize; 3] {
        let [_, row, layer] = self.steps();
        [number % row, number % layer / row, number / layer].map(|along| along as usize)
    }
}

/// Distance in cell edges from a cell's centre to a depth that shows the cell to be empty.
const CLEARLY_BEYOND: f64 = 2.0;
/// Half the diagonal of a cell, in cell edges.
const HALF_DIAGONAL: f64 = 0.87;

/// Cells that may be inside, and cells that were enclosed until some view saw them as empty.
pub(super) struct Carved {
    pub(super) enclosed: Bits,
    pub(super) free: Bits,
}

/// Finds the cells that walls enclose on five or more sides and that no view saw as empty.
///
/// # Errors
///
/// Returns the error of a depth map that cannot be read. Returns [`SceneError::Request`] if the
/// size of one differs from that of its camera. Returns [`SceneError::Stopped`] if the job is
/// stopped.
pub(super) fn carve(
    walls: &Walls,
    views: &dyn Views,
    progress: &Progress,
) -> Result<Carved, SceneError> {
    let mut enclosed = walls.cells.others();
    enclosed.keep_enclosed(&walls.cells);
    let mut free = walls.cells.none();
    let mut open = enclosed.words();
    let frames = views.frames();
    for (index, frame) in frames.iter().enumerate() {
        progress.step(index, frames.len())?;
        if open.is_empty() {
            break;
        }
        let Some((camera, pose)) = frame.posed_camera().filter(|_| views.has_depth(index)) else {
            continue;
        };
        let Some(depth) = views.depth(index)? else {
            continue;
        };
        if (depth.width, depth.height) != (camera.width, camera.height) {
            return Err(SceneError::Request(format!(
                "frame '{}': depth and camera differ in size; give both in the image's size",
                frame.name
            )));
        }
        let view = CarveView {
            camera,
            pose,
            depth: &depth,
            voxel: walls.voxel,
        };
        let seen_free = |&word: &usize| {
            let cells = enclosed
                .cells(word, enclosed.bits(word))
                .filter(|&cell| view.is_free(walls.middle(cell)));
            (word, cells.fold(0u64, |bits, [x, ..]| bits | 1 << (x % 64)))
        };
        let seen: Vec<(usize, u64)> = open
            .par_iter()
            .map(seen_free)
            .filter(|&(_, bits)| bits != 0)
            .collect();
        seen.into_iter()
            .for_each(|(word, bits)| enclosed.shift(word, bits, &mut free));
        open.retain(|&word| enclosed.bits(word) != 0);
    }
    enclosed.keep_enclosed(&walls.cells);
    Ok(Carved { enclosed, free })
}

struct CarveView<'a> {
    camera: &'a Camera,
    pose: &'a Pose,
    depth: &'a DepthMap,
    voxel: f64,
}

impl CarveView<'_> {
    /// Returns whether all pixels that see part of a cell have a depth clearly beyond it.
    ///
    /// One more pixel on every side is included.
    fn is_free(&self, middle: DVec3) -> bool {
        let x_in_camera = self.pose.transform(middle);
        let Some(at_px) = self
            .camera
            .project(x_in_camera)
            .filter(|_| x_in_camera.z > 0.0)
        else {
            return false;
        };
        let reach =
            HALF_DIAGONAL * self.voxel * self.camera.focal_px.max_element() / x_in_camera.z + 1.0;
        let (first, last) = ((at_px - reach).floor(), (at_px + reach).floor());
        if !self.camera.contains(first) || !self.camera.contains(last) {
            return false;
        }
        let beyond = (x_in_camera.z + CLEARLY_BEYOND * self.voxel) as f32;
        (first.y as usize..=last.y as usize).all(|y| {
            let row = y * self.depth.width as usize;
            self.depth.depths[row + first.x as usize..=row + last.x as usize]
                .iter()
                .all(|&depth| depth > beyond)
        })
    }
}
