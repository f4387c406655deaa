//! One frame of a sequence: the sources of its image and depth, its orientation and its camera.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::DepthCamera;
use ostra_geometry::{Camera, Pose};

/// EXIF orientation of a stored image, 1 to 8. Applying it rotates the image upright.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Orientation(pub u8);

impl Default for Orientation {
    fn default() -> Self {
        Self(1)
    }
}

/// Source of a frame's image. Sources are referenced, never copied or changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImageSource {
    /// An image file.
    File {
        /// Absolute path.
        path: PathBuf,
        /// Rotation to apply when shown.
        #[serde(default)]
        orientation: Orientation,
    },
    /// One image of a video, decoded on demand.
    #[serde(rename = "film")] // the name in project files of format 1
    Video {
        /// Absolute path of the video.
        path: PathBuf,
        /// Index of the image in the video, counted from 0.
        index: u64,
        /// Time in seconds from the start.
        time_s: f64,
    },
}

impl ImageSource {
    /// Returns the path of the image file or the video.
    #[must_use]
    #[inline]
    pub fn path(&self) -> &Path {
        match self {
            Self::File { path, .. } | Self::Video { path, .. } => path,
        }
    }

    /// Returns the path and the index in the video (0 for an image file).
    ///
    /// Together they identify the image.
    pub(super) fn identity(&self) -> (PathBuf, u64) {
        match self {
            Self::File { path, .. } => (path.clone(), 0),
            Self::Video { path, index, .. } => (path.clone(), *index),
        }
    }

    pub(super) fn path_mut(&mut self) -> &mut PathBuf {
        match self {
            Self::File { path, .. } | Self::Video { path, .. } => path,
        }
    }
}

/// Source of a frame's depth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum DepthSource {
    /// Depth of a sensor: a grey image of 16 bits or of floats.
    ///
    /// It corresponds pixel for pixel to the stored colour image unless it has its own camera.
    Sensor {
        /// Absolute path.
        path: PathBuf,
        /// World units (metres) per unit of the stored value.
        ///
        /// Values of 0, negative values, the largest integer, NaN and infinities are unknown.
        unit: f64,
        /// Rotation to apply, the same as for the colour image.
        #[serde(default)]
        orientation: Orientation,
        /// Camera that measured the depth, if it differs from the image's.
        ///
        /// The depth is then transferred to the image's camera.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        camera: Option<Box<DepthCamera>>,
    },
    /// Depth of a reconstruction with its own camera, stored in the project.
    ///
    /// See [`super::EstimatedDepth`].
    Estimated {
        /// Path relative to the project folder, the home of [`super::FrameStore`].
        made: PathBuf,
        /// World units per unit of the map. Differs from 1 if the scene was scaled since.
        scale: f64,
    },
}

impl DepthSource {
    /// Returns the path of the sensor's depth image, or `None` for reconstructed depth.
    #[must_use]
    #[inline]
    pub fn sensor_path(&self) -> Option<&Path> {
        match self {
            Self::Sensor { path, .. } => Some(path),
            Self::Estimated { .. } => None,
        }
    }

    pub(super) fn sensor_path_mut(&mut self) -> Option<&mut PathBuf> {
        match self {
            Self::Sensor { path, .. } => Some(path),
            Self::Estimated { .. } => None,
        }
    }
}

/// The camera of one frame, for the image as shown (rotated upright).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameCamera {
    /// Intrinsics.
    pub intrinsics: Camera,
    /// Pose; `None` while only the intrinsics are known.
    pub camera_from_world: Option<Pose>,
    /// Whether the intrinsics were estimated with the pose.
    ///
    /// Another reconstruction then estimates them again.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub estimated: bool,
}

impl FrameCamera {
    /// Returns a camera whose intrinsics are given, not estimated.
    #[must_use]
    #[inline]
    pub fn given(intrinsics: Camera, camera_from_world: Option<Pose>) -> Self {
        Self {
            intrinsics,
            camera_from_world,
            estimated: false,
        }
    }
}

/// One image of the sequence, with its depth source and camera if known.
///
/// Pixels are loaded through [`super::FrameStore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "StoredFrame")]
pub struct Frame {
    /// Name, unique in the project: the path below the given folder, separated by `/`.
    ///
    /// For a video it is `VIDEO/000123`.
    pub name: String,
    /// Width of the image in pixels as shown (rotated upright).
    pub width: u32,
    /// Height of the image in pixels as shown.
    pub height: u32,
    /// Source of the image.
    #[serde(rename = "picture")] // the name in project files of format 1
    pub image: ImageSource,
    /// Source of the depth, if there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthSource>,
    /// The camera, if known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<FrameCamera>,
}

/// A frame as read from a project, before it is checked.
#[derive(Deserialize)]
struct StoredFrame {
    name: String,
    width: u32,
    height: u32,
    #[serde(rename = "picture")]
    image: ImageSource,
    #[serde(default)]
    depth: Option<DepthSource>,
    #[serde(default)]
    camera: Option<FrameCamera>,
}

impl TryFrom<StoredFrame> for Frame {
    type Error = String;

