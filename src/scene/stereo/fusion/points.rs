use std::collections::BTreeMap;

use glam::Vec3;
use rustc_hash::FxHashMap;

use super::cloud::{Contributor, DenseCloud};
use crate::scene::fuse::{SeenPoint, SeenPoints};
use crate::scene::{LabelledCloud, SceneError};

impl DenseCloud {
    /// The points without labels, and for each frame that made points which of them it sees, in which pixel: what
    /// [`crate::scene::fuse::vote_onto`] lets vote. Contributors that the lens does not show are left out.
    #[must_use]
    pub fn into_points(self) -> (LabelledCloud, SeenPoints) {
        let mut seen: SeenPoints = self.views.iter().map(|view| (view.frame, Vec::new())).collect();
        for point in 0..self.len() {
            for &contributor in self.contributors(point) {
                let frame = self.views[contributor.view as usize].frame;
                if let (Some((x, y)), Some(list)) = (self.frame_pixel(contributor), seen.get_mut(&frame)) {
                    list.push(SeenPoint { point: point as u32, x, y });
                }
            }
        }
        let mut points = LabelledCloud::from_positions(self.positions);
        (points.normals, points.colors) = (self.normals, self.colors);
        (points, seen)
    }

    /// At most one point per voxel: the one nearest to the mean of all in it, with the pixels of all of them, one a view.
    ///
    /// # Errors
    /// [`SceneError::Request`] for an edge (world units) that is not above 0.
    pub fn thinned(&self, voxel: f64) -> Result<Self, SceneError> {
        if !(voxel.is_finite() && voxel > 0.0) {
            return Err(SceneError::Request(format!("a voxel size of {voxel} is not possible; give a length above 0")));
        }
        let origin = self.positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
        let mut voxels: FxHashMap<[i64; 3], Vec<u32>> = FxHashMap::default();
        for (point, position) in (0..).zip(&self.positions) {
            let key = (*position - origin).to_array().map(|along| (f64::from(along) / voxel).floor() as i64);
            voxels.entry(key).or_default().push(point);
        }
        let mut kept: Vec<(u32, Vec<u32>)> =
            voxels.into_values().map(|points| (self.middle(&points), points)).collect();
        kept.sort_unstable();
        let mut thin = Self { offsets: vec![0], views: self.views.clone(), ..Self::default() };
        for (point, all) in kept {
            let by_view: BTreeMap<u32, Contributor> = (all.iter().rev())
                .flat_map(|&other| self.contributors(other as usize))
                .chain(self.contributors(point as usize))
                .map(|&contributor| (contributor.view, contributor))
                .collect();
            thin.positions.push(self.positions[point as usize]);
            thin.normals.push(self.normals[point as usize]);
            thin.colors.push(self.colors[point as usize]);
            thin.contributors.extend(by_view.into_values());
            thin.offsets.push(thin.contributors.len() as u32);
        }
        Ok(thin)
    }

    /// Of some points the one nearest to their mean.
    fn middle(&self, points: &[u32]) -> u32 {
        let at = |&point: &u32| self.positions[point as usize];
        let mean = points.iter().map(at).sum::<Vec3>() / points.len() as f32;
        let distance = |point: &u32| at(point).distance_squared(mean);
        points.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Camera;
    use crate::scene::stereo::FusedView;

    /// Three points on a line, the first two 0.2 apart, of two views with 4 × 3 pixels at half the pictures' size.
    fn cloud() -> DenseCloud {
        let raster = Camera::pinhole(4, 3, 4.0, 4.0, 2.0, 1.5);
        let camera = Camera::pinhole(8, 6, 8.0, 8.0, 4.0, 3.0);
        let by = |view, pixel| Contributor { view, pixel };
        DenseCloud {
            positions: [0.0, 0.2, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec(),
            normals: vec![Vec3::Z; 3],
            colors: vec![[1; 3], [2; 3], [3; 3]],
            offsets: vec![0, 2, 3, 5],
            contributors: vec![by(0, 0), by(1, 5), by(1, 6), by(0, 11), by(1, 7)],
            views: [4, 9].map(|frame| FusedView { frame, raster, camera }).to_vec(),
        }
    }

    #[test]
    fn every_contributor_is_a_pixel_of_its_frame() {
        let (points, seen) = cloud().into_points();
        assert_eq!((points.len(), points.colors[2], points.normals[1]), (3, [3; 3], Vec3::Z));
        let at = |point, x, y| SeenPoint { point, x, y };
        assert_eq!(seen[&4], [at(0, 1, 1), at(2, 7, 5)]);
        assert_eq!(seen[&9], [at(0, 3, 3), at(1, 5, 3), at(2, 7, 3)]);
    }

    #[test]
    fn a_voxel_keeps_one_point_and_one_pixel_of_each_view() {
        let thin = cloud().thinned(1.0).unwrap();
        assert_eq!(thin.positions, [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0)]);
        let of = |point| thin.contributors(point).iter().map(|by| (by.view, by.pixel)).collect::<Vec<_>>();
        assert_eq!((of(0), of(1)), (vec![(0, 0), (1, 5)], vec![(0, 11), (1, 7)]));
        assert_eq!(cloud().thinned(0.01).unwrap(), cloud());
        assert!(cloud().thinned(0.0).is_err());
    }
}
