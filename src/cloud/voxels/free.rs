use glam::DVec3;
use rayon::prelude::*;

use super::bits::Bits;
use super::walls::Walls;
use crate::SceneError;
use crate::fuse::Views;
use ostra_core::job::Progress;
use ostra_frames::DepthMap;
use ostra_geometry::{Camera, Pose};

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
