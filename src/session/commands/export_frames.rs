//! Export of undistorted images with their masks and cameras, and of depths.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;
use tiff::encoder::{TiffEncoder, colortype::Gray32Float};

use super::export_inputs::make_folder_of;
use super::masks::stems;
use ostra_core::disk::{self, AtomicFile};
use ostra_core::job::Progress;
use ostra_frames::cameras::{ModelEncoding, SparsePoints, with_text_names, write_colmap_model};
use ostra_frames::{
    DepthMap, Frame, FrameCamera, FrameError, FrameStore, Image, ImageSource, Orientation,
};
use ostra_masks::{RunMask, encode_palette_png};
use ostra_project::Project;
use ostra_reconstruct::sfm::{undistort_image, undistort_mask, undistorted_camera};

/// Writes every frame that has a camera as seen by a pinhole camera.
///
/// `images/` holds upright PNGs, `masks/` the masks resampled to the nearest pixel, and `sparse/`
/// the cameras and points as COLMAP text. Frames whose image cannot be read are skipped, and a
/// warning names the first of them.
pub(super) fn write_undistorted(
    folder: &Path,
    project: &Project,
    sparse: &SparsePoints,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<String>> {
    progress.stage("write undistorted images")?;
    let done = AtomicUsize::new(0);
    // The model names the images, so both use names that the text format can hold.
    let named = with_text_names(&project.frames);
    let project = &named.map_or_else(
        || project.clone(),
        |frames| Project {
            frames: Arc::new(frames),
            ..project.clone()
        },
    );
    let stems = stems(project)?;
    let mut frames: Vec<Frame> = project
        .global_frames()
        .iter()
        .zip(&stems)
        .map(|(frame, stem)| pinhole(frame, stem))
        .collect();
    let written = (0..frames.len()).into_par_iter().map(|number| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), frames.len())?;
        write_frame(folder, project, number, &frames[number], store)
    });
    let unreadable: Vec<Option<FrameError>> = written.collect::<Result<_>>()?;
    let mut sparse = sparse.clone();
    for (frame, error) in frames.iter_mut().zip(&unreadable) {
        if error.is_some() {
            frame.camera = None;
        }
    }
    sparse
        .keypoints
        .retain(|&number, _| unreadable[number].is_none());
    for (&number, keypoints) in &mut sparse.keypoints {
        let (Some(from), Some(to)) = (project.frames[number].camera, frames[number].camera) else {
            continue;
        };
        for keypoint in keypoints {
            let ray = from.intrinsics.unproject(keypoint.at_px).extend(1.0);
            keypoint.at_px = to.intrinsics.project(ray).unwrap_or(keypoint.at_px);
        }
    }
    let is_any = frames.iter().any(|frame| frame.posed_camera().is_some());
    let warning = left_out(folder, "image", unreadable, is_any)?;
    write_colmap_model(
        &folder.join("sparse"),
        &frames,
        &sparse,
        ModelEncoding::Text,
    )?;
    Ok(warning.into_iter().collect())
}

/// Returns the frame with an undistorted, upright image.
fn pinhole(frame: &Frame, stem: &str) -> Frame {
    let undistorted = |camera: FrameCamera| FrameCamera {
        intrinsics: undistorted_camera(&camera.intrinsics),
        ..camera
    };
    Frame {
        name: format!("{stem}.png"),
        image: ImageSource::File {
            path: PathBuf::new(),
            orientation: Orientation::default(),
        },
        camera: frame.camera.map(undistorted),
        depth: None,
        ..*frame
    }
}

/// Writes the image and mask of a frame, or returns why its image cannot be read.
fn write_frame(
    folder: &Path,
    project: &Project,
    number: usize,
    to: &Frame,
    store: &FrameStore,
) -> Result<Option<FrameError>> {
    let from = &project.frames[number];
    let (Some((camera, _)), Some((pinhole, _))) = (from.posed_camera(), to.posed_camera()) else {
        return Ok(None);
    };
    let image = match store.image(from) {
        Ok(image) => undistort_image(&image, camera, pinhole),
        Err(error) => return Ok(Some(error)),
    };
    save_image(&folder.join("images").join(&to.name), &image)?;
    let Some(mask) = project.mask_in_play(number) else {
        return Ok(None);
    };
    let mask = undistort_mask(&mask.decode(), camera, pinhole);
    let path = folder.join("masks").join(&to.name);
    make_folder_of(&path)?;
    disk::write(
        &path,
        &encode_palette_png(&RunMask::encode(&mask), &project.labels)?,
    )
    .with_context(|| cannot_write(&path))?;
    Ok(None)
}

/// Returns a warning about the frames of an export whose image or depth cannot be read.
///
/// # Errors
///
/// Returns an error if no other frame was exported. It is the error of the first frame.
fn left_out(
    folder: &Path,
    what: &str,
    unreadable: Vec<Option<FrameError>>,
    is_any_exported: bool,
) -> Result<Option<String>> {
    let mut errors = unreadable.into_iter().flatten();
    let Some(first) = errors.next() else {
        return Ok(None);
    };
    if !is_any_exported {
        return Err(first.into());
    }
    let (count, folder) = (1 + errors.count(), folder.display());
    Ok(Some(format!(
        "{folder}: {count} frames whose {what} cannot be read are left out (first: {first})"
    )))
}

fn save_image(path: &Path, image: &Image) -> Result<()> {
    make_folder_of(path)?;
    let bytes = bytemuck::cast_slice(&image.pixels);
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    encoder
        .write_image(bytes, image.width, image.height, ExtendedColorType::Rgb8)
        .with_context(|| cannot_write(path))?;
    disk::write(path, &png).with_context(|| cannot_write(path))
}

fn cannot_write(path: &Path) -> String {
    format!(
        "{}: cannot be written; check permissions and free space",
        path.display()
    )
}

/// Writes the depth of every frame that has one as a 32-bit float TIFF.
///
/// Depths are in world units, and 0 means unknown. Depths that cannot be read are skipped, and a
/// warning names the first of them.
pub(super) fn write_depths(
    folder: &Path,
    project: &Project,
    store: &FrameStore,
    progress: &Progress,
) -> Result<Vec<String>> {
    progress.stage("write depths")?;
    let done = AtomicUsize::new(0);
    let stems = stems(project)?;
    let written = project.frames.par_iter().zip(&stems).map(|(frame, stem)| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), project.frames.len())?;
        match store.depth(frame) {
            Ok(Some(depth)) => {
                write_tiff(&folder.join(format!("{stem}.tiff")), &depth).map(|()| (true, None))
            }
            Ok(None) => Ok((false, None)),
            Err(error) => Ok((false, Some(error))),
        }
    });
    let (written, unreadable): (Vec<bool>, Vec<Option<FrameError>>) =
        written.collect::<Result<Vec<_>>>()?.into_iter().unzip();
    Ok(
        left_out(folder, "depth", unreadable, written.contains(&true))?
            .into_iter()
            .collect(),
    )
}

fn write_tiff(path: &Path, depth: &DepthMap) -> Result<()> {
    make_folder_of(path)?;
    let failed = || cannot_write(path);
    let mut file = AtomicFile::create(path).with_context(failed)?;
    let mut out = BufWriter::new(file.as_file());
    let mut encoder = TiffEncoder::new(&mut out).with_context(failed)?;
    encoder
        .write_image::<Gray32Float>(depth.width, depth.height, &depth.depths)
        .with_context(failed)?;
    out.flush().with_context(failed)?;
    drop(out);
    file.commit().with_context(failed)
}
