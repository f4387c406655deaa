//! Clouds at one voxel size, with the slopes of their brightness.

use glam::{DMat2, DVec2, DVec3, Vec3};
use rayon::prelude::*;

use super::oriented::OrientedCloud;
use super::pairs::SAME_NORMAL;
use ostra_cloud::points::Neighbours;
use ostra_core::job::{Progress, Stopped};
use ostra_geometry::Pose;

/// Maximum distance of partners, in voxels.
const REACH: f64 = 1.4;
/// Points processed between two checks for a stop.
const CHUNK: usize = 1024;

/// Two clouds thinned to the same voxels, ready for alignment.
pub struct IcpLevel {
    pub source: OrientedCloud,
    pub target: OrientedCloud,
    /// How the target's brightness changes along its surface; empty if brightness is not used.
    pub slopes: Vec<Vec3>,
    /// Edge of the voxels, in world units.
    pub voxel: f64,
    tree: Neighbours,
}

/// A source point and the target point nearest to it.
#[derive(Debug, Clone, Copy)]
pub struct Partner {
    /// Source point, transformed to the target's space.
    pub moved: DVec3,
    pub source: usize,
    pub target: usize,
}

/// Position of a source point when its distance to the target was last looked up; arbitrary before that.
#[derive(Debug, Clone, Copy, Default)]
pub struct LastLookup {
    moved: DVec3,
    distance: f64,
}

impl IcpLevel {
    /// Thins both clouds to `voxel`; `None` without points in the target.
    pub fn new(
        [source, target]: [&OrientedCloud; 2],
        voxel: f32,
        with_brightness: bool,
        progress: &Progress,
    ) -> Result<Option<Self>, Stopped> {
        progress.check()?;
        let (source, target) = rayon::join(|| source.thinned(voxel), || target.thinned(voxel));
        let Some(tree) = Neighbours::new(&target.positions) else {
            return Ok(None);
        };
        progress.check()?;
        let sloping = if with_brightness { target.len() } else { 0 };
        let slopes = (0..sloping)
            .into_par_iter()
            .map(|index| {
                progress
                    .check()
                    .map(|()| slope(&target, &tree, index, voxel))
            })
            .collect::<Result<_, _>>()?;
        Ok(Some(Self {
            source,
            target,
            slopes,
            voxel: f64::from(voxel),
            tree,
        }))
    }

    /// Returns source points with a near target point whose normal is within 45° of theirs.
    ///
    /// Points that were so far from the target that they cannot have come near since are not looked
    /// up again.
    pub fn partners(
        &self,
        target_from_source: &Pose,
        seen: &mut Vec<LastLookup>,
        progress: &Progress,
    ) -> Result<Vec<Partner>, Stopped> {
        seen.resize(self.source.len(), LastLookup::default());
        let of_chunk = |(chunk, seen): (usize, &mut [LastLookup])| {
            progress.check()?;
            let ours = seen.iter_mut().enumerate();
            Ok(ours
                .filter_map(|(at, seen)| self.partner(target_from_source, chunk * CHUNK + at, seen))
                .collect())
        };
        let chunks: Vec<Vec<Partner>> = seen
            .par_chunks_mut(CHUNK)
            .enumerate()
            .map(of_chunk)
            .collect::<Result<_, _>>()?;
        Ok(chunks.concat())
    }

    fn partner(
        &self,
        target_from_source: &Pose,
        source: usize,
        seen: &mut LastLookup,
    ) -> Option<Partner> {
        let reach = REACH * self.voxel;
        let moved = target_from_source.transform(self.source.positions[source].as_dvec3());
        if seen.distance - seen.moved.distance(moved) > 1.01 * reach {
            return None;
        }
        let (target, distance) = self.tree.nearest(moved.as_vec3());
        *seen = LastLookup {
            moved,
            distance: f64::from(distance),
        };
        let normal = target_from_source.rotation * self.source.normals[source].as_dvec3();
        let alike = normal.dot(self.target.normals[target].as_dvec3()) > SAME_NORMAL;
        (seen.distance < reach && alike).then_some(Partner {
            moved,
            source,
            target,
        })
    }

    /// Returns the distance of a partner in front of the target's surface.
    pub fn distance(&self, partner: &Partner) -> f64 {
        let normal = self.target.normals[partner.target].as_dvec3();
        normal.dot(partner.moved - self.target.positions[partner.target].as_dvec3())
    }
}

/// Number of points that a slope is fitted to.
const NEIGHBOURS: usize = 20;
/// With fewer points there is no slope.
const MIN_NEIGHBOURS: usize = 5;
/// Maximum distance of these points, in voxels.
const RADIUS: f32 = 2.5;

/// Fits how brightness changes along the surface at a point.
///
/// The result is a vector in the tangent plane whose product with a step is the change of
/// intensity, by least squares over the neighbours; zero if there are too few.
pub fn slope(cloud: &OrientedCloud, tree: &Neighbours, index: usize, voxel: f32) -> Vec3 {
    let (here, normal) = (cloud.positions[index], cloud.normals[index]);
    if normal == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let (along, across) = normal.any_orthonormal_pair();
    let (mut matrix, mut right, mut count) = (DMat2::ZERO, DVec2::ZERO, 0);
    for (other, distance) in tree.nearest_n(here, NEIGHBOURS) {
        if distance > 0.0 && distance < RADIUS * voxel {
            let step = cloud.positions[other] - here;
            let step = DVec2::new(f64::from(step.dot(along)), f64::from(step.dot(across)));
            matrix += DMat2::from_cols(step * step.x, step * step.y);
            right += step * f64::from(cloud.intensities[other] - cloud.intensities[index]);
            count += 1;
        }
    }
    let spread = matrix.x_axis.x + matrix.y_axis.y;
    // Neighbours in a line do not determine the slope across it.
    if count < MIN_NEIGHBOURS || matrix.determinant() < 1e-3 * spread * spread {
        return Vec3::ZERO;
    }
    let slope = (matrix.inverse() * right).as_vec2();
    slope.x * along + slope.y * across
}
