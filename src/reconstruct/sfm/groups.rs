use std::path::PathBuf;

use super::{IntrinsicsPrior, MapCamera};
use ostra_frames::{Frame, ImageSource, Orientation, exif_focal_px};
use ostra_geometry::{Camera, Distortion};

/// Guessed focal length of an unknown camera, relative to the longer side of its images.
const GUESSED_FOCAL: f64 = 1.2;

/// Properties that all images of one unknown camera share.
#[derive(PartialEq)]
struct Trace {
    /// The folder of the image, or the video.
    place: PathBuf,
    size: (u32, u32),
    orientation: Orientation,
    exif_focal_px: Option<f64>,
}

/// Assigns frames to cameras.
///
/// Frames with the same given intrinsics share a camera. The other frames share one if they come
/// from the same folder or video and have the same size, rotation and EXIF focal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct CameraGroups {
    /// The cameras.
    pub cameras: Vec<MapCamera>,
    /// Index of the camera of each frame.
    pub camera_of: Vec<usize>,
}

impl CameraGroups {
    /// Groups frames, some of which may have intrinsics. Estimated intrinsics count as unknown.
    #[must_use]
    pub fn new(frames: &[&Frame]) -> Self {
        let mut groups = Self::default();
        let mut traces: Vec<(Trace, usize)> = Vec::new();
        for frame in frames {
            let number = match frame.camera.filter(|camera| !camera.estimated) {
                Some(camera) => groups.given(camera.intrinsics),
                None => groups.unknown(frame, &mut traces),
            };
            groups.camera_of.push(number);
        }
        groups
    }

    fn given(&mut self, intrinsics: Camera) -> usize {
        let camera = MapCamera {
            intrinsics,
            source: IntrinsicsPrior::Given,
        };
        self.cameras
            .iter()
            .position(|known| *known == camera)
            .unwrap_or_else(|| self.push(camera))
    }

    fn unknown(&mut self, frame: &Frame, traces: &mut Vec<(Trace, usize)>) -> usize {
        let trace = Trace::of(frame);
        if let Some((_, number)) = traces.iter().find(|(known, _)| *known == trace) {
            return *number;
        }
        let number = self.push(first_guess(frame, trace.exif_focal_px));
        traces.push((trace, number));
        number
    }

    fn push(&mut self, camera: MapCamera) -> usize {
        self.cameras.push(camera);
        self.cameras.len() - 1
    }
}

impl Trace {
    fn of(frame: &Frame) -> Self {
        let (place, orientation) = match &frame.image {
            ImageSource::File { path, orientation } => {
                (path.parent().unwrap_or(path).to_path_buf(), *orientation)
            }
            ImageSource::Video { path, .. } => (path.clone(), Orientation::default()),
        };
        Self {
            place,
            size: (frame.width, frame.height),
            orientation,
            exif_focal_px: exif_focal_px(frame),
        }
    }
}

fn first_guess(frame: &Frame, exif_focal_px: Option<f64>) -> MapCamera {
    let (width, height) = (f64::from(frame.width), f64::from(frame.height));
    let focal = exif_focal_px.unwrap_or(GUESSED_FOCAL * width.max(height));
    let intrinsics = Camera {
        distortion: Distortion::Radial { k: [0.0; 2] },
        ..Camera::pinhole(
            frame.width,
            frame.height,
            [focal, focal],
            [width / 2.0, height / 2.0],
        )
    };
    let source = if exif_focal_px.is_some() {
        IntrinsicsPrior::Exif
    } else {
        IntrinsicsPrior::Guessed
    };
    MapCamera { intrinsics, source }
}
