use glam::{DVec3, IVec3};

use crate::{LabelledCloud, SceneError};

/// Where voxels lie in their grid.
pub(super) struct Places {
    /// The corner of the voxel at (0, 0, 0) that is lowest along each axis, world units.
    pub(super) origin: DVec3,
    /// Each voxel's place along x, y and z, from 0.
    pub(super) indices: Vec<IVec3>,
}

impl Places {
    /// Of voxels of edge `voxel` (world units), each a point at its middle; the grid's corners are multiples of the edge.
    pub(super) fn of(voxels: &LabelledCloud, voxel: f64) -> Result<Self, SceneError> {
        if voxels.is_empty() {
            return Err(SceneError::Request("there are no voxels to write".into()));
        }
        let place = |at: &glam::Vec3| (at.as_dvec3() / voxel).floor().as_ivec3();
        let mut indices: Vec<IVec3> = voxels.positions.iter().map(place).collect();
        let least = indices
            .iter()
            .copied()
            .reduce(IVec3::min)
            .unwrap_or_default();
        indices.iter_mut().for_each(|index| *index -= least);
        Ok(Self {
            origin: least.as_dvec3() * voxel,
            indices,
        })
    }
}
