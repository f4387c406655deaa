use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::brightness::slope;
use super::oriented::OrientedCloud;
use super::pairs::SAME_NORMAL;
use ostra_cloud::points::Neighbours;
use ostra_core::job::{Progress, Stopped};
use ostra_geometry::Pose;

/// How far partners may be apart, in voxels.
const REACH: f64 = 1.4;
/// Points that are looked at between two looks at the stop.
const CHUNK: usize = 1024;

/// Two clouds thinned alike, ready to be laid onto each other.
pub struct Level {
    pub source: OrientedCloud,
    pub target: OrientedCloud,
    /// How the target's brightness changes along its surface; empty where brightness is not looked at.
    pub slopes: Vec<Vec3>,
    /// Edge of the voxels, world units.
    pub voxel: f64,
    tree: Neighbours,
}

/// A source point and the target point nearest to it.
#[derive(Debug, Clone, Copy)]
pub struct Partner {
    /// Source point, brought into the target's space.
    pub moved: DVec3,
    pub source: usize,
    pub target: usize,
}

/// Where a source point was when its distance to the target was last looked up; before that, anywhere.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen {
    moved: DVec3,
    distance: f64,
}

impl Level {
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

    /// Source points that have a target point near and with a normal within 45° of theirs. Points that were seen so far
    /// from the target that they cannot have come near since are not looked up again.
    pub fn partners(
        &self,
        target_from_source: &Pose,
        seen: &mut Vec<Seen>,
        progress: &Progress,
    ) -> Result<Vec<Partner>, Stopped> {
        seen.resize(self.source.len(), Seen::default());
        let of_chunk = |(chunk, seen): (usize, &mut [Seen])| {
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
        seen: &mut Seen,
    ) -> Option<Partner> {
        let reach = REACH * self.voxel;
        let moved = target_from_source.transform(self.source.positions[source].as_dvec3());
        if seen.distance - seen.moved.distance(moved) > 1.01 * reach {
            return None;
        }
        let (target, distance) = self.tree.nearest(moved.as_vec3());
        *seen = Seen {
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

    /// How far a partner is in front of the target's surface.
    pub fn distance(&self, partner: &Partner) -> f64 {
        let normal = self.target.normals[partner.target].as_dvec3();
        normal.dot(partner.moved - self.target.positions[partner.target].as_dvec3())
    }
}
