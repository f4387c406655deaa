use glam::DVec3;

use super::blocks::Volume;
use super::measured::{Measured, Pixel};
use super::options::VolumeOptions;
use crate::fuse::{Views, readable};
use crate::{LabelledCloud, LabelledMesh, SceneError};
use ostra_core::job::Progress;
use ostra_masks::LabelId;

/// A surface, and what it took.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// The triangles; vertices have normals and colours and no labels yet.
    pub mesh: LabelledMesh,
    /// Frames that were added.
    pub frames: usize,
    /// Memory of the volume, bytes.
    pub bytes: usize,
}

/// Makes the surface that all frames with depth and camera see. Frames without, and those that cannot be
/// read, are left out in silence: fusion names them.
///
/// The same frames give the same bytes, whatever the number of threads.
///
/// # Errors
/// [`SceneError::Request`] for options out of range or a depth of another size than its frame; [`SceneError::TooLarge`]; what
/// reading a frame says; [`SceneError::Stopped`].
pub fn reconstruct_surface(
    views: &dyn Views,
    options: &VolumeOptions,
    progress: &Progress,
) -> Result<Surface, SceneError> {
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
    Ok(Surface {
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

fn nearest_corner(views: &dyn Views, usable: &[usize]) -> DVec3 {
    let centres = usable
        .iter()
        .filter_map(|&index| Some(views.frames()[index].posed_camera()?.1.centre()));
    centres.reduce(DVec3::min).unwrap_or_default()
}

/// A frame as the volume takes it; `pixels` lends the memory of an earlier one.
fn load(
    views: &dyn Views,
    index: usize,
    options: &VolumeOptions,
    pixels: Vec<Pixel>,
) -> Result<Option<Measured>, SceneError> {
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
            "frame '{}': picture, depth and camera differ in size; give all in the picture's size",
            frame.name
        )));
    }
    let mask = views.mask(index).filter(|_| options.only_labelled);
    let wanted = |pixel: usize| match &mask {
        Some(mask) => mask.ids.get(pixel).is_some_and(|&id| id != LabelId::NONE),
        None => !options.only_labelled,
    };
    Ok(Some(Measured::new(
        (camera, pose),
        &depth,
        &image,
        options.edge_tolerance,
        wanted,
        pixels,
    )))
}
