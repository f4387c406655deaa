use glam::{DVec3, Vec3, Vec4};
use rustc_hash::FxHashMap;

use super::LabelledMesh;
use crate::LabelledCloud;
use ostra_masks::{LabelId, LabelTree};

/// A mesh whose triangles carry the labels, so that both sides of a label border share their vertices.
pub(super) struct Welded {
    /// World units.
    pub(super) positions: Vec<DVec3>,
    /// Red, green, blue (0–255) and confidence of each vertex.
    pub(super) looks: Vec<Vec4>,
    /// Three vertices each.
    pub(super) triangles: Vec<[u32; 3]>,
    /// The label of each triangle.
    pub(super) labels: Vec<LabelId>,
}

impl Welded {
    /// The mesh with vertices at one place made one; triangles that have no area then are left out.
    pub(super) fn of(mesh: &LabelledMesh) -> Self {
        let vertices = &mesh.vertices;
        let mut welded = Self {
            positions: Vec::new(),
            looks: Vec::new(),
            triangles: Vec::new(),
            labels: Vec::new(),
        };
        let mut found = FxHashMap::default();
        let mut place = Vec::with_capacity(vertices.len());
        for (at, &position) in vertices.positions.iter().enumerate() {
            // Adding 0 makes one of the two zeros.
            let key = (position + Vec3::ZERO).to_array().map(f32::to_bits);
            place.push(*found.entry(key).or_insert_with(|| {
                let [red, green, blue] = vertices.colors[at].map(f32::from);
                welded.positions.push(position.as_dvec3());
                welded
                    .looks
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

    /// The mesh with vertices that stand once for each label around them, with normals of the whole surface.
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
        let [red, green, blue, confidence] = self.looks[vertex].to_array();
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
