//! The dense cloud, and its thinning by voxels.

use std::collections::BTreeMap;

use glam::Vec3;
use rustc_hash::{FxHashMap, FxHashSet};

use ostra_cloud::fuse::{SeenPoint, SeenPoints};
use ostra_cloud::{LabelledCloud, SceneError};
use ostra_core::job::Progress;
use ostra_geometry::Camera;

/// Maximum number of attempts to find the edge that gives the requested number of points; three are usual.
const MOST_TRIES: usize = 8;
/// An edge is fine enough if it gives at least this share of the maximum.
const ENOUGH: f64 = 0.7;
/// Share of the maximum that is aimed at.
const AIM: f64 = 0.85;

impl DenseCloud {
    /// Splits the cloud into points without labels and, for each frame, the points that it sees and their pixels.
    ///
    /// The latter are the votes for [`ostra_cloud::fuse::vote_onto`]. Contributors outside the
    /// frame's lens are left out.
    #[must_use]
    pub fn into_points(self) -> (LabelledCloud, SeenPoints) {
        let mut seen: SeenPoints = self
            .views
            .iter()
            .map(|view| (view.frame, Vec::new()))
            .collect();
        for point in 0..self.len() {
            for &contributor in self.contributors(point) {
                let frame = self.views[contributor.view as usize].frame;
                if let (Some((x, y)), Some(list)) =
                    (self.frame_pixel(contributor), seen.get_mut(&frame))
                {
                    list.push(SeenPoint {
                        point: point as u32,
                        x,
                        y,
                    });
                }
            }
        }
        let mut points = LabelledCloud::from_positions(self.positions);
        (points.normals, points.colors) = (self.normals, self.colors);
        (points, seen)
    }

    /// Keeps at most one point per voxel: the one nearest to the mean of all in it.
    ///
    /// It gets the pixels of all of them, one per view.
    ///
    /// # Errors
    /// [`SceneError::Request`] for an edge (world units) that is not above 0.
    pub fn thinned(&self, voxel: f64) -> Result<Self, SceneError> {
        if !(voxel.is_finite() && voxel > 0.0) {
            return Err(SceneError::Request(format!(
                "a voxel size of {voxel} is not possible; give a length above 0"
            )));
        }
        let origin = self
            .positions
            .iter()
            .copied()
            .reduce(Vec3::min)
            .unwrap_or_default();
        let mut voxels: FxHashMap<[i64; 3], Vec<u32>> = FxHashMap::default();
        for (point, position) in (0..).zip(&self.positions) {
            voxels
                .entry(voxel_of(*position, origin, voxel))
                .or_default()
                .push(point);
        }
        let mut kept: Vec<(u32, Vec<u32>)> = voxels
            .into_values()
            .map(|points| (self.middle(&points), points))
            .collect();
        kept.sort_unstable();
        let mut thin = Self {
            offsets: vec![0],
            views: self.views.clone(),
            ..Self::default()
        };
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

    /// Thins the cloud to about `most` points at most.
    ///
    /// The cloud stays unchanged if it has no more. Otherwise it is thinned with the smallest edge
    /// that gives no more; the edge is returned too.
    ///
    /// # Errors
    /// [`SceneError::Stopped`]; [`SceneError::Request`] for points without extent.
    pub fn thinned_to(
        self,
        most: usize,
        progress: &Progress,
    ) -> Result<(Self, Option<f64>), SceneError> {
        if self.len() <= most {
            return Ok((self, None));
        }
        let (min, max) = self.positions.iter().fold(
            (Vec3::INFINITY, Vec3::NEG_INFINITY),
            |(min, max), &position| (min.min(position), max.max(position)),
        );
        // The points fill a surface about as large as the sides of their box, or less.
        let mut voxel = f64::from((max - min).length()) / (most as f64).sqrt();
        for _ in 0..MOST_TRIES {
            progress.check()?;
            let ratio = self.voxels(min, voxel) as f64 / most as f64;
            if (ENOUGH..=1.0).contains(&ratio) {
                break;
            }
            // Aims below the maximum: surfaces have two dimensions, noise adds to them.
            voxel *= (ratio / AIM).powf(0.45).clamp(0.1, 10.0);
        }
        Ok((self.thinned(voxel)?, Some(voxel)))
    }

    /// Returns the number of voxels that hold points.
    fn voxels(&self, origin: Vec3, voxel: f64) -> usize {
        let keys: FxHashSet<[i64; 3]> = self
            .positions
            .iter()
            .map(|&position| voxel_of(position, origin, voxel))
            .collect();
        keys.len()
    }

    /// Returns the point nearest to the mean of some points.
    fn middle(&self, points: &[u32]) -> u32 {
        let at = |&point: &u32| self.positions[point as usize];
        let mean = points.iter().map(at).sum::<Vec3>() / points.len() as f32;
        let distance = |point: &u32| at(point).distance_squared(mean);
        points
            .iter()
            .copied()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)))
            .unwrap_or_default()
    }
}

