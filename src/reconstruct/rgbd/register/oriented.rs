use glam::{DVec3, I64Vec3, Vec3};
use rayon::prelude::*;

use ostra_cloud::SceneError;

/// Points of surfaces with normals and brightness; three lists of the same length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OrientedCloud {
    /// In world units.
    pub positions: Vec<Vec3>,
    /// Unit vectors off the surface, towards the camera; zero if unknown.
    pub normals: Vec<Vec3>,
    /// Grey, 0–1; all equal if there is no colour.
    pub intensities: Vec<f32>,
}

impl OrientedCloud {
    /// Returns one point for each cube of edge `voxel` (world units, above 0) that contains points.
    ///
    /// A point has the mean position, normal and intensity; the order is that of the cubes.
    /// Non-finite points are dropped.
    #[must_use]
    pub fn thinned(&self, voxel: f32) -> Self {
        let cell = |position: &Vec3| {
            let I64Vec3 { x, y, z } = (position.as_dvec3() / f64::from(voxel))
                .floor()
                .as_i64vec3();
            (z, y, x)
        };
        let finite = self
            .positions
            .iter()
            .enumerate()
            .filter(|(_, position)| position.is_finite());
        let mut order: Vec<((i64, i64, i64), u32)> = finite
            .map(|(index, position)| (cell(position), index as u32))
            .collect();
        order.par_sort_unstable();
        let mut thin = Self::default();
        for group in order.chunk_by(|a, b| a.0 == b.0) {
            thin.push_mean(self, group.iter().map(|&(_, index)| index as usize));
        }
        thin
    }

    fn push_mean(&mut self, of: &Self, members: impl ExactSizeIterator<Item = usize>) {
        let count = members.len() as f64;
        let (mut position, mut normal, mut intensity) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for index in members {
            position += of.positions[index].as_dvec3();
            normal += of.normals[index].as_dvec3();
            intensity += f64::from(of.intensities[index]);
        }
        self.positions.push((position / count).as_vec3());
        self.normals.push(normal.as_vec3().normalize_or_zero());
        self.intensities.push((intensity / count) as f32);
    }

    /// Returns the number of points.
    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Checks that the lists have the same length.
    pub(super) fn check(&self) -> Result<(), SceneError> {
        if self.normals.len() == self.len() && self.intensities.len() == self.len() {
            return Ok(());
        }
        let (points, normals, intensities) =
            (self.len(), self.normals.len(), self.intensities.len());
        Err(SceneError::Request(format!(
            "a cloud to register has {points} points, {normals} normals and {intensities} intensities; give one each"
        )))
    }
}

/// Checks that an edge is a length above 0.
pub(super) fn check_voxel(voxel: f32) -> Result<(), SceneError> {
    if voxel.is_finite() && voxel > 0.0 {
        return Ok(());
    }
    Err(SceneError::Request(format!(
        "a voxel size of {voxel} is not possible; give a length above 0"
    )))
}
