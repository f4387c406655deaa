//! Images drawn on the CPU, and PNG output.

use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use glam::Vec3;
use image::ImageEncoder;
use image::codecs::png::PngEncoder;
use rayon::prelude::*;

use super::{Axes, Bounds, Orbit};
use ostra_cloud::LabelledCloud;
use ostra_core::disk::AtomicFile;
use ostra_frames::{Frame, Image};

/// An image with coverage.
#[derive(Debug, Clone, PartialEq)]
pub struct Shot {
    /// Colours.
    pub image: Image,
    /// Coverage per pixel, 0–255; 0 is background only.
    pub opacity: Vec<u8>,
}

impl Shot {
    /// Creates a shot from pixels; those with opacity above 0 are fully covered.
    pub(super) fn of_pixels(
        width: u32,
        height: u32,
        pixels: impl IndexedParallelIterator<Item = [u8; 4]>,
    ) -> Self {
        let (colors, opacity) = pixels
            .map(|[r, g, b, a]| ([r, g, b], if a > 0 { 255 } else { 0 }))
            .unzip();
        Self {
            image: Image {
                width,
                height,
                pixels: colors,
            },
            opacity,
        }
    }

    /// Returns a shot of half the size by averaging 2 × 2 pixels.
    ///
    /// With `without_background`, only covered pixels count.
    pub(super) fn halved(&self, without_background: bool) -> Self {
        let (width, height) = (self.image.width / 2, self.image.height / 2);
        let mean = |at: usize| {
            let (x, y) = (at % width as usize * 2, at / width as usize * 2);
            let four = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
                .map(|(x, y)| y * self.image.width as usize + x);
            let covered = four
                .iter()
                .map(|&at| u32::from(self.opacity[at]))
                .sum::<u32>()
                / 255;
            let part = without_background && covered > 0;
            let counted = || four.iter().filter(|&&at| !part || self.opacity[at] > 0);
            let sum = |channel: usize| {
                counted()
                    .map(|&at| u32::from(self.image.pixels[at][channel]))
                    .sum::<u32>()
            };
            let count = if part { covered } else { 4 };
            (
                [0, 1, 2].map(|channel| (sum(channel) / count) as u8),
                (covered * 255 / 4) as u8,
            )
        };
        let (pixels, opacity) = (0..width as usize * height as usize)
            .into_par_iter()
            .map(mean)
            .unzip();
        Self {
            image: Image {
                width,
                height,
                pixels,
            },
            opacity,
        }
    }
}

/// Returns a view of the labelled points, or of all points if none has a label.
///
/// It looks along the mean direction of the cameras and uses their up direction. Without cameras it
/// looks along (0.25, 0.15, 1) with y down. `aspect` is width / height. Returns `None` without
/// points.
#[must_use]
pub fn default_view(cloud: &LabelledCloud, frames: &[Frame], aspect: f32) -> Option<Orbit> {
    let labelled = || {
        cloud
            .positions
            .iter()
            .zip(&cloud.labels)
            .filter(|(_, label)| label.0 != 0)
            .map(|(x, _)| *x)
    };
    let bounds = Bounds::of(labelled()).or_else(|| Bounds::of(cloud.positions.iter().copied()))?;
    let poses = frames.iter().filter_map(|frame| frame.posed_camera());
    let mean = poses
        .map(|(_, pose)| pose.rotation.as_quat().conjugate() * Vec3::Z)
        .sum::<Vec3>();
    let direction = mean.try_normalize().unwrap_or(Vec3::new(0.25, 0.15, 1.0));
    let mut orbit = Orbit::framing(&bounds, direction, Axes::of_cameras(frames).up);
    orbit.distance /= aspect.clamp(0.2, 1.0);
    Some(orbit)
}

/// Writes an image as PNG; the file is complete or not written at all.
///
/// With `transparent`, uncovered pixels are transparent.
///
/// # Errors
/// Returns [`ViewError::Write`] if the folder is missing or cannot be written.
pub fn write_png(path: &Path, shot: &Shot, transparent: bool) -> Result<(), ViewError> {
    let fail = |what: String| ViewError::Write {
        path: path.to_owned(),
        what,
    };
    let Image {
        width,
        height,
        pixels,
    } = &shot.image;
    let with_opacity: Vec<[u8; 4]>;
    let (bytes, kind): (&[u8], _) = if transparent {
        with_opacity = pixels
            .iter()
            .zip(&shot.opacity)
            .map(|(&[r, g, b], &a)| [r, g, b, a])
            .collect();
        (bytemuck::cast_slice(&with_opacity), image::ColorType::Rgba8)
    } else {
        (bytemuck::cast_slice(pixels), image::ColorType::Rgb8)
    };
    let mut file = AtomicFile::create(path).map_err(|error| fail(error.to_string()))?;
    let mut out = BufWriter::new(file.as_file());
    let encoded = PngEncoder::new(&mut out).write_image(bytes, *width, *height, kind.into());
    encoded.map_err(|error| fail(error.to_string()))?;
    out.flush().map_err(|error| fail(error.to_string()))?;
    drop(out);
    file.commit().map_err(|error| fail(error.to_string()))
}

/// Errors of drawing; each message says what the user can do.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The image cannot be written.
    #[error("{}: the image cannot be written ({what}); check the folder and its permissions", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The message of the encoder or the system.
        what: String,
    },
    /// There is nothing to draw.
    #[error("the cloud has no points to draw; run 'fuse' first or lower --min-confidence")]
    Empty,
}