fn voxel_of(position: Vec3, origin: Vec3, voxel: f64) -> [i64; 3] {
    (position - origin)
        .to_array()
        .map(|along| (f64::from(along) / voxel).floor() as i64)
}

/// A pixel that contributed to a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Contributor {
    /// Index of the cloud's view.
    pub view: u32,
    /// Index of the pixel in that view's raster, row by row.
    pub pixel: u32,
}

/// A view that contributed points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FusedView {
    /// Frame number.
    pub frame: usize,
    /// The raster of its depth, without distortion.
    pub raster: Camera,
    /// The frame's own camera.
    pub camera: Camera,
}

/// Points and the pixels that contributed to each.
///
/// All vectors except `offsets` and `contributors` have one value per point.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DenseCloud {
    /// Positions in world units.
    pub positions: Vec<Vec3>,
    /// Unit normals towards the cameras; zero = unknown.
    pub normals: Vec<Vec3>,
    /// Colours, sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Index of the first contributor of each point, then the number of all.
    pub offsets: Vec<u32>,
    /// The contributing pixels, grouped by point; each pixel occurs once.
    pub contributors: Vec<Contributor>,
    /// The views, indexed by contributors.
    pub views: Vec<FusedView>,
}

impl DenseCloud {
    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Returns the pixels that contributed to a point.
    #[must_use]
    pub fn contributors(&self, point: usize) -> &[Contributor] {
        &self.contributors[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Returns column and row of a contributor in the frame's image; `None` if it lies outside.
    #[must_use]
    pub fn frame_pixel(&self, contributor: Contributor) -> Option<(u32, u32)> {
        let view = &self.views[contributor.view as usize];
        let (x, y) = (
            contributor.pixel % view.raster.width,
            contributor.pixel / view.raster.width,
        );
        let at_px = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let at_px = view
            .camera
            .project(view.raster.unproject(at_px).extend(1.0))?;
        view.camera
            .contains(at_px)
            .then_some((at_px.x as u32, at_px.y as u32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stereo::FusedView;
    use ostra_geometry::Camera;

    /// Returns three points on a line, the first two 0.2 apart, of two views with 4 × 3 pixels at
    /// half the images' size.
    fn cloud() -> DenseCloud {
        let raster = Camera::pinhole(4, 3, [4.0, 4.0], [2.0, 1.5]);
        let camera = Camera::pinhole(8, 6, [8.0, 8.0], [4.0, 3.0]);
        let by = |view, pixel| Contributor { view, pixel };
        DenseCloud {
            positions: [0.0, 0.2, 3.0].map(|x| Vec3::new(x, 0.0, 0.0)).to_vec(),
            normals: vec![Vec3::Z; 3],
            colors: vec![[1; 3], [2; 3], [3; 3]],
            offsets: vec![0, 2, 3, 5],
            contributors: vec![by(0, 0), by(1, 5), by(1, 6), by(0, 11), by(1, 7)],
            views: [4, 9]
                .map(|frame| FusedView {
                    frame,
                    raster,
                    camera,
                })
                .to_vec(),
        }
    }

    #[test]
    fn contributors_map_to_pixels_of_their_frame() {
        let (points, seen) = cloud().into_points();
        assert_eq!(
            (points.len(), points.colors[2], points.normals[1]),
            (3, [3; 3], Vec3::Z)
        );
        let at = |point, x, y| SeenPoint { point, x, y };
        assert_eq!(seen[&4], [at(0, 1, 1), at(2, 7, 5)]);
        assert_eq!(seen[&9], [at(0, 3, 3), at(1, 5, 3), at(2, 7, 3)]);
    }

    #[test]
    fn large_cloud_is_thinned_to_about_the_requested_size() {
        let at = |k: u32| Vec3::new((k % 200) as f32, (k / 200) as f32, 0.0);
        let dense = DenseCloud {
            positions: (0..40_000).map(at).collect(),
            normals: vec![Vec3::Z; 40_000],
            colors: vec![[1; 3]; 40_000],
            offsets: vec![0; 40_001],
            ..cloud()
        };
        let (thin, voxel) = dense
            .clone()
            .thinned_to(4000, &Progress::default())
            .unwrap();
        assert!(
            (2500..=4000).contains(&thin.len()),
            "{} at {voxel:?}",
            thin.len()
        );
        assert_eq!(
            dense
                .clone()
                .thinned_to(40_000, &Progress::default())
                .unwrap(),
            (dense, None)
        );
    }

    #[test]
    fn voxel_keeps_one_point_and_one_pixel_per_view() {
        let thin = cloud().thinned(1.0).unwrap();
        assert_eq!(thin.positions, [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0)]);
        let of = |point| {
            thin.contributors(point)
                .iter()
                .map(|by| (by.view, by.pixel))
                .collect::<Vec<_>>()
        };
        assert_eq!(
            (of(0), of(1)),
            (vec![(0, 0), (1, 5)], vec![(0, 11), (1, 7)])
        );
        assert_eq!(cloud().thinned(0.01).unwrap(), cloud());
        assert!(cloud().thinned(0.0).is_err());
    }
}
