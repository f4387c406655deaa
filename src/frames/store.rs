use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::cache::{Cache, Weigh};
use super::decode::{decode_depth, decode_picture};
use super::film::Films;
use super::{DepthMap, DepthSource, Frame, FrameError, Image, PictureSource};

/// Loads pictures and depths on demand and keeps the latest in a cache bounded in bytes. Shared by all threads.
#[derive(Debug)]
pub struct FrameStore {
    pixels: Cache<Key, Pixels>,
    films: Films,
}

/// What pixels are made from.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
enum Key {
    File { path: PathBuf, orientation: u8 },
    Film { path: PathBuf, index: u64 },
    Depth { path: PathBuf, orientation: u8, unit_bits: u64 },
}

#[derive(Debug, Clone)]
enum Pixels {
    Image(Arc<Image>),
    Depth(Arc<DepthMap>),
}

impl Weigh for Pixels {
    fn bytes(&self) -> usize {
        match self {
            Self::Image(image) => image.pixels.len() * size_of::<[u8; 3]>(),
            Self::Depth(depth) => depth.depths.len() * size_of::<f32>(),
        }
    }
}

impl FrameStore {
    /// A store that keeps at most `budget_bytes` of decoded pixels.
    #[must_use]
    pub fn new(budget_bytes: usize) -> Self {
        Self { pixels: Cache::new(budget_bytes), films: Films::default() }
    }

    /// Bytes of decoded pixels kept now; never above the budget.
    #[must_use]
    pub fn bytes_kept(&self) -> usize {
        self.pixels.bytes()
    }

    /// The frame's picture, turned upright. A picture larger than the budget is decoded anew each time.
    ///
    /// # Errors
    /// [`FrameError`] when the source is missing, damaged or of another size than when it was opened.
    pub fn image(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let load = || self.load_picture(frame).map(Pixels::Image);
        let Pixels::Image(image) = self.pixels.get(&picture_key(&frame.picture), load)? else {
            return self.load_picture(frame);
        };
        check_size(frame, frame.picture.path(), (image.width, image.height))?;
        Ok(image)
    }

    /// The frame's picture if it is decoded already; never waits.
    #[must_use]
    pub fn cached_image(&self, frame: &Frame) -> Option<Arc<Image>> {
        match self.pixels.peek(&picture_key(&frame.picture))? {
            Pixels::Image(image) if (image.width, image.height) == (frame.width, frame.height) => Some(image),
            _ => None,
        }
    }

    /// The frame's depth in world units, turned upright; `None` when it has none.
    ///
    /// # Errors
    /// As [`Self::image`].
    pub fn depth(&self, frame: &Frame) -> Result<Option<Arc<DepthMap>>, FrameError> {
        let Some(source) = &frame.depth else { return Ok(None) };
        let load = || load_depth(source).map(Pixels::Depth);
        let Pixels::Depth(depth) = self.pixels.get(&depth_key(source), load)? else {
            return load_depth(source).map(Some);
        };
        check_size(frame, &source.path, (depth.width, depth.height))?;
        Ok(Some(depth))
    }

    fn load_picture(&self, frame: &Frame) -> Result<Arc<Image>, FrameError> {
        let image = match &frame.picture {
            PictureSource::File { path, orientation } => decode_picture(path, *orientation),
            PictureSource::Film { path, index, time_s } => {
                if !path.exists() {
                    return Err(FrameError::Missing { path: path.clone() });
                }
                let bytes = frame.width as usize * frame.height as usize * size_of::<[u8; 3]>();
                self.films.read(path, *index, *time_s, bytes)
            }
        };
        image.map(Arc::new)
    }
}

fn picture_key(source: &PictureSource) -> Key {
    match source {
        PictureSource::File { path, orientation } => Key::File { path: path.clone(), orientation: orientation.0 },
        PictureSource::Film { path, index, .. } => Key::Film { path: path.clone(), index: *index },
    }
}

fn depth_key(source: &DepthSource) -> Key {
    Key::Depth { path: source.path.clone(), orientation: source.orientation.0, unit_bits: source.unit.to_bits() }
}

fn load_depth(source: &DepthSource) -> Result<Arc<DepthMap>, FrameError> {
    decode_depth(&source.path, source.unit, source.orientation).map(Arc::new)
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
