use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::cache::{Cache, Weigh};
use super::decode::{decode_depth, decode_picture};
use super::film::Films;
use super::{DepthMap, DepthSource, Frame, FrameError, Image, PictureSource};

/// Decodes pictures and depths and keeps the latest.
#[derive(Debug)]
pub(super) struct Loader {
    pixels: Cache<Key, Pixels>,
    films: Films,
}

/// What pixels are made from.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) enum Key {
    File { path: PathBuf, orientation: u8 },
    Film { path: PathBuf, index: u64 },
    Depth { path: PathBuf, orientation: u8, unit_bits: u64 },
}

#[derive(Debug, Clone)]
enum Pixels {
    Image(Arc<Image>),
    Depth(Arc<DepthMap>),
}

impl Weigh for Arc<Image> {
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
    /// The key of a frame's picture.
    pub fn of_picture(source: &PictureSource) -> Self {
        match source {
            PictureSource::File { path, orientation } => Self::File { path: path.clone(), orientation: orientation.0 },
            PictureSource::Film { path, index, .. } => Self::Film { path: path.clone(), index: *index },
        }
    }

    fn of_depth(source: &DepthSource) -> Self {
        let DepthSource { path, unit, orientation } = source;
        Self::Depth { path: path.clone(), orientation: orientation.0, unit_bits: unit.to_bits() }
    }
}

impl Loader {
    pub fn new(budget_bytes: usize) -> Self {
        Self { pixels: Cache::new(budget_bytes), films: Films::default() }
    }

    pub fn bytes(&self) -> usize {
        self.pixels.bytes()
    }

    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let load = || self.decode_image(frame).map(Pixels::Image);
        match self.pixels.get(&Key::of_picture(&frame.picture), load)? {
            Pixels::Image(image) => checked(frame, image),
            Pixels::Depth(_) => self.decode_image(frame),
        }
    }

    pub fn cached_image(&self, frame: &Frame) -> Option<Arc<Image>> {
        match self.pixels.peek(&Key::of_picture(&frame.picture))? {
            Pixels::Image(image) => checked(frame, image).ok(),
            Pixels::Depth(_) => None,
        }
    }

    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        let Some(source) = &frame.depth else { return Ok(None) };
        let decode = || decode_depth(&source.path, source.unit, source.orientation).map(Arc::new);
        let depth = match self.pixels.get(&Key::of_depth(source), || decode().map(Pixels::Depth))? {
            Pixels::Depth(depth) => depth,
            Pixels::Image(_) => decode()?,
        };
        check_size(frame, &source.path, (depth.width, depth.height))?;
        Ok(Some(depth))
    }

    /// The picture without keeping it.
    pub fn decode_image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let image = match &frame.picture {
            PictureSource::File { path, orientation } => decode_picture(path, *orientation)?,
            PictureSource::Film { path, index, time_s } => {
                if !path.exists() {
                    return Err(FrameError::Missing { path: path.clone() });
                }
                self.films.read(path, *index, *time_s, picture_bytes(frame))?
            }
        };
        checked(frame, Arc::new(image))
    }
}

/// Bytes of a frame's decoded picture.
pub(super) fn picture_bytes(frame: &Frame) -> usize {
    frame.width as usize * frame.height as usize * size_of::<[u8; 3]>()
}

/// Bytes of a frame's decoded depth.
pub(super) fn depth_bytes(frame: &Frame) -> usize {
    frame.depth.as_ref().map_or(0, |_| frame.width as usize * frame.height as usize * size_of::<f32>())
}

fn checked(frame: &Frame, image: Arc<Image>) -> Result<Arc<Image>, FrameError> {
    check_size(frame, frame.picture.path(), (image.width, image.height))?;
    Ok(image)
}

fn check_size(frame: &Frame, path: &Path, (width, height): (u32, u32)) -> Result<(), FrameError> {
    if (width, height) == (frame.width, frame.height) {
        return Ok(());
    }
    let what = format!(
        "it is {width} × {height} pixels now but was {} × {} when frame {} was opened; \
         put the earlier file back or open the frames anew",
        frame.width, frame.height, frame.name
    );
    Err(FrameError::Invalid { path: path.into(), what })
}
