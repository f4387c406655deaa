//! Given cameras as files contain them, and how they are rotated and attached to frames.

use std::path::PathBuf;

use glam::DVec2;

use crate::{Frame, FrameCamera, FrameError, ImageSource, Orientation};
use ostra_geometry::{Camera, Distortion, GeometryError, Pose, QuarterRotation};

/// How a given camera identifies its frame.
#[derive(Debug, Clone, PartialEq)]
pub enum CameraKey {
    /// The image's name, with or without folders and extension, separated by `/`.
    Name(String),
    /// The image's number, in its name or in the order of frames.
    Index(u64),
    /// The image's time in seconds, which its name contains.
    Time(f64),
}

/// A given focal length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Focal {
    /// Along x and y, in pixels of the stored image.
    Pixels(DVec2),
    /// From the full horizontal angle of view in radians.
    AngleX(f64),
}

/// Intrinsics of a stored image as a file gives them; missing values come from the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GivenIntrinsics {
    /// Width and height in pixels; `None` = those of the image.
    pub size: Option<[u32; 2]>,
    /// Focal lengths.
    pub focal: Focal,
    /// Principal point in pixels; `None` = the image's centre.
    ///
    /// The centre of the top-left pixel is at (0.5, 0.5).
    pub principal_px: Option<DVec2>,
    /// Lens distortion.
    pub distortion: Distortion,
}

/// One camera of a file of cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenCamera {
    /// How the camera identifies its frame.
    pub key: CameraKey,
    /// Intrinsics; `None` if the format only has poses.
    pub intrinsics: Option<GivenIntrinsics>,
    /// Pose of the camera of the stored image, or why it has none.
    ///
    /// Programs write NaN, infinities or zeros for frames that they lost.
    pub camera_from_world: Result<Pose, String>,
}

/// All cameras of a file or folder.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenCameras {
    /// Path they were read from.
    pub path: PathBuf,
    /// Cameras in the order of the file.
    pub cameras: Vec<GivenCamera>,
}

impl GivenCameras {
    /// Returns whether every camera with a pose has intrinsics.
    ///
    /// Otherwise, give intrinsics to the frames first ([`attach_intrinsics`]).
    #[must_use]
    pub fn have_intrinsics(&self) -> bool {
        let posed = |camera: &&GivenCamera| camera.camera_from_world.is_ok();
        self.cameras
            .iter()
            .filter(posed)
            .all(|camera| camera.intrinsics.is_some())
    }

    /// Returns the cameras of `path`; an error if none of them has a pose.
    pub(super) fn new(path: PathBuf, cameras: Vec<GivenCamera>) -> Result<Self, FrameError> {
        if cameras.is_empty() {
            let what = "holds no cameras; give a file of cameras that were found".into();
            return Err(FrameError::Invalid { path, what });
        }
        if cameras
            .iter()
            .all(|camera| camera.camera_from_world.is_err())
            && let Some(Err(reason)) = cameras.first().map(|camera| &camera.camera_from_world)
        {
            let what = format!(
                "holds no cameras with a pose ({reason}); give a file of cameras that were found"
            );
            return Err(FrameError::Invalid { path, what });
        }
        Ok(Self { path, cameras })
    }
}

impl GivenCamera {
    /// Returns a camera with the given intrinsics; if they are unusable, it has no pose either.
    pub(super) fn with_intrinsics(
        key: CameraKey,
        intrinsics: &Result<GivenIntrinsics, String>,
        pose: Result<Pose, String>,
    ) -> Self {
        match intrinsics {
            Ok(intrinsics) => Self {
                key,
                intrinsics: Some(*intrinsics),
                camera_from_world: pose,
            },
            Err(reason) => Self {
                key,
                intrinsics: None,
                camera_from_world: Err(reason.clone()),
            },
        }
    }
}

impl GivenIntrinsics {
    /// Returns the intrinsics of an undistorted camera matrix without a size.
    pub(super) fn pinhole(focal_px: DVec2, principal_px: DVec2) -> Self {
        let distortion = Distortion::None;
        Self {
            size: None,
            focal: Focal::Pixels(focal_px),
            principal_px: Some(principal_px),
            distortion,
        }
    }