    /// Returns an error for impossible image sizes and for a camera of another size.
    ///
    /// This happens before anything of that size is allocated.
    fn try_from(stored: StoredFrame) -> Result<Self, String> {
        let StoredFrame {
            name,
            width,
            height,
            image,
            depth,
            camera,
        } = stored;
        let pixels = u64::from(width) * u64::from(height);
        if pixels == 0 || width.max(height) > Camera::MAX_SIDE || pixels > Camera::MAX_PIXELS {
            return Err(format!(
                "frame '{name}': {width} × {height} pixels are not possible (at most {} a side and {} million in all)",
                Camera::MAX_SIDE,
                Camera::MAX_PIXELS / 1_000_000
            ));
        }
        if let Some(FrameCamera { intrinsics, .. }) = &camera
            && (intrinsics.width, intrinsics.height) != (width, height)
        {
            return Err(format!(
                "frame '{name}': its camera is for {} × {} pixels but the image has {width} × {height}",
                intrinsics.width, intrinsics.height
            ));
        }
        Ok(Self {
            name,
            width,
            height,
            image,
            depth,
            camera,
        })
    }
}

impl Frame {
    /// Returns the intrinsics and `camera_from_world` if both are known.
    #[must_use]
    #[inline]
    pub fn posed_camera(&self) -> Option<(&Camera, &Pose)> {
        let camera = self.camera.as_ref()?;
        Some((&camera.intrinsics, camera.camera_from_world.as_ref()?))
    }

    /// Returns whether the frame has depth and a posed camera.
    ///
    /// Its pixels then have positions in the scene.
    #[must_use]
    #[inline]
    pub fn has_posed_depth(&self) -> bool {
        self.depth.is_some() && self.posed_camera().is_some()
    }

    /// Returns whether a sensor measured the depth.
    #[must_use]
    #[inline]
    pub fn has_sensor_depth(&self) -> bool {
        matches!(self.depth, Some(DepthSource::Sensor { .. }))
    }
}

/// Position of the shown pixel (x, y) in the stored rows: `base + x · step_x + y · step_y`.
struct Steps {
    base: usize,
    step_x: isize,
    step_y: isize,
}

/// Side of the blocks in which an image is rotated.
///
/// Source and target of a block stay in the CPU cache.
const BLOCK: usize = 32;

impl Orientation {
    /// Returns whether the shown image has the exchanged width and height of the stored one.
    #[must_use]
    #[inline]
    pub fn swaps_sides(self) -> bool {
        matches!(self.0, 5..=8)
    }

    /// Returns the width and height as shown, for those stored.
    #[must_use]
    #[inline]
    pub fn shown_size(self, width: u32, height: u32) -> (u32, u32) {
        if self.swaps_sides() {
            (height, width)
        } else {
            (width, height)
        }
    }

    fn steps(self, width: usize, height: usize) -> Steps {
        let (w, last_column, last_row) = (width.cast_signed(), width - 1, width * (height - 1));
        let (base, step_x, step_y) = match self.0 {
            2 => (last_column, -1, w),
            3 => (last_row + last_column, -1, -w),
            4 => (last_row, 1, -w),
            5 => (0, w, 1),
            6 => (last_row, -w, 1),
            7 => (last_row + last_column, -w, -1),
            8 => (last_column, w, -1),
            _ => (0, 1, w),
        };
        Steps {
            base,
            step_x,
            step_y,
        }
    }
}

/// Rotates `width · height` stored pixels upright; the result has the shown size.
pub(super) fn turn<T: Copy + Default>(
    stored: Vec<T>,
    width: u32,
    height: u32,
    orientation: Orientation,
) -> Vec<T> {
    if stored.is_empty() || !matches!(orientation.0, 2..=8) {
        return stored;
    }
    let steps = orientation.steps(width as usize, height as usize);
    let (columns, rows) = orientation.shown_size(width, height);
    let (columns, rows) = (columns as usize, rows as usize);
    let mut shown = vec![T::default(); stored.len()];
    for top in (0..rows).step_by(BLOCK) {
        for left in (0..columns).step_by(BLOCK) {
            for y in top..rows.min(top + BLOCK) {
                let from = steps.base.cast_signed() + y.cast_signed() * steps.step_y;
                for x in left..columns.min(left + BLOCK) {
                    shown[y * columns + x] =
                        stored[(from + x.cast_signed() * steps.step_x).cast_unsigned()];
                }
            }
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use image::metadata::Orientation as Exif;

    use super::*;

    #[test]
    fn every_orientation_rotates_as_exif_defines() {
        let (width, height) = (67, 41);
        let stored: Vec<u16> = (0..width * height).collect();
        let buffer = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(
            width.into(),
            height.into(),
            stored.clone(),
        )
        .unwrap();
        for value in 1..=8 {
            let mut expected = image::DynamicImage::ImageLuma16(buffer.clone());
            expected.apply_orientation(Exif::from_exif(value).unwrap());
            let orientation = Orientation(value);
            let shown = turn(stored.clone(), width.into(), height.into(), orientation);
            assert_eq!(
                orientation.shown_size(width.into(), height.into()),
                (expected.width(), expected.height()),
                "orientation {value}"
            );
            assert_eq!(
                shown,
                expected.into_luma16().into_raw(),
                "orientation {value}"
            );
        }
    }

    #[test]
    fn empty_image_stays_empty() {
        assert!(turn(Vec::<u8>::new(), 0, 0, Orientation(6)).is_empty());
    }
}
