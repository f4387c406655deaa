//! Fast Point Feature Histograms of oriented clouds.

use glam::Vec3;
use rayon::prelude::*;

use super::oriented::{OrientedCloud, check_voxel};
use ostra_cloud::SceneError;
use ostra_cloud::points::Neighbours;
use ostra_core::job::{Progress, Stopped};

/// Bins of each of the three angles.
const BINS: usize = 11;
/// Length of a descriptor.
pub const SIZE: usize = 3 * BINS;
/// Sum of the bins of each angle in the histogram of one point.
const SUM: f32 = 100.0;
/// Radius that a descriptor covers, in voxels.
const RADIUS: f32 = 5.0;
/// Maximum number of neighbours, the nearest.
const NEIGHBOURS: usize = 100;
/// With fewer neighbours there is no descriptor.
const MIN_NEIGHBOURS: usize = 5;

/// Three histograms of the angles between normals around a point.
pub type Descriptor = [f32; SIZE];

type Around = Vec<(u32, f32)>;

/// Computes Fast Point Feature Histograms of a cloud thinned to `voxel`.
///
/// R. B. Rusu, N. Blodow, M. Beetz, *Fast Point Feature Histograms (FPFH) for 3D Registration*,
/// ICRA 2009. A descriptor is a point's own histogram of the angles to its neighbours' normals,
/// plus the mean of its neighbours' histograms, weighted by nearness. It is invariant to rigid
/// motions. `None` for points without normal, or with fewer than 5 neighbours that have one within
/// 5 voxels.
///
/// # Errors
/// [`Stopped`].
pub fn describe(
    cloud: &OrientedCloud,
    voxel: f32,
    progress: &Progress,
) -> Result<Vec<Option<Descriptor>>, Stopped> {
    let Some(tree) = Neighbours::new(&cloud.positions) else {
        return Ok(Vec::new());
    };
    let around: Vec<Around> = in_chunks(cloud.len(), progress, |index| {
        around(cloud, &tree, index, RADIUS * voxel)
    })?;
    let own: Vec<Option<Descriptor>> = in_chunks(cloud.len(), progress, |index| {
        own_histogram(cloud, index, &around[index])
    })?;
    in_chunks(cloud.len(), progress, |index| {
        own[index].map(|mine| mixed(mine, &around[index], &own))
    })
}

fn in_chunks<T: Send>(
    count: usize,
    progress: &Progress,
    of: impl Fn(usize) -> T + Sync + Send,
) -> Result<Vec<T>, Stopped> {
    (0..count)
        .into_par_iter()
        .map(|index| progress.check().map(|()| of(index)))
        .collect()
}

/// Returns the neighbours that have a normal.
fn around(cloud: &OrientedCloud, tree: &Neighbours, index: usize, radius: f32) -> Around {
    if cloud.normals[index] == Vec3::ZERO {
        return Vec::new();
    }
    let found = tree
        .nearest_n(cloud.positions[index], NEIGHBOURS + 1)
        .into_iter();
    let fits = |&(other, distance): &(usize, f32)| {
        distance > 0.0 && distance < radius && cloud.normals[other] != Vec3::ZERO && other != index
    };
    found
        .filter(fits)
        .map(|(other, distance)| (other as u32, distance))
        .collect()
}

fn own_histogram(cloud: &OrientedCloud, index: usize, around: &Around) -> Option<Descriptor> {
    if around.len() < MIN_NEIGHBOURS {
        return None;
    }
    let mut histogram = [0.0; SIZE];
    let mut counted = 0.0;
    for &(other, distance) in around {
        let line = (cloud.positions[other as usize] - cloud.positions[index]) / distance;
        if let Some(shares) = angles(line, cloud.normals[index], cloud.normals[other as usize]) {
            for (group, share) in shares.into_iter().enumerate() {
                histogram[group * BINS + ((share * BINS as f32) as usize).min(BINS - 1)] += 1.0;
            }
            counted += 1.0;
        }
    }
    (counted > 0.0).then(|| histogram.map(|bin| bin * SUM / counted))
}

/// Returns the three angles between two normals and the line between their points, each scaled to 0–1.
///
/// `None` if the line is parallel to a normal.
fn angles(line: Vec3, here: Vec3, there: Vec3) -> Option<[f32; 3]> {
    // The frame is attached to the point whose normal is nearer to the line, so that both points
    // get the same.
    let (along_here, along_there) = (here.dot(line), there.dot(line));
    let (from, to, line, phi) = if along_here.abs() < along_there.abs() {
        (there, here, -line, -along_there)
    } else {
        (here, there, line, along_here)
    };
    let v = line.cross(from).try_normalize()?;
    let w = from.cross(v);
    let theta = w.dot(to).atan2(from.dot(to));
    Some([
        theta / std::f32::consts::TAU + 0.5,
        v.dot(to) * 0.5 + 0.5,
        phi * 0.5 + 0.5,
    ])
}

fn mixed(own: Descriptor, around: &Around, all: &[Option<Descriptor>]) -> Descriptor {
    let mut mixed = [0.0; SIZE];
    let mut total = 0.0;
    for &(other, distance) in around {
        if let Some(theirs) = &all[other as usize] {
            let weight = 1.0 / distance;
            total += weight;
            for (sum, bin) in mixed.iter_mut().zip(theirs) {
                *sum += weight * bin;
            }
        }
    }
    for (sum, bin) in mixed.iter_mut().zip(own) {
        *sum = bin + if total > 0.0 { *sum / total } else { 0.0 };
    }
    mixed
}

/// A thinned cloud and descriptors of its points; computed once for a cloud that is registered with many.
#[derive(Debug, Clone, PartialEq)]
pub struct DescribedCloud {
    pub(super) cloud: OrientedCloud,
    pub(super) voxel: f32,
    /// One for each of `places`.
    pub(super) descriptors: Vec<Descriptor>,
    /// Indices of the points that have a descriptor.
    pub(super) places: Vec<u32>,
}

impl DescribedCloud {
    /// Thins the cloud to `voxel` (world units, above 0) and describes its points.
    ///
    /// 5 voxels around a point should contain more than one surface, and what the two clouds share
    /// should be some 20 voxels long: 0.05 m for rooms.
    ///
    /// # Errors
    /// [`SceneError::Request`] for lists of unequal length or an edge that is not above 0;
    /// [`SceneError::Stopped`].
    pub fn new(cloud: &OrientedCloud, voxel: f32, progress: &Progress) -> Result<Self, SceneError> {
        cloud.check()?;
        check_voxel(voxel)?;
        let cloud = cloud.thinned(voxel);
        let all = describe(&cloud, voxel, progress)?;
        let (places, descriptors) = all
            .into_iter()
            .enumerate()
            .filter_map(|(index, found)| Some((index as u32, found?)))
            .unzip();
        Ok(Self {
            cloud,
            voxel,
            descriptors,
            places,
        })
    }
}
