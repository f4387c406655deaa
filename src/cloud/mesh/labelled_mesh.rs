use std::collections::BTreeMap;

use glam::Vec3;

use crate::LabelledCloud;
use ostra_masks::LabelId;

/// A triangle mesh whose vertices are labelled points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LabelledMesh {
    /// Vertices with normals, colours, labels and confidences.
    pub vertices: LabelledCloud,
    /// Vertex indices of each triangle, counterclockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl LabelledMesh {
    /// Returns the triangles for which `keep` holds, in order, with the vertices they use.
    ///
    /// Also returns the indices of these vertices in this mesh, in ascending order.
    #[must_use]
    pub fn filter(&self, mut keep: impl FnMut(usize) -> bool) -> (Self, Vec<u32>) {
        let kept: Vec<[u32; 3]> = self
            .triangles
            .iter()
            .enumerate()
            .filter(|(at, _)| keep(*at))
            .map(|(_, &triangle)| triangle)
            .collect();
        let mut place = vec![u32::MAX; self.vertices.len()];
        kept.iter()
            .flatten()
            .for_each(|&vertex| place[vertex as usize] = 0);
        let used: Vec<u32> = (0..self.vertices.len() as u32)
            .filter(|&at| place[at as usize] == 0)
            .collect();
        used.iter()
            .enumerate()
            .for_each(|(new, &old)| place[old as usize] = new as u32);
        let triangles = kept
            .into_iter()
            .map(|triangle| triangle.map(|vertex| place[vertex as usize]))
            .collect();
        (
            Self {
                vertices: self.vertices.select(&used),
                triangles,
            },
            used,
        )
    }

    /// Returns the mesh with every triangle between labels cut at the midpoints of its sides.
    ///
    /// Each triangle then lies within one label, and all borders are sharp. The new vertices are
    /// duplicated for each label.
    #[must_use]
    pub fn split_at_labels(&self) -> Self {
        let mut mesh = Self {
            vertices: self.vertices.clone(),
            triangles: Vec::with_capacity(self.triangles.len()),
        };
        let mut made = rustc_hash::FxHashMap::default();
        for &triangle in &self.triangles {
            let labels = triangle.map(|vertex| self.vertices.labels[vertex as usize]);
            if labels[0] == labels[1] && labels[1] == labels[2] {
                mesh.triangles.push(triangle);
                continue;
            }
            let mut between = |ends: &[u32], label: LabelId| {
                let mut key = ends.to_vec();
                key.sort_unstable();
                // The ascending order makes the midpoint bit for bit the same for every label.
                *made
                    .entry((key, label))
                    .or_insert_with_key(|(ends, _)| mesh.vertices.push_mean(ends, label))
            };
            for corner in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|step| triangle[(corner + step) % 3]);
                let [own, next, last] = [0, 1, 2].map(|step| labels[(corner + step) % 3]);
                if own == next && next != last {
                    // This side stays whole; the part beyond the midpoints of the other two belongs
                    // to the third corner.
                    let (bc, ca) = (between(&[b, c], own), between(&[c, a], own));
                    let (far_bc, far_ca) = (between(&[b, c], last), between(&[c, a], last));
                    mesh.triangles
                        .extend([[a, b, bc], [a, bc, ca], [far_ca, far_bc, c]]);
                } else if own != next && next != last && own != last {
                    let (ab, ca, middle) = (
                        between(&[a, b], own),
                        between(&[c, a], own),
                        between(&[a, b, c], own),
                    );
                    mesh.triangles.extend([[a, ab, middle], [a, middle, ca]]);
                }
            }
        }
        mesh
    }

    /// Returns the triangles of each label with the vertices they use, in ascending order of ids.
    ///
    /// A triangle belongs to the label of its first vertex, so the mesh should be cut with
    /// [`Self::split_at_labels`] first.
    #[must_use]
    pub fn by_label(&self) -> BTreeMap<LabelId, Self> {
        let mut of_label: BTreeMap<LabelId, Vec<[u32; 3]>> = BTreeMap::new();
        for &triangle in &self.triangles {
            of_label
                .entry(self.vertices.labels[triangle[0] as usize])
                .or_default()
                .push(triangle);
        }
        let mut place = vec![u32::MAX; self.vertices.len()];
        of_label
            .into_iter()
            .map(|(id, triangles)| (id, self.part(triangles, &mut place)))
            .collect()
    }

    /// Returns a mesh of some of the triangles.
    ///
    /// `place` has one entry per vertex, which is [`u32::MAX`] before and after.
    fn part(&self, mut triangles: Vec<[u32; 3]>, place: &mut [u32]) -> Self {
        let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        used.iter()
            .enumerate()
            .for_each(|(new, &old)| place[old as usize] = new as u32);
        triangles
            .iter_mut()
            .flatten()
            .for_each(|vertex| *vertex = place[*vertex as usize]);
        used.iter().for_each(|&old| place[old as usize] = u32::MAX);
        Self {
            vertices: self.vertices.select(&used),
            triangles,
        }
    }

    /// Computes vertex normals as the area-weighted mean over the adjacent triangles.
    pub fn compute_normals(&mut self) {
        let mut sums = vec![Vec3::ZERO; self.vertices.len()];
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|vertex| self.vertices.positions[vertex as usize]);
            let normal = (b - a).cross(c - a);
            triangle
                .iter()
                .for_each(|&vertex| sums[vertex as usize] += normal);
        }
        self.vertices.normals = sums.into_iter().map(Vec3::normalize_or_zero).collect();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_triangles() -> LabelledMesh {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
        let mut vertices = LabelledCloud::from_positions(corners.to_vec());
        vertices.labels = [1, 1, 2, 3].map(LabelId).to_vec();
        LabelledMesh {
            vertices,
            triangles: vec![[0, 1, 2], [0, 2, 3]],
        }
    }

    fn area(mesh: &LabelledMesh, label: Option<LabelId>) -> f32 {
        let of = |triangle: &&[u32; 3]| {
            label.is_none_or(|label| {
                triangle
                    .iter()
                    .all(|&at| mesh.vertices.labels[at as usize] == label)
            })
        };
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|at| mesh.vertices.positions[at as usize]);
            (b - a).cross(c - a).z / 2.0
        };
        mesh.triangles.iter().filter(of).map(area).sum()
    }

    #[test]
    fn split_triangles_lie_in_one_label_and_cover_the_same_area() {
        let mesh = two_triangles();
        let split = mesh.split_at_labels();
        assert!((area(&split, None) - 1.0).abs() < 1e-6);
        let [first, second, third] = [1, 2, 3].map(|id| area(&split, Some(LabelId(id))));
        assert!(
            (first + second + third - 1.0).abs() < 1e-6,
            "no triangle has two labels"
        );
        // Three quarters of the first triangle, a third of the second.
        assert!((first - (0.375 + 1.0 / 6.0)).abs() < 1e-6, "{first}");
        assert!((second - (0.125 + 1.0 / 6.0)).abs() < 1e-6, "{second}");
        assert_eq!(split.vertices.positions[..4], mesh.vertices.positions[..]);
    }

    #[test]
    fn parts_contain_the_triangles_of_each_label() {
        let split = two_triangles().split_at_labels();
        let parts = split.by_label();
        assert_eq!(parts.keys().map(|id| id.0).collect::<Vec<_>>(), [1, 2, 3]);
        for (&id, part) in &parts {
            assert!(part.vertices.labels.iter().all(|&label| label == id));
            assert!((area(part, None) - area(&split, Some(id))).abs() < 1e-6);
            let used: std::collections::BTreeSet<u32> =
                part.triangles.iter().flatten().copied().collect();
            assert_eq!(
                used.len(),
                part.vertices.len(),
                "no vertex without a triangle"
            );
        }
    }

    #[test]
    fn border_vertices_are_bit_identical_on_both_sides() {
        let mut mesh = two_triangles();
        mesh.vertices.positions = [
            [0.1, 0.7, 0.3],
            [1.3, 0.1, 0.9],
            [0.77, 1.9, 0.2],
            [0.3, 1.1, 3.7],
        ]
        .map(Vec3::from)
        .to_vec();
        let split = mesh.split_at_labels();
        let bits: std::collections::BTreeSet<_> = split
            .vertices
            .positions
            .iter()
            .map(|at| at.to_array().map(f32::to_bits))
            .collect();
        // Four corners, the midpoints of four cut sides, the centre of the second triangle.
        assert_eq!(bits.len(), 9);
    }

    #[test]
    fn filtered_mesh_has_no_unused_vertices() {
        let (half, used) = two_triangles().filter(|at| at == 1);
        assert_eq!(used, [0, 2, 3]);
        assert_eq!(half.triangles, [[0, 1, 2]]);
        assert_eq!(
            half.vertices.positions,
            [Vec3::ZERO, Vec3::new(1.0, 1.0, 0.0), Vec3::Y]
        );
    }

    #[test]
    fn normals_follow_the_counterclockwise_orientation() {
        let mut mesh = two_triangles();
        mesh.compute_normals();
        assert!(
            mesh.vertices
                .normals
                .iter()
                .all(|normal| normal.abs_diff_eq(Vec3::Z, 1e-6))
        );
    }
}
