//! A mesh with coincident vertices welded, and the triangles around each vertex.

use glam::{DVec3, Vec3, Vec4};
use rustc_hash::FxHashMap;

use super::LabelledMesh;
use crate::LabelledCloud;
use ostra_masks::{LabelId, LabelTree};

/// A mesh with labels per triangle, so that both sides of a label border share vertices.
pub(super) struct Welded {
    /// In world units.
    pub(super) positions: Vec<DVec3>,
    /// Red, green, blue (0–255) and confidence of each vertex.
    pub(super) attributes: Vec<Vec4>,
    /// Vertex indices of each triangle.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The label of each triangle.
    pub(super) labels: Vec<LabelId>,
}

impl Welded {
    /// Welds coincident vertices of a mesh and drops the triangles that degenerate.
    pub(super) fn of(mesh: &LabelledMesh) -> Self {
        let vertices = &mesh.vertices;
        let mut welded = Self {
            positions: Vec::new(),
            attributes: Vec::new(),
            triangles: Vec::new(),
            labels: Vec::new(),
        };
        let mut found = FxHashMap::default();
        let mut place = Vec::with_capacity(vertices.len());
        for (at, &position) in vertices.positions.iter().enumerate() {
            // Adding 0 turns -0 into 0.
            let key = (position + Vec3::ZERO).to_array().map(f32::to_bits);
            place.push(*found.entry(key).or_insert_with(|| {
                let [red, green, blue] = vertices.colors[at].map(f32::from);
                welded.positions.push(position.as_dvec3());
                welded
                    .attributes
                    .push(Vec4::new(red, green, blue, vertices.confidence[at]));
                welded.positions.len() as u32 - 1
            }));
        }
        for triangle in &mesh.triangles {
            let [a, b, c] = triangle.map(|vertex| place[vertex as usize]);
            if a != b && b != c && c != a {
                welded.triangles.push([a, b, c]);
                welded.labels.push(vertices.labels[triangle[0] as usize]);
            }
        }
        welded
    }

    /// Returns the mesh with each vertex duplicated per adjacent label.
    ///
    /// Normals are those of the whole surface.
    pub(super) fn unwelded(&self, tree: &LabelTree) -> LabelledMesh {
        let positions = self
            .positions
            .iter()
            .map(|position| position.as_vec3())
            .collect();
        let triangles = self.triangles.clone();
        let mut whole = LabelledMesh {
            vertices: LabelledCloud::from_positions(positions),
            triangles,
        };
        whole.compute_normals();
        let mut mesh = LabelledMesh::default();
        mesh.vertices.tree = tree.clone();
        let mut made = FxHashMap::default();
        for (triangle, &label) in self.triangles.iter().zip(&self.labels) {
            let corners = triangle.map(|vertex| {
                *made.entry((vertex, label)).or_insert_with(|| {
                    let vertex = vertex as usize;
                    self.push(
                        &mut mesh.vertices,
                        vertex,
                        whole.vertices.normals[vertex],
                        label,
                    )
                })
            });
            mesh.triangles.push(corners);
        }
        mesh
    }

    fn push(
        &self,
        vertices: &mut LabelledCloud,
        vertex: usize,
        normal: Vec3,
        label: LabelId,
    ) -> u32 {
        let [red, green, blue, confidence] = self.attributes[vertex].to_array();
        vertices.positions.push(self.positions[vertex].as_vec3());
        vertices.normals.push(normal);
        vertices
            .colors
            .push([red, green, blue].map(|channel| channel.round() as u8));
        vertices.labels.push(label);
        vertices.confidence.push(confidence);
        vertices.len() as u32 - 1
    }
}

/// Marks the end of a list of corners.
const END: u32 = u32::MAX;

/// The triangles around each vertex, as linked lists of corners.
///
/// Corner `3·t + k` is the k-th corner of triangle `t`.
pub(super) struct Fans {
    first: Vec<u32>,
    next: Vec<u32>,
}

impl Fans {
    /// Builds the lists for `vertices` vertices.
    pub(super) fn of(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut fans = Self {
            first: vec![END; vertices],
            next: vec![END; triangles.len() * 3],
        };
        for (corner, &vertex) in triangles.as_flattened().iter().enumerate().rev() {
            fans.put(vertex, corner as u32);
        }
        fans
    }

    /// Returns the corners at a vertex.
    pub(super) fn corners(&self, vertex: u32) -> impl Iterator<Item = u32> {
        let some = |corner: u32| (corner != END).then_some(corner);
        std::iter::successors(some(self.first[vertex as usize]), move |&corner| {
            some(self.next[corner as usize])
        })
    }

    /// Returns the triangles around a vertex.
    pub(super) fn triangles(&self, vertex: u32) -> impl Iterator<Item = usize> {
        self.corners(vertex).map(|corner| corner as usize / 3)
    }

    /// Keeps only those corners at a vertex for which `keep` holds.
    pub(super) fn retain(&mut self, vertex: u32, keep: impl Fn(u32) -> bool) {
        let mut corner = std::mem::replace(&mut self.first[vertex as usize], END);
        while corner != END {
            let next = self.next[corner as usize];
            if keep(corner) {
                self.put(vertex, corner);
            }
            corner = next;
        }
    }

    /// Moves the corners at `gone` to `kept`.
    pub(super) fn join(&mut self, kept: u32, gone: u32) {
        let mut corner = std::mem::replace(&mut self.first[gone as usize], END);
        while corner != END {
            let next = self.next[corner as usize];
            self.put(kept, corner);
            corner = next;
        }
    }

    fn put(&mut self, vertex: u32, corner: u32) {
        self.next[corner as usize] = std::mem::replace(&mut self.first[vertex as usize], corner);
    }
}
