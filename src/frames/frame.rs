use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::DepthCamera;
use ostra_geometry::{Camera, Pose};

/// How a stored picture must be turned to be seen upright: the EXIF orientation, 1 to 8.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Orientation(pub u8);

impl Default for Orientation {
    fn default() -> Self {
        Self(1)
    }
}

/// Where a frame's picture comes from. Sources are referenced, never copied or changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureSource {
    /// A picture file.
    File {
        /// Absolute path.
        path: PathBuf,
        /// Turn to apply when shown.
        #[serde(default)]
        orientation: Orientation,
    },
    /// A picture of a film, decoded on demand.
    Film {
        /// Absolute path of the film.
        path: PathBuf,
        /// Which picture of the film, from 0.
        index: u64,
        /// Its time in seconds from the start.
        time_s: f64,
    },
}

impl PictureSource {
    /// The picture file or the film.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::File { path, .. } | Self::Film { path, .. } => path,
        }
    }

    /// What tells this picture from all others: its file, and which one of the film (0 for a picture file).
    pub(super) fn identity(&self) -> (PathBuf, u64) {
        match self {
            Self::File { path, .. } => (path.clone(), 0),
            Self::Film { path, index, .. } => (path.clone(), *index),
        }
    }

    pub(super) fn path_mut(&mut self) -> &mut PathBuf {
        match self {
            Self::File { path, .. } | Self::Film { path, .. } => path,
        }
    }
}

/// Where a frame's depth comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum DepthSource {
    /// A sensor: a grey image of 16 bits or of floats, pixel for pixel with the stored colour image unless it has a camera of
    /// its own.
    Sensor {
        /// Absolute path.
        path: PathBuf,
        /// World units (metres) per unit of the stored value. Unknown are 0, negative values, the largest integer, NaN and
        /// infinities.
        unit: f64,
        /// Turn to apply, that of the colour picture.
        #[serde(default)]
        orientation: Orientation,
        /// The camera that measured it, where that is not the picture's; it is then seen through the picture's.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        camera: Option<Box<DepthCamera>>,
    },
    /// A reconstruction: a depth map with a camera of its own, which lies with the project (see [`super::MadeDepth`]).
    Made {
        /// Path below [`super::FrameStore`]'s home, the project's folder, with which it moves.
        made: PathBuf,
        /// World units per unit of the map: other than 1 where the scene was scaled since.
        scale: f64,
    },
}

impl DepthSource {
    /// The sensor's picture; `None` for depth that was made.
    #[must_use]
    pub fn sensor_path(&self) -> Option<&Path> {
        match self {
            Self::Sensor { path, .. } => Some(path),
            Self::Made { .. } => None,
        }
    }

    pub(super) fn sensor_path_mut(&mut self) -> Option<&mut PathBuf> {
        match self {
            Self::Sensor { path, .. } => Some(path),
            Self::Made { .. } => None,
        }
    }
}

/// The camera of one frame, for the picture as it is shown (turned upright).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct FrameCamera {
    /// Intrinsics.
    pub intrinsics: Camera,
    /// `None` while only the intrinsics are known.
    pub camera_from_world: Option<Pose>,
    /// The intrinsics were estimated with the pose, not given: another reconstruction estimates them anew.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub estimated: bool,
}

impl FrameCamera {
    /// A camera that is given.
    #[must_use]
    pub fn given(intrinsics: Camera, camera_from_world: Option<Pose>) -> Self {
        Self {
            intrinsics,
            camera_from_world,
            estimated: false,
        }
    }
}

/// One picture of the sequence, with what is known of it. Pixels are loaded through [`super::FrameStore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "StoredFrame")]
pub struct Frame {
    /// Unique in the project: the path below the folder given, with `/`; for a film `FILM/000123`.
    pub name: String,
    /// Columns of the picture as shown (turned upright).
    pub width: u32,
    /// Rows of the picture as shown.
    pub height: u32,
    /// Where the picture comes from.
    pub picture: PictureSource,
    /// Where depth comes from, where there is any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthSource>,
    /// The camera, where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<FrameCamera>,
}

/// A frame as a project gives it, before it is checked.
#[derive(Deserialize)]
struct StoredFrame {
    name: String,
    width: u32,
    height: u32,
    picture: PictureSource,
    #[serde(default)]
    depth: Option<DepthSource>,
    #[serde(default)]
    camera: Option<FrameCamera>,
}

impl TryFrom<StoredFrame> for Frame {
    type Error = String;

    /// Refuses sizes that no image has, before anything of that size is allocated, and a camera of another size.
    fn try_from(stored: StoredFrame) -> Result<Self, String> {
        let StoredFrame {
            name,
            width,
            height,
            picture,
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
            picture,
            depth,
            camera,
        })
    }
}

impl Frame {
    /// Intrinsics and `camera_from_world`, where both are known.
    #[must_use]
    pub fn posed_camera(&self) -> Option<(&Camera, &Pose)> {
        let camera = self.camera.as_ref()?;
        Some((&camera.intrinsics, camera.camera_from_world.as_ref()?))
    }

    /// Whether it has depth and a camera that is posed, so that its pixels have places in the scene.
    #[must_use]
    pub fn has_posed_depth(&self) -> bool {
        self.depth.is_some() && self.posed_camera().is_some()
    }

    /// Whether a sensor measured its depth.
    #[must_use]
    pub fn has_sensor_depth(&self) -> bool {
        matches!(self.depth, Some(DepthSource::Sensor { .. }))
    }
}
