//! Mesh simplification by edge collapses, the cheapest first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::LabelledMesh;
use super::quadric::{Edges, Freedom, Quadric};
use super::welded::{Fans, Welded};
use crate::SceneError;
use ostra_core::job::Progress;

/// Edges between two checks for cancellation.
const STRIDE: usize = 1 << 12;

impl LabelledMesh {
    /// Returns the mesh with about `share` of its triangles (above 0, up to 1).
    ///
    /// Edges are collapsed where that changes the surface least (Garland & Heckbert, SIGGRAPH
    /// 1997). Label borders and open borders keep their course and stay closed, and points where
    /// borders meet do not move. The surface of a label never vanishes, so a mesh of many small
    /// labels may keep more triangles. The mesh should be cut with [`Self::split_at_labels`] first.
    ///
    /// # Errors
    ///
    /// Returns [`SceneError::Request`] if the share is out of range. Returns
    /// [`SceneError::Stopped`] if the job is stopped.
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
        // The obstacle to collapsing an edge may be gone in the next round.
        while mesh.left() > target && mesh.left() < before {
            before = mesh.left();
            collapse_cheapest(&mut mesh, target, progress)?;
        }
        let mut mesh = mesh.finish().unwelded(&self.vertices.tree);
        mesh.vertices.origin = self.vertices.origin;
        Ok(mesh)
    }
}

/// An edge in the queue: its cost, its ends, and the sum of their stamps when it was queued.
///
/// The cost is stored as the bits of a non-negative float.
type Waiting = Reverse<(u64, [u32; 2], u32)>;

/// Collapses edges, the cheapest first, until `target` triangles are left or no edge can collapse.
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

/// Marks a removed triangle.
const GONE: [u32; 3] = [u32::MAX; 3];

/// A mesh whose edges are collapsed one after the other.
struct Collapsing {
    mesh: Welded,
    fans: Fans,
    freedom: Vec<Freedom>,
    quadrics: Vec<Quadric>,
    left: usize,
}

impl Collapsing {
    fn new(mesh: Welded) -> Self {
        let Edges { freedom, quadrics } = Edges::of(&mesh);
        let fans = Fans::of(mesh.positions.len(), &mesh.triangles);
        let left = mesh.triangles.len();
        Self {
            mesh,
            fans,
            freedom,
            quadrics,
            left,
        }
    }

    /// Returns every remaining edge once, with the lower vertex first, in ascending order.
    fn edges(&self) -> Vec<[u32; 2]> {
        let there = self
            .mesh
            .triangles
            .iter()
            .filter(|triangle| **triangle != GONE);
        let sides = there.flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let mut edges: Vec<[u32; 2]> = sides.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    }

    /// Returns the number of vertices of the original mesh.
    fn vertices(&self) -> usize {
        self.mesh.positions.len()
    }

    /// Returns the number of remaining triangles.
    fn left(&self) -> usize {
        self.left
    }

    /// Returns the mesh without the removed triangles.
    fn finish(mut self) -> Welded {
        let there = |triangle: &[u32; 3]| *triangle != GONE;
        let mut kept = self.mesh.triangles.iter().map(there);
        self.mesh.labels.retain(|_| kept.next().unwrap_or(false));
        self.mesh.triangles.retain(there);
        self.mesh
    }

    /// Returns the vertices that share an edge with this one, in ascending order.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let corners = self
            .fans
            .triangles(vertex)
            .flat_map(|triangle| self.mesh.triangles[triangle]);
        let mut found: Vec<u32> = corners.filter(|&other| other != vertex).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Returns the cost of collapsing an edge and the resulting point.
    ///
    /// The cost is a weighted area times a squared distance. Returns `None` if the ends must not be
    /// merged.
    fn plan(&self, [a, b]: [u32; 2]) -> Option<(f64, DVec3)> {
        /// Weight of the fourth power of the edge length in the cost.
        ///
        /// It makes short edges collapse first.
        const SHORT_FIRST: f64 = 1e-4;
        let [free_a, free_b] = [a, b].map(|vertex| self.freedom[vertex as usize]);
        let both_fixed = free_a.min(free_b) == Freedom::Fixed;
        let both_on_borders = free_a.min(free_b) >= Freedom::Border;
        if both_fixed || (both_on_borders && !self.is_border(a, b)) {
            return None;
        }
        let [from, to] = [a, b].map(|vertex| self.mesh.positions[vertex as usize]);
        let quadric = self.quadrics[a as usize] + self.quadrics[b as usize];
        let point = match free_a.cmp(&free_b) {
            std::cmp::Ordering::Greater => from,
            std::cmp::Ordering::Less => to,
            std::cmp::Ordering::Equal => best_point(&quadric, from, to),
        };
        Some((
            quadric.at(point) + SHORT_FIRST * from.distance_squared(to).powi(2),
            point,
        ))
    }

