use glam::Vec3;
use rayon::prelude::*;

use super::bits::Bits;
use super::carve::{Walls, carve};
use crate::fuse::Views;
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_core::union_find::DisjointSets;
use ostra_masks::LabelId;

/// Maximum number of voxels that may be added.
const MOST_ADDED: usize = 1 << 24;
/// Maximum ratio of faces open to empty space to faces that meet a wall, for a filled component.
const OPEN: f64 = 0.1;
/// Marks a cell without a voxel.
const NONE: u32 = u32::MAX;

/// Returns the voxels with all cells that they enclose filled.
///
/// The voxels are those of [`voxelize`](super::voxelize) with edge length `voxel` in world units. A
/// cell is enclosed if no view saw it as empty, and if at least five of the six directions along
/// the axes lead to a voxel through such cells. Five suffice because an object on a table has a
/// side that no view sees. Space behind a wall or under a table is walled on fewer sides and stays
/// empty. A component that is open to space seen as empty, such as the unseen part of a room, stays
/// empty, too.
///
/// A flood fill from outside is not used: it enters every object on a table through the bottom that
/// no view saw.
///
/// `surface`, the mesh of the same scene, closes gaps between voxels: its cells count as filled. It
/// may be empty.
///
/// Added voxels have no normal. Their label, confidence and colour are those of the nearest voxel,
/// counted in steps over faces of added cells. Among equally near voxels, the one with the lowest
/// label wins, then the first. The result is in ascending order of z, y, x.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the edge length is not above 0, or if the grid or the
/// interior would need too much memory. Returns the error of a depth map that cannot be read.
/// Returns [`SceneError::Stopped`] if the job is stopped.
pub fn fill_interior(
    voxels: &LabelledCloud,
    voxel: f64,
    surface: &LabelledMesh,
    views: &dyn Views,
    progress: &Progress,
) -> Result<LabelledCloud, SceneError> {
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        )));
    }
    progress.stage("interior")?;
    let Some(walls) = Walls::new(voxels, voxel, surface)? else {
        return Ok(voxels.clone());
    };
    let inside = inside(&walls, views, progress)?;
    let sources = nearest(&walls, &inside, &voxels.labels, progress)?;
    let added = inside
        .iter()
        .zip(sources)
        .filter(|&(_, source)| source != NONE);
    let mut all: Vec<(u64, u32, bool)> = added
        .map(|(&number, source)| (number, source, true))
        .collect();
    all.extend(
        walls
            .occupied
            .iter()
            .map(|&(number, point)| (number, point, false)),
    );
    all.par_sort_unstable();
    let points: Vec<u32> = all.iter().map(|&(_, point, _)| point).collect();
    let mut filled = voxels.select(&points);
    for (at, (number, _, is_added)) in all.into_iter().enumerate() {
        if is_added {
            filled.positions[at] = walls.middle(walls.cell(number)).as_vec3();
            filled.normals[at] = Vec3::ZERO;
        }
    }
    Ok(filled)
}

/// Returns the numbers of the cells to fill, in ascending order.
///
/// These are the cells that are inside, and those that only the mesh crosses.
fn inside(walls: &Walls, views: &dyn Views, progress: &Progress) -> Result<Vec<u64>, SceneError> {
    let carved = carve(walls, views, progress)?;
    let voxel = walls.voxel;
    let within_limit = |numbers: &[u64]| match numbers.len() > MOST_ADDED {
        true => Err(SceneError::Request(format!(
            "voxels of {voxel} enclose more than {MOST_ADDED} others; give a larger size"
        ))),
        false => Ok(()),
    };
    let mut inside = Vec::new();
    for word in carved.enclosed.words() {
        inside.extend(
            carved
                .enclosed
                .cells(word, carved.enclosed.bits(word))
                .map(|cell| walls.number(cell)),
        );
        within_limit(&inside)?;
    }
    let mut inside = covered(walls, &carved.free, &inside);
    for word in walls.cells.words() {
        let numbers = walls
            .cells
            .cells(word, walls.cells.bits(word))
            .map(|cell| walls.number(cell));
        inside.extend(numbers.filter(|number| walls.voxel_at(*number).is_none()));
        within_limit(&inside)?;
    }
    inside.sort_unstable();
    Ok(inside)
}

/// Returns the cells whose connected component meets walls and hardly any space seen as empty.
///
/// `cells` must be in ascending order.
fn covered(walls: &Walls, free: &Bits, cells: &[u64]) -> Vec<u64> {
    let mut sets = DisjointSets::new(cells.len());
    for (at, &number) in (0..).zip(cells) {
        for next in walls
            .steps()
            .into_iter()
            .filter_map(|step| cells.binary_search(&(number + step)).ok())
        {
            sets.unite(at, next as u32);
        }
    }
    let mut faces = vec![[0usize; 2]; cells.len()];
    for (at, &number) in (0..).zip(cells) {
        let piece = sets.root(at) as usize;
        for next in walls.around(number).map(|next| walls.cell(next)) {
            faces[piece][0] += usize::from(walls.cells.is_set(next));
            faces[piece][1] += usize::from(free.is_set(next));
        }
    }
    let mut is_covered = |at: u32| {
        let [wall, open] = faces[sets.root(at) as usize];
        open as f64 <= OPEN * wall as f64
    };
    (0..cells.len() as u32)
        .filter(|&at| is_covered(at))
        .map(|at| cells[at as usize])
        .collect()
}

/// Returns the nearest voxel for each cell, by steps over faces.
///
/// The entry is [`NONE`] if no voxel touches the component of a cell.
fn nearest(
    walls: &Walls,
    inside: &[u64],
    labels: &[LabelId],
    progress: &Progress,
) -> Result<Vec<u32>, SceneError> {
    let touching = |number: u64| {
        let voxels = walls.around(number).filter_map(|next| walls.voxel_at(next));
        voxels
            .min_by_key(|&voxel| (labels[voxel as usize], voxel))
            .unwrap_or(NONE)
    };
    let mut sources: Vec<u32> = inside.par_iter().map(|&number| touching(number)).collect();
    let mut rim: Vec<usize> = (0..inside.len())
        .filter(|&at| sources[at] != NONE)
        .collect();
    while !rim.is_empty() {
        progress.check()?;
        let mut offers: Vec<(usize, LabelId, u32)> = Vec::new();
        for &at in &rim {
            let next = walls
                .around(inside[at])
                .filter_map(|next| inside.binary_search(&next).ok());
            let unowned = next.filter(|&next| sources[next] == NONE);
            offers.extend(unowned.map(|next| (next, labels[sources[at] as usize], sources[at])));
        }
        offers.par_sort_unstable();
        offers.dedup_by_key(|&mut (next, ..)| next);
        offers
            .iter()
            .for_each(|&(next, _, source)| sources[next] = source);
        rim = offers.into_iter().map(|(next, ..)| next).collect();
    }
    Ok(sources)
}
