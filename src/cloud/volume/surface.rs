//! Reconstruction of a mesh from frames: integration, extraction and component filtering.

use super::extract::Raw;
use super::frame_measurements::{DepthFrame, FrameMeasurements, SurfacePixel};
use super::sparse_volume::{Volume, VolumeOptions};
use crate::fuse::{Views, nearest_corner, readable};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_core::statistics::upper_median;
use ostra_core::union_find::DisjointSets;
use ostra_masks::LabelId;

/// A reconstructed surface, with the number of frames and the memory it took.
#[derive(Debug, Clone, PartialEq)]
pub struct ReconstructedSurface {
    /// The mesh; its vertices have normals and colours but no labels yet.
    pub mesh: LabelledMesh,
    /// Number of frames that were added.
    pub frames: usize,
    /// Memory of the volume in bytes.
    pub bytes: usize,
}

/// Reconstructs the surface seen by all frames with depth and camera.
///
/// Frames without them, and unreadable ones, are left out silently, because fusion names them. The
/// same frames give the same bytes, whatever the number of threads.
///
/// # Errors
///
/// Returns [`SceneError::Request`] if options are out of range or the size of a depth map differs
/// from that of its frame. Returns [`SceneError::TooLarge`] if the volume exceeds its memory limit.
/// Returns the error of a frame that cannot be read. Returns [`SceneError::Stopped`] if the job is
/// stopped.
pub fn reconstruct_surface(
    views: &dyn Views,
    options: &VolumeOptions,
    progress: &Progress,
) -> Result<ReconstructedSurface, SceneError> {
    check(options)?;
    progress.stage("surface")?;
    let usable: Vec<usize> = (0..views.frames().len())
        .filter(|&index| views.frames()[index].posed_camera().is_some() && views.has_depth(index))
        .collect();
    let mut volume = Volume::new(nearest_corner(views, &usable), *options);
    let mut next = usable
        .first()
        .map(|&index| load(views, index, options, Vec::new()))
        .transpose()?
        .flatten();
    let mut spare = Vec::new();
    for done in 0..usable.len() {
        progress.step(done, usable.len())?;
        let (current, lent) = (next.take(), std::mem::take(&mut spare));
        let (added, loaded) = rayon::join(
            || {
                current.map_or(Ok(Vec::new()), |frame| {
                    volume.add(&frame, progress).map(|()| frame.pixels)
                })
            },
            || {
                usable
                    .get(done + 1)
                    .map_or(Ok(None), |&index| load(views, index, options, lent))
            },
        );
        spare = added?;
        next = loaded?;
        if volume.bytes() > options.max_bytes {
            return Err(SceneError::TooLarge {
                voxel: options.voxel,
                mebibytes: options.max_bytes >> 20,
            });
        }
    }
    let (frames, bytes) = (volume.frames as usize, volume.bytes());
    let raw = volume.extract(progress)?;
    let keep = raw.in_true_pieces(options.min_triangles, options.keep_well_seen);
    let mut vertices = LabelledCloud::from_positions(raw.positions);
    vertices.colors = raw.colors;
    let mut mesh = LabelledMesh {
        vertices,
        triangles: raw.triangles,
    }
    .filter(|at| keep[at])
    .0;
    mesh.compute_normals();
    Ok(ReconstructedSurface {
        mesh,
        frames,
        bytes,
    })
}

fn check(options: &VolumeOptions) -> Result<(), SceneError> {
    let VolumeOptions {
        voxel,
        truncation,
        edge_tolerance,
        min_weight,
        ..
    } = *options;
    if !(voxel.is_finite() && voxel > 0.0) {
        return Err(SceneError::Request(format!(
            "a voxel size of {voxel} is not possible; give a length above 0"
        )));
    }
    if !((2.0..=16.0).contains(&truncation)
        && (0.0..=1.0).contains(&edge_tolerance)
        && min_weight >= 0.0)
    {
        return Err(SceneError::Request(
            "the surface needs a truncation of 2 to 16 voxels, an edge tolerance from 0 to 1 and no negative weight"
                .into(),
        ));
    }
    Ok(())
}

