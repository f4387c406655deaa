use glam::{IVec3, Vec3};
use rustc_hash::FxHashSet;

use crate::{LabelledCloud, LabelledMesh};

/// The faces of voxels (as [`voxelize`](super::voxelize) made them) that no other voxel covers, for drawing.
#[must_use]
pub fn voxel_faces(voxels: &LabelledCloud, voxel: f64) -> LabelledMesh {
    let place = |at: Vec3| (at.as_dvec3() / voxel).floor().as_ivec3();
    let filled: FxHashSet<IVec3> = voxels.positions.iter().map(|&at| place(at)).collect();
    let mut mesh = LabelledMesh {
        vertices: LabelledCloud {
            tree: voxels.tree.clone(),
            origin: voxels.origin,
            ..LabelledCloud::default()
        },
        triangles: Vec::new(),
    };
    let half = (voxel / 2.0) as f32;
    for (point, &middle) in voxels.positions.iter().enumerate() {
        for axis in 0..3 {
            for side in [-1, 1] {
                if filled.contains(&(place(middle) + IVec3::AXES[axis] * side)) {
                    continue;
                }
                let normal = Vec3::AXES[axis] * side as f32;
                let (u, v) = (
                    Vec3::AXES[(axis + 1) % 3],
                    Vec3::AXES[(axis + 2) % 3] * side as f32,
                );
                let first = mesh.vertices.len() as u32;
                for (along, across) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                    let corner = middle + half * (normal + u * along + v * across);
                    mesh.vertices.push_copy(voxels, point, corner, normal);
                }
                mesh.triangles
                    .extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
            }
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_outer_faces_are_drawn_and_look_outward() {
        let voxels = LabelledCloud::from_positions(
            [-0.5, 0.5, 1.5].map(|x| Vec3::new(x, 0.5, 0.5)).to_vec(),
        );
        let mesh = voxel_faces(&voxels, 1.0);
        // Three cubes in a row: 4 sides each, and two ends.
        assert_eq!(mesh.triangles.len(), (3 * 4 + 2) * 2);
        let middle = Vec3::splat(0.5);
        let enclosed: f32 = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] =
                    triangle.map(|vertex| mesh.vertices.positions[vertex as usize] - middle);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!((enclosed - 3.0).abs() < 1e-5, "{enclosed}");
    }
}
