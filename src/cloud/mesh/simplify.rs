use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::LabelledMesh;
use super::collapse::Collapsing;
use super::weld::Welded;
use crate::SceneError;
use ostra_core::job::Progress;

/// Edges between two looks at the stop sign.
const STRIDE: usize = 1 << 12;

impl LabelledMesh {
    /// The mesh with about `share` of its triangles (above 0, up to 1), by drawing edges together where that changes the
    /// surface least (Garland & Heckbert, SIGGRAPH 1997). Borders between labels and open borders keep their course and
    /// stay closed, points where borders meet stay, and no label's surface vanishes; so a mesh of many small labels may
    /// keep more. Cut the mesh by [`Self::split_at_labels`] first.
    ///
    /// # Errors
    /// [`SceneError::Request`] for another share, [`SceneError::Stopped`].
    pub fn simplify(&self, share: f64, progress: &Progress) -> Result<Self, SceneError> {
        if !(share > 0.0 && share <= 1.0) {
            let what = format!(
                "a share of {share} of the triangles is not possible; give one above 0 and up to 1"
            );
            return Err(SceneError::Request(what));
        }
        let target = (self.triangles.len() as f64 * share).ceil() as usize;
        if target >= self.triangles.len() {
            return Ok(self.clone());
        }
        let mut mesh = Collapsing::new(Welded::of(self));
        let mut before = usize::MAX;
        // What was in the way of an edge may be gone in the next round.
        while mesh.left() > target && mesh.left() < before {
            before = mesh.left();
            collapse_cheapest(&mut mesh, target, progress)?;
        }
        let mut mesh = mesh.finish().unwelded(&self.vertices.tree);
        mesh.vertices.origin = self.vertices.origin;
        Ok(mesh)
    }
}

/// An edge in the queue: its cost as the bits of a float that is not below 0, its ends, and their stamps then, summed.
type Waiting = Reverse<(u64, [u32; 2], u32)>;

/// Draws edges together, the cheapest first, until `target` triangles are left or no edge can be.
fn collapse_cheapest(
    mesh: &mut Collapsing,
    target: usize,
    progress: &Progress,
) -> Result<(), SceneError> {
    let start = mesh.left();
    let mut stamps = vec![0u32; mesh.vertices()];
    let stamp = |stamps: &[u32], [a, b]: [u32; 2]| stamps[a as usize] + stamps[b as usize];
    let queued = |mesh: &Collapsing, stamps: &[u32], edge: [u32; 2]| -> Option<Waiting> {
        mesh.plan(edge)
            .map(|(cost, _)| Reverse((cost.to_bits(), edge, stamp(stamps, edge))))
    };
    let mut queue: BinaryHeap<Waiting> = mesh
        .edges()
        .into_iter()
        .filter_map(|edge| queued(mesh, &stamps, edge))
        .collect();
    let mut looked = 0usize;
    while mesh.left() > target
        && let Some(Reverse((_, edge, then))) = queue.pop()
    {
        looked += 1;
        if looked.is_multiple_of(STRIDE) {
            progress.step(start - mesh.left(), start - target)?;
        }
        if then != stamp(&stamps, edge) {
            continue;
        }
        let Some((_, point)) = mesh.plan(edge) else {
            continue;
        };
        if mesh.collapse(edge, point) {
            edge.iter().for_each(|&vertex| stamps[vertex as usize] += 1);
            let kept = edge[0];
            let around = mesh.neighbours(kept).into_iter().map(|other| [kept, other]);
            queue.extend(around.filter_map(|edge| queued(mesh, &stamps, edge)));
        }
    }
    Ok(())
}
