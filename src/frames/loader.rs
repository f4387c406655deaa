use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::decode::{decode_depth, decode_image, opaque_pixels};
use super::video::Videos;
use super::{
    DepthCamera, DepthMap, DepthSource, EstimatedDepth, Frame, FrameError, Image, ImageSource,
};
use ostra_core::cache::{Cache, Weigh};

/// Decodes images and depth and caches the most recently used.
#[derive(Debug)]
pub(super) struct Loader {
    pixels: Cache<Key, Pixels>,
    videos: Videos,
    /// Folder that contains the reconstructed depth maps.
    home: PathBuf,
}

/// Inputs that decoded pixels depend on; the cache key.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Key {
    File {
        path: PathBuf,
        orientation: u8,
    },
    Video {
        path: PathBuf,
        index: u64,
    },
    Depth {
        path: PathBuf,
        orientation: u8,
        unit_bits: u64,
        lenses: String,
    },
    Made {
        path: PathBuf,
        scale_bits: u64,
        lens: String,
    },
}

#[derive(Debug, Clone)]
enum Pixels {
    Image(Arc<Image>),
    Depth(Arc<DepthMap>),
}

impl Weigh for Image {
    fn bytes(&self) -> usize {
        self.pixels.len() * size_of::<[u8; 3]>()
    }
}

impl Weigh for Pixels {
    fn bytes(&self) -> usize {
        match self {
            Self::Image(image) => image.bytes(),
            Self::Depth(depth) => depth.depths.len() * size_of::<f32>(),
        }
    }
}

impl Key {
    /// Returns the key of a frame's image.
    pub fn of_image(source: &ImageSource) -> Self {
        match source {
            ImageSource::File { path, orientation } => Self::File {
                path: path.clone(),
                orientation: orientation.0,
            },
            ImageSource::Video { path, index, .. } => Self::Video {
                path: path.clone(),
                index: *index,
            },
        }
    }

    fn of_depth(frame: &Frame, source: &DepthSource) -> Self {
        match source {
            DepthSource::Sensor {
                path,
                unit,
                orientation,
                camera,
            } => {
                let lenses = camera
                    .as_ref()
                    .map(|camera| format!("{camera:?} {}", lens(frame)));
                Self::Depth {
                    path: path.clone(),
                    orientation: orientation.0,
                    unit_bits: unit.to_bits(),
                    lenses: lenses.unwrap_or_default(),
                }
            }
            DepthSource::Estimated { made, scale } => Self::Made {
                path: made.clone(),
                scale_bits: scale.to_bits(),
                lens: lens(frame),
            },
        }
    }
}

/// Returns the frame's lens parameters as part of the cache key: decoded pixels depend on them.
fn lens(frame: &Frame) -> String {
    frame
        .camera
        .map(|camera| format!("{:?}", camera.intrinsics))
        .unwrap_or_default()
}

impl Loader {
    pub fn new(budget_bytes: usize, home: PathBuf) -> Self {
        Self {
            pixels: Cache::new(budget_bytes),
            videos: Videos::default(),
            home,
        }
    }

