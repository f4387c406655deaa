//! The voxels that hold points, and their outer faces.

use std::collections::BTreeMap;

use glam::{DVec3, IVec3, Vec3};
use rustc_hash::FxHashSet;

use crate::fuse::GRID_REACH;
use crate::fuse::{Majority, Votes};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_masks::LabelId;

/// Maximum grid coordinate along an axis, in voxels.
const REACH: f64 = GRID_REACH as f64;

/// Sums over the points in one voxel.
#[derive(Default)]
struct OccupiedVoxel {
    points: u32,
    color: [u32; 3],
    normal: Vec3,
    votes: BTreeMap<LabelId, u32>,
}

/// Returns the voxels of edge length `voxel` (world units, above 0) that hold at least one point.
///
/// Each voxel is a point at its centre with the mean colour and normal of its points. Its label is
/// the majority of the votes on its points, or of their labels if there are no votes. The result is
/// in ascending order of z, y, x.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if the edge length is not above 0, or is too small for the
/// cloud.
pub fn voxelize(
    cloud: &LabelledCloud,
    votes: Option<&Votes>,
    voxel: f64,
) -> Result<LabelledCloud, SceneError> {
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        )));
    }
    let mut cells: BTreeMap<[i32; 3], OccupiedVoxel> = BTreeMap::new();
    for (point, position) in cloud.positions.iter().enumerate() {
        let place = (position.as_dvec3() / voxel).floor();
        if place.abs().max_element() >= REACH {
            return Err(SceneError::Request(format!(
                "voxels of {voxel} are too small for this cloud; give a larger size"
            )));
        }
        let cell = cells
            .entry([place.z, place.y, place.x].map(|along| along as i32))
            .or_default();
        cell.points += 1;
        cell.normal += cloud.normals[point];
        cell.color
            .iter_mut()
            .zip(cloud.colors[point])
            .for_each(|(sum, channel)| *sum += u32::from(channel));
        match votes {
            Some(votes) => votes.histogram(point).iter().for_each(|&(label, count)| {
                *cell.votes.entry(label).or_default() += u32::from(count);
            }),
            None => *cell.votes.entry(cloud.labels[point]).or_default() += 1,
        }
    }
    let majority = Majority::new(&cloud.tree);
    let mut voxels = LabelledCloud {
        tree: cloud.tree.clone(),
        origin: cloud.origin,
        ..LabelledCloud::default()
    };
    for ([z, y, x], cell) in cells {
        let verdict = majority.decide(&scaled(&cell.votes));
        voxels
            .positions
            .push(((DVec3::new(f64::from(x), f64::from(y), f64::from(z)) + 0.5) * voxel).as_vec3());
        voxels.normals.push(cell.normal.normalize_or_zero());
        voxels.colors.push(
            cell.color
                .map(|sum| ((sum + cell.points / 2) / cell.points) as u8),
        );
        voxels.labels.push(verdict.label);
        voxels.confidence.push(verdict.confidence);
    }
    Ok(voxels)
}

/// Scales votes down to 16 bits by halving them until they fit.
fn scaled(votes: &BTreeMap<LabelId, u32>) -> Vec<(LabelId, u16)> {
    let most = votes.values().copied().max().unwrap_or(0);
    let halvings = (32 - most.leading_zeros()).saturating_sub(16);
    votes
        .iter()
        .map(|(&label, &count)| (label, (count >> halvings) as u16))
        .collect()
}

/// Returns the faces of voxels that no other voxel covers, for rendering.
///
/// The voxels are those of [`voxelize`](super::voxelize).
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
    use ostra_masks::{Label, LabelTree};

    fn cloud() -> LabelledCloud {
        let points = [0.1, 0.4, 0.9, 1.5, -0.2].map(|x| Vec3::new(x, 0.5, 0.5));
        let mut cloud = LabelledCloud::from_positions(points.to_vec());
        cloud.labels = [1, 1, 2, 2, 0].map(LabelId).to_vec();
        cloud.colors = [[10, 0, 0], [20, 0, 0], [31, 0, 0], [7; 3], [9; 3]].to_vec();
        cloud.tree = LabelTree::default();
        for id in 1..=2 {
            cloud
                .tree
                .set(Label {
                    id: LabelId(id),
                    name: id.to_string(),
                    color: [id as u8; 3],
                    parent: None,
                })
                .unwrap();
        }
        cloud
    }

    #[test]
    fn voxel_has_the_mean_colour_and_majority_label_of_its_points() {
        let voxels = voxelize(&cloud(), None, 1.0).unwrap();
        assert_eq!(
            voxels.positions,
            [-0.5, 0.5, 1.5].map(|x| Vec3::new(x, 0.5, 0.5))
        );
        assert_eq!(voxels.labels, [0, 1, 2].map(LabelId));
        assert_eq!(voxels.colors[1], [20, 0, 0]);
        assert!((voxels.confidence[1] - 2.0 / 3.0).abs() < 1e-6);
    }

    #[test]
    fn invalid_sizes_are_errors() {
        for size in [0.0, -1.0, f64::NAN, 1e-9] {
            assert!(voxelize(&cloud(), None, size).is_err(), "{size}");
        }
    }

    #[test]
    fn only_outer_faces_are_returned_and_face_outward() {
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
