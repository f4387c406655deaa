use glam::Vec3;
use rayon::prelude::*;

use super::free::reachable;
use super::walls::Walls;
use crate::engine::job::Progress;
use crate::masks::LabelId;
use crate::scene::fuse::Views;
use crate::scene::{LabelledCloud, LabelledMesh, SceneError};

/// Voxels that may be added.
const MOST_ADDED: usize = 1 << 24;
/// No voxel.
const NONE: u32 = u32::MAX;

/// Voxels (as [`voxelize`](super::voxelize) made them, of edge `voxel` in world units) with all that they enclose: cells from
/// which no way leads over faces of empty cells to the outside or to a place that a view's depth saw empty. What nobody saw
/// is filled only where it is enclosed, so a table seen from above stays a sheet. `surface`, the mesh of the same scene,
/// closes gaps between voxels: its cells count as filled; it may be empty.
///
/// What is added has no normal, and label, confidence and colour of the nearest voxel, counted in steps over faces of added
/// cells; of equally near ones that with the lowest label, then the first. In rising order of z, y, x.
///
/// # Errors
/// [`SceneError::Request`] for an edge that is no length above 0, or where grid or inside would take too much memory; what
/// reading a depth says; [`SceneError::Stopped`].
pub fn fill_interior(
    voxels: &LabelledCloud,
    voxel: f64,
    surface: &LabelledMesh,
    views: &dyn Views,
    progress: &Progress,
) -> Result<LabelledCloud, SceneError> {
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!("a voxel size of {voxel} is not possible; give a length above 0")));
    }
    progress.stage("interior")?;
    let Some(walls) = Walls::new(voxels, voxel, surface)? else { return Ok(voxels.clone()) };
    let inside = inside(&walls, views, progress)?;
    let sources = nearest(&walls, &inside, &voxels.labels, progress)?;
    let added = inside.iter().zip(sources).filter(|&(_, source)| source != NONE);
    let mut all: Vec<(u64, u32, bool)> = added.map(|(&number, source)| (number, source, true)).collect();
    all.extend(walls.occupied.iter().map(|&(number, point)| (number, point, false)));
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

/// The numbers, rising, of the cells that are neither voxels nor reachable.
fn inside(walls: &Walls, views: &dyn Views, progress: &Progress) -> Result<Vec<u64>, SceneError> {
    let mut solid = reachable(walls, views, progress)?;
    for &(number, _) in &walls.occupied {
        solid.set(walls.cell(number));
    }
    let (mut inside, voxel) = (Vec::new(), walls.voxel);
    for word in solid.words_in_neither(&solid) {
        inside.extend(solid.cells(word, solid.in_neither(&solid, word)).map(|cell| walls.number(cell)));
        if inside.len() > MOST_ADDED {
            return Err(SceneError::Request(format!(
                "voxels of {voxel} enclose more than {MOST_ADDED} others; give a larger size"
            )));
        }
    }
    Ok(inside)
}

/// For each of these cells the nearest voxel, by steps over their faces; [`NONE`] where no voxel touches their piece.
fn nearest(walls: &Walls, inside: &[u64], labels: &[LabelId], progress: &Progress) -> Result<Vec<u32>, SceneError> {
    let around = |number: u64| walls.steps().into_iter().flat_map(move |step| [number - step, number + step]);
    let touching = |number: u64| {
        let voxel = |next: u64| walls.occupied.binary_search_by_key(&next, |&(number, _)| number).ok();
        let voxels = around(number).filter_map(voxel).map(|at| walls.occupied[at].1);
        voxels.min_by_key(|&voxel| (labels[voxel as usize], voxel)).unwrap_or(NONE)
    };
    let mut sources: Vec<u32> = inside.par_iter().map(|&number| touching(number)).collect();
    let mut rim: Vec<usize> = (0..inside.len()).filter(|&at| sources[at] != NONE).collect();
    while !rim.is_empty() {
        progress.check()?;
        let mut offers: Vec<(usize, LabelId, u32)> = Vec::new();
        for &at in &rim {
            let next = around(inside[at]).filter_map(|next| inside.binary_search(&next).ok());
            let unowned = next.filter(|&next| sources[next] == NONE);
            offers.extend(unowned.map(|next| (next, labels[sources[at] as usize], sources[at])));
        }
        offers.par_sort_unstable();
        offers.dedup_by_key(|&mut (next, ..)| next);
        offers.iter().for_each(|&(next, _, source)| sources[next] = source);
        rim = offers.into_iter().map(|(next, ..)| next).collect();
    }
    Ok(sources)
}