    /// Returns the camera of a stored image of this size.
    ///
    /// # Errors
    ///
    /// What is wrong and what to do: another size, an impossible focal length, or a value that is
    /// not a number.
    pub fn for_image(&self, width: u32, height: u32) -> Result<Camera, String> {
        if let Some([w, h]) = self.size
            && [w, h] != [width, height]
        {
            return Err(format!(
                "the camera is for an image of {w}x{h}, the image has {width}x{height}; give images and cameras of one size"
            ));
        }
        let (w, h) = (f64::from(width), f64::from(height));
        let focal_px = match self.focal {
            Focal::Pixels(focal_px) => focal_px,
            Focal::AngleX(angle) => DVec2::splat(0.5 * w / (0.5 * angle).tan()),
        };
        let principal_px = self.principal_px.unwrap_or(DVec2::new(0.5 * w, 0.5 * h));
        if !(focal_px.is_finite() && focal_px.min_element() > 0.0 && principal_px.is_finite()) {
            return Err(format!(
                "focal lengths {}, {} and principal point {}, {} do not describe a camera; give pixels, with focal lengths above 0",
                focal_px.x, focal_px.y, principal_px.x, principal_px.y
            ));
        }
        Ok(Camera {
            width,
            height,
            focal_px,
            principal_px,
            distortion: self.distortion,
        })
    }
}

/// Returns the rotation from the stored image to the shown one.
///
/// # Errors
///
/// [`GeometryError::Mirrored`] for an orientation that mirrors.
pub(super) fn turn_of(frame: &Frame) -> Result<QuarterRotation, GeometryError> {
    match frame.image {
        ImageSource::File {
            orientation: Orientation(orientation),
            ..
        } => QuarterRotation::from_exif(orientation),
        ImageSource::Video { .. } => Ok(QuarterRotation::None),
    }
}

/// Returns the camera of the shown image for that of the stored one.
///
/// Without given intrinsics the frame keeps its own.
///
/// # Errors
///
/// [`FrameError::NotFound`], naming the frame: a camera of another size, missing intrinsics, or a
/// mirrored image.
pub(super) fn shown_camera(
    frame: &Frame,
    intrinsics: Option<&GivenIntrinsics>,
    camera_from_world: Option<&Pose>,
) -> Result<FrameCamera, FrameError> {
    let named = |what: String| FrameError::NotFound(format!("frame {}: {what}", frame.name));
    let turn = turn_of(frame).map_err(|error| named(error.to_string()))?;
    let intrinsics = match intrinsics {
        Some(given) => {
            let (width, height) = stored_size(frame, turn);
            given.for_image(width, height).map_err(named)?.turned(turn)
        }
        None => frame.camera.map(|camera| camera.intrinsics).ok_or_else(|| {
            named("the file of cameras holds poses only; give the intrinsics too (--intrinsics FX,FY,CX,CY)".into())
        })?,
    };
    Ok(FrameCamera::given(
        intrinsics,
        camera_from_world.map(|pose| pose.turned(turn)),
    ))
}

/// Returns the camera and pose of the stored image of a frame with both; `None` otherwise.
pub(super) fn stored_camera(frame: &Frame) -> Result<Option<(Camera, Pose)>, GeometryError> {
    let Some((camera, pose)) = frame.posed_camera() else {
        return Ok(None);
    };
    let back = turn_of(frame)?.inverse();
    Ok(Some((camera.turned(back), pose.turned(back))))
}

pub(super) fn stored_size(frame: &Frame, turn: QuarterRotation) -> (u32, u32) {
    match turn {
        QuarterRotation::None | QuarterRotation::Half => (frame.width, frame.height),
        QuarterRotation::Clockwise | QuarterRotation::Anticlockwise => (frame.height, frame.width),
    }
}

/// Gives every frame the same intrinsics, those of its stored image, and keeps poses.
///
/// On an error no frame is changed.
///
/// # Errors
///
/// [`FrameError::NotFound`] if the values are not those of a camera, images differ in size, or one
/// is mirrored.
pub fn attach_intrinsics(frames: &mut [Frame], given: &GivenIntrinsics) -> Result<(), FrameError> {
    let mut cameras = Vec::with_capacity(frames.len());
    let mut first: Option<(&Frame, (u32, u32))> = None;
    for frame in frames.iter() {
        let turn = turn_of(frame)
            .map_err(|error| FrameError::NotFound(format!("frame {}: {error}", frame.name)))?;
        let size = stored_size(frame, turn);
        let (of, fits) = *first.get_or_insert((frame, size));
        if size != fits {
            return Err(FrameError::NotFound(format!(
                "one set of intrinsics cannot fit {} ({}x{}) and {} ({}x{}); give a file of cameras (--cameras)",
                of.name, fits.0, fits.1, frame.name, size.0, size.1
            )));
        }
        let pose = frame
            .camera
            .and_then(|camera| camera.camera_from_world)
            .map(|pose| pose.turned(turn.inverse()));
        cameras.push(shown_camera(frame, Some(given), pose.as_ref())?);
    }
    for (frame, camera) in frames.iter_mut().zip(cameras) {
        frame.camera = Some(camera);
    }
    Ok(())
}