    /// Merges `b` into `a` at `point`, as planned; returns whether that was possible.
    ///
    /// It is not possible if it would make a fold or a hole, or remove the last triangle of a
    /// label.
    fn collapse(&mut self, [a, b]: [u32; 2], point: DVec3) -> bool {
        if !self.keeps_shape(a, b) || self.flips(a, b, point) || self.flips(b, a, point) {
            return false;
        }
        let [from, to] = [a, b].map(|vertex| self.mesh.positions[vertex as usize]);
        let share =
            ((point - from).dot(to - from) / from.distance_squared(to)).clamp(0.0, 1.0) as f32;
        let [a_at, b_at] = [a, b].map(|vertex| vertex as usize);
        self.mesh.attributes[a_at] =
            self.mesh.attributes[a_at].lerp(self.mesh.attributes[b_at], share);
        self.mesh.positions[a_at] = point;
        let other = self.quadrics[b_at];
        self.quadrics[a_at] += other;
        self.freedom[a_at] = self.freedom[a_at].max(self.freedom[b_at]);
        self.drop_between(a, b);
        for corner in self
            .fans
            .corners(b)
            .map(|corner| corner as usize)
            .collect::<Vec<_>>()
        {
            self.mesh.triangles[corner / 3][corner % 3] = a;
        }
        self.fans.join(a, b);
        true
    }

    fn drop_between(&mut self, a: u32, b: u32) {
        for triangle in self.between(a, b).collect::<Vec<_>>() {
            let corners = std::mem::replace(&mut self.mesh.triangles[triangle], GONE);
            corners.iter().for_each(|&vertex| {
                self.fans
                    .retain(vertex, |corner| corner as usize / 3 != triangle);
            });
            self.left -= 1;
        }
    }

    /// Returns the triangles that contain both vertices.
    fn between(&self, a: u32, b: u32) -> impl Iterator<Item = usize> {
        self.fans
            .triangles(a)
            .filter(move |&triangle| self.mesh.triangles[triangle].contains(&b))
    }

    /// Returns whether the edge is a border.
    ///
    /// An edge is a border unless it has exactly two triangles, and these have the same label.
    fn is_border(&self, a: u32, b: u32) -> bool {
        let mut labels = self
            .between(a, b)
            .map(|triangle| self.mesh.labels[triangle]);
        let first = labels.next();
        labels.next() != first || labels.next().is_some()
    }

    /// Returns whether collapsing an edge preserves the topology.
    ///
    /// This is the link condition (Dey, Edelsbrunner, Guha & Nekhayev, "Topology preserving edge
    /// contraction", 1999). In addition, a border must not close on itself, and no vertex may be
    /// left with two triangles.
    fn keeps_shape(&self, a: u32, b: u32) -> bool {
        let around = self.neighbours(b);
        let common = self
            .neighbours(a)
            .into_iter()
            .filter(|vertex| around.binary_search(vertex).is_ok())
            .count();
        let shared = self.between(a, b).count();
        let stays = |triangle: usize| {
            let opposite = self.mesh.triangles[triangle]
                .into_iter()
                .find(|&vertex| vertex != a && vertex != b);
            opposite.is_some_and(|opposite| {
                let triangles = self.fans.triangles(opposite).count();
                let closed = self.neighbours(opposite).len() == triangles;
                let closes = self.is_border(a, opposite) && self.is_border(b, opposite);
                let folds = closed && triangles <= 3;
                !closes && !folds
            })
        };
        (1..=2).contains(&shared) && common == shared && self.between(a, b).all(stays)
    }

    /// Returns whether moving `moved` to `point` would turn one of its triangles too far.
    ///
    /// Triangles that also contain `other` are ignored.
    fn flips(&self, moved: u32, other: u32, point: DVec3) -> bool {
        /// Cosine of the largest allowed rotation.
        const LARGEST_TURN: f64 = 0.2;
        self.fans.triangles(moved).any(|triangle| {
            let corners = self.mesh.triangles[triangle];
            if corners.contains(&other) {
                return false;
            }
            let before = corners.map(|vertex| self.mesh.positions[vertex as usize]);
            let after = [0, 1, 2].map(|at| {
                if corners[at] == moved {
                    point
                } else {
                    before[at]
                }
            });
            let [before, after] = [before, after].map(|[a, b, c]| (b - a).cross(c - a));
            before.dot(after) <= LARGEST_TURN * before.length() * after.length()
                && before != DVec3::ZERO
        })
    }
}

/// Returns the minimum of a quadric if it is near the edge.
///
/// Otherwise it returns the best of the edge's midpoint and ends.
fn best_point(quadric: &Quadric, from: DVec3, to: DVec3) -> DVec3 {
    let middle = from.midpoint(to);
    let near = |point: &DVec3| point.distance_squared(middle) <= from.distance_squared(to);
    let on_edge = || {
        [middle, from, to]
            .into_iter()
            .min_by(|a, b| quadric.at(*a).total_cmp(&quadric.at(*b)))
    };
    quadric
        .lowest()
        .filter(near)
        .or_else(on_edge)
        .unwrap_or(middle)
}
