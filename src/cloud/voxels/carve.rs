//! The walls of a cloud in a bit grid, and the free space that views carve out between them.

use glam::{DVec3, IVec3, Vec3};
use rayon::prelude::*;

use super::bits::Bits;
use crate::fuse::{GRID_REACH, Views};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_frames::DepthMap;
use ostra_geometry::{Camera, Pose};

/// Memory that each set of cells may take.
const MOST_BYTES: usize = 128 << 20;
/// Cells along an axis that a box can have.
const REACH: f64 = GRID_REACH as f64;

/// The cells of a regular grid around voxels, one more on every side, and which of them a surface goes through.
pub(super) struct Walls {
    /// Edge of a cell, world units.
    pub(super) voxel: f64,
    /// The grid's place of the box's first cell.
    first: IVec3,
    pub(super) size: [usize; 3],
    /// Cells of voxels and of the mesh.
    pub(super) cells: Bits,
    /// The voxels' cells, by their number in the box, rising, with the voxel's index.
    pub(super) occupied: Vec<(u64, u32)>,
}

impl Walls {
    /// `None` without voxels. Parts of the mesh beyond the voxels' box are left out.
    pub(super) fn new(
        voxels: &LabelledCloud,
        voxel: f64,
        mesh: &LabelledMesh,
    ) -> Result<Option<Self>, SceneError> {
        let too_large = || {
            SceneError::Request(format!(
                "voxels of {voxel} over the whole cloud are too many to find what they enclose; give a larger size or leave \
                 points far away out"
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

    /// A line between the middles of two neighbouring cells meets no triangle unless one of the cells is set: every point of
    /// the triangle has a sample less than half an edge away.
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

    /// A cell's number in the box; rising with z, then y, then x.
    pub(super) fn number(&self, [x, y, z]: [usize; 3]) -> u64 {
        ((z * self.size[1] + y) * self.size[0] + x) as u64
    }

    /// How much the number changes from a cell to the next along each axis.
    pub(super) fn steps(&self) -> [u64; 3] {
        [1, self.size[0] as u64, (self.size[0] * self.size[1]) as u64]
    }

    /// The numbers of the cells that share a face with one that is not at the box's border.
    pub(super) fn around(&self, number: u64) -> impl Iterator<Item = u64> + use<> {
        self.steps()
            .into_iter()
            .flat_map(move |step| [number - step, number + step])
    }

    /// The voxel that fills the cell with this number.
    pub(super) fn voxel_at(&self, number: u64) -> Option<u32> {
        let at = self
            .occupied
            .binary_search_by_key(&number, |&(number, _)| number)
            .ok()?;
        Some(self.occupied[at].1)
    }

    /// The middle of a cell in the world.
    pub(super) fn middle(&self, cell: [usize; 3]) -> DVec3 {
        (self.first + IVec3::from_array(cell.map(|along| along as i32))).as_dvec3() * self.voxel
            + 0.5 * self.voxel
    }

    /// The cell with this number.
    pub(super) fn cell(&self, number: u64) -> [usize; 3] {
        let [_, row, layer] = self.steps();
        [number % row, number % layer / row, number / layer].map(|along| along as usize)
    }
}

/// Edges of a cell by which depths must pass beyond its middle to see it empty.
const CLEARLY_BEYOND: f64 = 2.0;
/// Half a cell's diagonal, in edges.
const HALF_DIAGONAL: f64 = 0.87;

/// Cells that may be inside, and those that were thought so until some view saw them empty.
pub(super) struct Carved {
    pub(super) enclosed: Bits,
    pub(super) free: Bits,
}

/// The cells that walls enclose on five sides or more and that no view saw empty.
///
/// # Errors
/// What reading a depth says; [`SceneError::Request`] for one of another size than its frame; [`SceneError::Stopped`].
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
                "frame '{}': depth and camera differ in size; give both in the picture's size",
                frame.name
            )));
        }
        let view = View {
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

struct View<'a> {
    camera: &'a Camera,
    pose: &'a Pose,
    depth: &'a DepthMap,
    voxel: f64,
}

impl View<'_> {
    /// Whether all pixels that see some of a cell, and one more on every side, know a depth clearly beyond it.
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
