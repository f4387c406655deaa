use crate::sfm::{undistort_image, undistorted_camera};
use ostra_frames::{Frame, FrameError, FrameStore, Image};
use ostra_geometry::Camera;

use super::patchmatch::Tones;

/// Returns the camera of the raster on which depth is estimated.
///
/// It has no distortion and a longer side of at most `max_side` pixels; it is never enlarged.
#[must_use]
pub fn raster_camera(camera: &Camera, max_side: u32) -> Camera {
    let plain = undistorted_camera(camera);
    let longest = plain.width.max(plain.height).max(1);
    let scale = f64::from(max_side.clamp(1, longest)) / f64::from(longest);
    let side = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    let (width, height) = (side(plain.width), side(plain.height));
    let ratio = glam::DVec2::new(
        f64::from(width) / f64::from(plain.width.max(1)),
        f64::from(height) / f64::from(plain.height.max(1)),
    );
    Camera {
        width,
        height,
        focal_px: plain.focal_px * ratio,
        principal_px: plain.principal_px * ratio,
        ..plain
    }
}

/// Returns the frame's image without distortion on the raster of [`raster_camera`].
///
/// Each pixel is the mean of the area that it covers.
///
/// # Errors
/// [`FrameError`] if the image cannot be read.
pub fn raster_image(
    frame: &Frame,
    camera: &Camera,
    store: &FrameStore,
    max_side: u32,
) -> Result<Image, FrameError> {
    let image = store.image(frame)?;
    let to = raster_camera(camera, max_side);
    let plain = undistorted_camera(camera);
    if plain == *camera {
        return Ok(area_mean(&image, to.width, to.height));
    }
    Ok(area_mean(
        &undistort_image(&image, camera, &plain),
        to.width,
        to.height,
    ))
}

/// Computes luma and chroma as in ITU-R BT.601.
#[must_use]
pub fn tones(image: &Image) -> Tones {
    let (mut luma, mut chroma) = (
        Vec::with_capacity(image.pixels.len()),
        Vec::with_capacity(image.pixels.len()),
    );
    for [r, g, b] in image.pixels.iter().map(|pixel| pixel.map(f32::from)) {
        luma.push(0.299 * r + 0.587 * g + 0.114 * b);
        chroma.push(
            [
                -0.1687 * r - 0.3313 * g + 0.5 * b,
                0.5 * r - 0.4187 * g - 0.0813 * b,
            ]
            .map(|part| part.min(127.0)),
        );
    }
    Tones {
        width: image.width as usize,
        height: image.height as usize,
        luma,
        chroma,
    }
}

/// Shrinks an image: each pixel is the mean over its area, with partial pixels weighted by their share.
fn area_mean(image: &Image, width: u32, height: u32) -> Image {
    if (width, height) == (image.width, image.height) {
        return image.clone();
    }
    let columns = spans(image.width, width);
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for rows in spans(image.height, height) {
        let mut across = vec![[0.0f32; 3]; image.width as usize];
        for &(row, share) in &rows {
            let line = &image.pixels[row * image.width as usize..][..image.width as usize];
            across
                .iter_mut()
                .zip(line)
                .for_each(|(sum, pixel)| add(sum, pixel.map(f32::from), share));
        }
        for column in &columns {
            let mut sum = [0.0f32; 3];
            column
                .iter()
                .for_each(|&(x, share)| add(&mut sum, across[x], share));
            pixels.push(sum.map(|value| (value + 0.5) as u8));
        }
    }
    Image {
        width,
        height,
        pixels,
    }
}

fn add(sum: &mut [f32; 3], value: [f32; 3], share: f32) {
    sum.iter_mut()
        .zip(value)
        .for_each(|(sum, value)| *sum += share * value);
}

/// Returns for each pixel of a shorter side the pixels of the longer one that it covers, with shares that sum to 1.
fn spans(from: u32, to: u32) -> Vec<Vec<(usize, f32)>> {
    let ratio = f64::from(from) / f64::from(to);
    let span = |at: u32| {
        let (start, end) = (f64::from(at) * ratio, f64::from(at + 1) * ratio);
        let inside = start.floor() as u32..(end.ceil() as u32).min(from);
        let share = |x: u32| (end.min(f64::from(x + 1)) - start.max(f64::from(x))) / ratio;
        inside
            .map(|x| (x as usize, share(x) as f32))
            .filter(|&(_, share)| share > 1e-6)
            .collect()
    };
    (0..to).map(span).collect()
}