/// Loads a frame for the volume; `pixels` reuses the memory of an earlier one.
fn load(
    views: &dyn Views,
    index: usize,
    options: &VolumeOptions,
    pixels: Vec<SurfacePixel>,
) -> Result<Option<FrameMeasurements>, SceneError> {
    let frame = &views.frames()[index];
    let (image, depth) = rayon::join(|| views.image(index), || views.depth(index));
    let (Some(depth), Some((camera, pose))) = (depth?, frame.posed_camera()) else {
        return Ok(None);
    };
    let Some(image) = readable(image)? else {
        return Ok(None);
    };
    let sizes = [
        (image.width, image.height),
        (depth.width, depth.height),
        (camera.width, camera.height),
    ];
    if sizes
        .iter()
        .any(|size| *size != (frame.width, frame.height))
    {
        return Err(SceneError::Request(format!(
            "frame '{}': image, depth and camera differ in size; give all in the image's size",
            frame.name
        )));
    }
    let mask = views.mask(index).filter(|_| options.only_labelled);
    let wanted = |pixel: usize| match &mask {
        Some(mask) => mask.ids.get(pixel).is_some_and(|&id| id != LabelId::NONE),
        None => !options.only_labelled,
    };
    let frame = DepthFrame {
        camera,
        pose,
        depth: &depth,
        image: &image,
    };
    Ok(Some(FrameMeasurements::new(
        &frame,
        options.edge_tolerance,
        wanted,
        pixels,
    )))
}

/// Visibility of its best-seen vertex from which a small component is kept.
///
/// It equals one frame that looks straight at the surface.
const WELL_SEEN: f32 = 1.0;
/// The same limit as a share of the median visibility of the larger components.
///
/// With many frames, noise is seen often, too.
const AS_WELL: f32 = 0.5;

impl Raw {
    /// Returns for each triangle whether its connected component is kept.
    ///
    /// A component is kept if it has at least `least` triangles or, with `keep_well_seen`, if it
    /// was seen well.
    fn in_true_pieces(&self, least: usize, keep_well_seen: bool) -> Vec<bool> {
        let mut sets = DisjointSets::new(self.positions.len());
        for &[a, b, c] in &self.triangles {
            sets.unite(a, b);
            sets.unite(b, c);
        }
        let roots: Vec<usize> = sets
            .into_roots()
            .into_iter()
            .map(|root| root as usize)
            .collect();
        let (mut sizes, mut best) = (vec![0usize; roots.len()], vec![0f32; roots.len()]);
        self.triangles
            .iter()
            .for_each(|triangle| sizes[roots[triangle[0] as usize]] += 1);
        roots
            .iter()
            .zip(&self.weights)
            .for_each(|(&root, &weight)| best[root] = best[root].max(weight));
        let of_large = roots
            .iter()
            .zip(&self.weights)
            .filter(|&(&root, _)| sizes[root] >= least);
        let mut weights: Vec<f32> = of_large.map(|(_, &weight)| weight).collect();
        let enough = WELL_SEEN.max(AS_WELL * upper_median(&mut weights).unwrap_or(0.0));
        let is_true = |triangle: &[u32; 3]| {
            let root = roots[triangle[0] as usize];
            sizes[root] >= least || keep_well_seen && best[root] >= enough
        };
        self.triangles.iter().map(is_true).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns strips with the given numbers of triangles, each seen with one weight.
    fn strips(strips: &[(u32, f32)]) -> Raw {
        let mut raw = Raw::default();
        for &(triangles, weight) in strips {
            let first = raw.weights.len() as u32;
            raw.triangles
                .extend((first..first + triangles).map(|at| [at, at + 1, at + 2]));
            raw.weights.extend((0..triangles + 2).map(|_| weight));
        }
        raw.positions = vec![glam::Vec3::ZERO; raw.weights.len()];
        raw
    }

    fn kept(raw: &Raw) -> Vec<bool> {
        let all = raw.in_true_pieces(10, true);
        let firsts = (0..all.len())
            .filter(|&at| at == 0 || raw.triangles[at][0] != raw.triangles[at - 1][0] + 1);
        firsts.map(|at| all[at]).collect()
    }

    #[test]
    fn small_component_is_kept_if_seen_well() {
        let raw = strips(&[(12, 0.3), (9, 0.9), (9, 1.1), (10, 0.3)]);
        assert_eq!(kept(&raw), [true, false, true, true]);
        assert_eq!(
            raw.in_true_pieces(10, false)
                .iter()
                .filter(|&&kept| kept)
                .count(),
            22,
            "by size alone"
        );
    }

    #[test]
    fn noise_seen_by_many_frames_is_removed() {
        assert_eq!(
            kept(&strips(&[(40, 20.0), (9, 9.0), (9, 11.0)])),
            [true, false, true]
        );
        assert!(Raw::default().in_true_pieces(10, true).is_empty());
    }
}