    pub fn bytes(&self) -> usize {
        self.pixels.bytes()
    }

    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let load = || self.decode_image(frame).map(Pixels::Image);
        match self.pixels.get(&Key::of_image(&frame.image), load)? {
            Pixels::Image(image) => checked(frame, image),
            Pixels::Depth(_) => self.decode_image(frame),
        }
    }

    pub fn forget_image(&self, frame: &Frame) {
        self.pixels.remove(&Key::of_image(&frame.image));
    }

    pub fn cached_image(&self, frame: &Frame) -> Option<Arc<Image>> {
        match self.pixels.peek(&Key::of_image(&frame.image))? {
            Pixels::Image(image) => checked(frame, image).ok(),
            Pixels::Depth(_) => None,
        }
    }

    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        let Some(source) = &frame.depth else {
            return Ok(None);
        };
        let decode = || self.decode_depth(frame, source).map(Arc::new);
        let depth = match self.pixels.get(&Key::of_depth(frame, source), || {
            decode().map(Pixels::Depth)
        })? {
            Pixels::Depth(depth) => depth,
            Pixels::Image(_) => decode()?,
        };
        let path = source.sensor_path().unwrap_or(frame.image.path());
        check_size(frame, path, depth.width, depth.height)?;
        Ok(Some(depth))
    }

    /// Returns the reconstructed depth map of a frame, without caching it.
    pub fn estimated_depth(&self, frame: &Frame) -> Result<Option<EstimatedDepth>, FrameError> {
        match &frame.depth {
            Some(DepthSource::Estimated { made, .. }) => {
                EstimatedDepth::read(&self.home.join(made)).map(Some)
            }
            _ => Ok(None),
        }
    }

    fn decode_depth(&self, frame: &Frame, source: &DepthSource) -> Result<DepthMap, FrameError> {
        match source {
            DepthSource::Sensor {
                path,
                unit,
                orientation,
                camera,
            } => {
                let check = |(width, height)| match camera {
                    Some(camera) => check_lens_size(path, camera, width, height),
                    None => check_size(frame, path, width, height),
                };
                let measured = decode_depth(path, *unit, *orientation, &check)?;
                match camera {
                    Some(camera) => through_lens(frame, path, camera, &measured),
                    None => Ok(measured),
                }
            }
            DepthSource::Estimated { made, scale } => {
                Ok(EstimatedDepth::read(&self.home.join(made))?.seen_by(frame, *scale))
            }
        }
    }

    /// Returns which pixels of the frame's image are opaque; `None` if all are. Not cached.
    pub fn opaque_pixels(&self, frame: &Frame) -> Result<Option<Vec<bool>>, FrameError> {
        match &frame.image {
            ImageSource::File { path, orientation } => {
                opaque_pixels(path, *orientation, &|(width, height)| {
                    check_size(frame, path, width, height)
                })
            }
            ImageSource::Video { .. } => Ok(None),
        }
    }

    /// Decodes the image without caching it.
    pub fn decode_image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let image = match &frame.image {
            ImageSource::File { path, orientation } => {
                decode_image(path, *orientation, &|(width, height)| {
                    check_size(frame, path, width, height)
                })?
            }
            ImageSource::Video {
                path,
                index,
                time_s,
            } => {
                if !path.exists() {
                    return Err(FrameError::Missing { path: path.clone() });
                }
                self.videos
                    .read(path, *index, *time_s, image_bytes(frame))?
            }
        };
        checked(frame, Arc::new(image))
    }
}

fn check_lens_size(
    path: &Path,
    by: &DepthCamera,
    now_width: u32,
    now_height: u32,
) -> Result<(), FrameError> {
    let (width, height) = (by.intrinsics.width, by.intrinsics.height);
    if (now_width, now_height) == (width, height) {
        return Ok(());
    }
    let what = format!(
        "depth of {now_width} × {now_height} pixels does not fit its camera of {width} × {height}; give it as it was"
    );
    Err(FrameError::Invalid {
        path: path.into(),
        what,
    })
}

/// Returns depth that another camera measured as the frame's camera sees it.
fn through_lens(
    frame: &Frame,
    path: &Path,
    by: &DepthCamera,
    measured: &DepthMap,
) -> Result<DepthMap, FrameError> {
    let invalid = |what: String| FrameError::Invalid {
        path: path.into(),
        what,
    };
    let image = frame.camera.ok_or_else(|| {
        let name = &frame.name;
        invalid(format!(
            "the depth camera is known but not the camera of image {name}; give --intrinsics or --cameras"
        ))
    })?;
    Ok(by.seen_by(measured, &image.intrinsics))
}

/// Returns the bytes of a frame's decoded image.
pub(super) fn image_bytes(frame: &Frame) -> usize {
    frame.width as usize * frame.height as usize * size_of::<[u8; 3]>()
}

/// Returns the bytes of a frame's decoded depth.
pub(super) fn depth_bytes(frame: &Frame) -> usize {
    frame.depth.as_ref().map_or(0, |_| {
        frame.width as usize * frame.height as usize * size_of::<f32>()
    })
}

fn checked(frame: &Frame, image: Arc<Image>) -> Result<Arc<Image>, FrameError> {
    check_size(frame, frame.image.path(), image.width, image.height)?;
    Ok(image)
}

fn check_size(frame: &Frame, path: &Path, width: u32, height: u32) -> Result<(), FrameError> {
    if (width, height) == (frame.width, frame.height) {
        return Ok(());
    }
    let what = format!(
        "it is {width} × {height} pixels now but was {} × {} when frame {} was opened; \
         put the earlier file back or open the frames again",
        frame.width, frame.height, frame.name
    );
    Err(FrameError::Invalid {
        path: path.into(),
        what,
    })
}
