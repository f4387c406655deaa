use super::GivenIntrinsics;
use crate::{Frame, FrameCamera, FrameError, Orientation, PictureSource};
use ostra_geometry::{Camera, GeometryError, Pose, Turn};

/// The turn from the stored picture to the shown one.
///
/// # Errors
/// [`GeometryError::Mirrored`] for an orientation that mirrors.
pub(super) fn turn_of(frame: &Frame) -> Result<Turn, GeometryError> {
    match frame.picture {
        PictureSource::File {
            orientation: Orientation(orientation),
            ..
        } => Turn::from_exif(orientation),
        PictureSource::Film { .. } => Ok(Turn::None),
    }
}

/// The camera of the shown picture from that of the stored one. Without given intrinsics the frame's own are kept.
///
/// # Errors
/// [`FrameError::NotFound`], naming the frame: a camera of another size, missing intrinsics, a mirrored picture.
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
            given.for_picture(width, height).map_err(named)?.turned(turn)
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

/// The camera and pose of the stored picture of a frame that has both; `None` otherwise.
pub(super) fn stored_camera(frame: &Frame) -> Result<Option<(Camera, Pose)>, GeometryError> {
    let Some((camera, pose)) = frame.posed_camera() else {
        return Ok(None);
    };
    let back = turn_of(frame)?.inverse();
    Ok(Some((camera.turned(back), pose.turned(back))))
}

pub(super) fn stored_size(frame: &Frame, turn: Turn) -> (u32, u32) {
    match turn {
        Turn::None | Turn::Half => (frame.width, frame.height),
        Turn::Clockwise | Turn::Anticlockwise => (frame.height, frame.width),
    }
}

/// Gives every frame the same intrinsics, those of its stored picture, keeping poses. On an error no frame is changed.
///
/// # Errors
/// [`FrameError::NotFound`] when values are no camera, pictures differ in size or one is mirrored.
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
