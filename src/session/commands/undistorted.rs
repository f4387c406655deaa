use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context, Result};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

use crate::engine::disk;
use crate::engine::job::Progress;
use crate::frames::cameras::{ModelEncoding, SparsePoints, with_text_names, write_colmap_model};
use crate::frames::{Frame, FrameCamera, FrameStore, Image, Orientation, PictureSource};
use crate::masks::{RunMask, encode_palette_png};
use crate::scene::sfm::{undistort_image, undistort_mask, undistorted_camera};
use crate::session::Project;

/// Writes every frame that has a camera as a pinhole camera sees it: `images/` upright as PNG, `masks/` by nearest id,
/// `sparse/` the cameras and points (COLMAP text).
pub fn write(
    folder: &Path,
    project: &Project,
    sparse: &SparsePoints,
    store: &FrameStore,
    progress: &Progress,
) -> Result<()> {
    progress.stage("write undistorted pictures")?;
    let done = AtomicUsize::new(0);
    // The model names the images, so both get names that the model's text can hold.
    let named = with_text_names(&project.frames);
    let project =
        &named.map_or_else(|| project.clone(), |frames| Project { frames: Arc::new(frames), ..project.clone() });
    let stems = super::masks::stems(project)?;
    let frames: Vec<Frame> =
        project.global_frames().iter().zip(&stems).map(|(frame, stem)| pinhole(frame, stem)).collect();
    (0..frames.len()).into_par_iter().try_for_each(|number| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), frames.len())?;
        write_frame(folder, project, number, &frames[number], store)
    })?;
    let mut sparse = sparse.clone();
    for (&number, keypoints) in &mut sparse.keypoints {
        let (Some(from), Some(to)) = (project.frames[number].camera, frames[number].camera) else { continue };
        for keypoint in keypoints {
            let ray = from.intrinsics.unproject(keypoint.at_px).extend(1.0);
            keypoint.at_px = to.intrinsics.project(ray).unwrap_or(keypoint.at_px);
        }
    }
    Ok(write_colmap_model(&folder.join("sparse"), &frames, &sparse, ModelEncoding::Text)?)
}

/// The frame with an undistorted, upright picture.
fn pinhole(frame: &Frame, stem: &str) -> Frame {
    let undistorted =
        |camera: FrameCamera| FrameCamera { intrinsics: undistorted_camera(&camera.intrinsics), ..camera };
    Frame {
        name: format!("{stem}.png"),
        picture: PictureSource::File { path: PathBuf::new(), orientation: Orientation::default() },
        camera: frame.camera.map(undistorted),
        depth: None,
        ..*frame
    }
}

fn write_frame(folder: &Path, project: &Project, number: usize, to: &Frame, store: &FrameStore) -> Result<()> {
    let from = &project.frames[number];
    let (Some((camera, _)), Some((pinhole, _))) = (from.posed_camera(), to.posed_camera()) else { return Ok(()) };
    let image = undistort_image(&*store.image(from)?, camera, pinhole);
    save_image(&folder.join("images").join(&to.name), &image)?;
    let Some(mask) = project.mask_in_play(number) else { return Ok(()) };
    let mask = undistort_mask(&mask.decode(), camera, pinhole);
    let path = folder.join("masks").join(&to.name);
    super::make_folder_of(&path)?;
    disk::write(&path, &encode_palette_png(&RunMask::encode(&mask), &project.labels)?)
        .with_context(|| cannot_write(&path))
}

fn save_image(path: &Path, image: &Image) -> Result<()> {
    super::make_folder_of(path)?;
    let bytes = bytemuck::cast_slice(&image.pixels);
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    encoder
        .write_image(bytes, image.width, image.height, ExtendedColorType::Rgb8)
        .with_context(|| cannot_write(path))?;
    disk::write(path, &png).with_context(|| cannot_write(path))
}

fn cannot_write(path: &Path) -> String {
    format!("{}: cannot be written; check permissions and free space", path.display())
}
