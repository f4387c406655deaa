use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::source::{Item, Origin};
use crate::engine::job::Progress;
use crate::frames::cameras::GivenDepthCamera;
use crate::frames::decode::not_depth;
use crate::frames::header::{Header, read_header};
use crate::frames::{DepthSource, Frame, FrameError, Orientation, PictureSource};
use crate::geometry::{GeometryError, Turn};

/// How many frames a warning names.
const NAMED: usize = 3;

/// What is known of the depths of all sources.
pub(super) struct Sensor {
    /// World units per step of the stored value.
    pub unit: f64,
    /// The camera that measured them; `None` = the pictures'.
    pub camera: Option<GivenDepthCamera>,
}

/// Makes frames of listed pictures from their headers, read in parallel; warnings tell what looks odd.
pub(super) fn read_frames(
    items: &[Item],
    sensor: &Sensor,
    progress: &Progress,
) -> Result<(Vec<Frame>, Vec<String>), FrameError> {
    let done = AtomicUsize::new(0);
    let read = items.par_iter().map(|item| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), items.len())?;
        frame_of(item, sensor)
    });
    let read: Vec<Result<(Frame, bool), FrameError>> = read.collect(); // so that the first error is always the same
    let read: Vec<(Frame, bool)> = read.into_iter().collect::<Result<_, _>>()?;
    let warnings = [warn_of_missing_depth(&read), warn_of_depth_as_pictures(&read)].into_iter().flatten().collect();
    Ok((read.into_iter().map(|(frame, _)| frame).collect(), warnings))
}

/// A frame and whether its picture is one channel of 16 bits.
fn frame_of(item: &Item, sensor: &Sensor) -> Result<(Frame, bool), FrameError> {
    let (picture, header) = match &item.origin {
        Origin::File(path) => {
            let header = read_header(path)?;
            (PictureSource::File { path: path.clone(), orientation: header.orientation }, header)
        }
        Origin::Film(source, (width, height)) => {
            let orientation = Orientation::default();
            (source.clone(), Header { width: *width, height: *height, orientation, grey16: false })
        }
    };
    let orientation = header.orientation;
    let (width, height) = orientation.shown_size(header.width, header.height);
    let depth = item.depth.as_ref().map(|path| sensor.depth(path, picture.path(), header)).transpose()?;
    Ok((Frame { name: item.name.clone(), width, height, picture, depth, camera: None }, header.grey16))
}

impl Sensor {
    /// A depth camera is given for something.
    pub fn check(&self, items: &[Item]) -> Result<(), FrameError> {
        if self.camera.is_some() && items.iter().all(|item| item.depth.is_none()) {
            let what = "a depth camera is given but no frame has depth; give the folder of depths (--depth)";
            return Err(FrameError::NotFound(what.into()));
        }
        Ok(())
    }

    /// A picture's depth, judged by its header.
    fn depth(&self, path: &Path, picture_path: &Path, picture: Header) -> Result<DepthSource, FrameError> {
        let depth = read_header(path)?;
        if !depth.grey16 {
            return Err(not_depth(path));
        }
        let invalid = |what: String| FrameError::Invalid { path: path.into(), what };
        let (size, of_picture) = ((depth.width, depth.height), (picture.width, picture.height));
        let camera = match &self.camera {
            Some(given) => {
                let mirrored = |error: GeometryError| FrameError::Invalid {
                    path: picture_path.into(),
                    what: format!("{error}; its depth has a camera, which cannot be mirrored"),
                };
                let turn = Turn::from_exif(picture.orientation.0).map_err(mirrored)?;
                Some(Box::new(given.for_depth(size, turn).map_err(invalid)?))
            }
            None if size == of_picture => None,
            None => {
                return Err(invalid(format!(
                    "depth of {} × {} pixels does not fit its picture {} of {} × {}; give the camera that measured it \
                     (--depth-intrinsics), or depth registered to the picture, pixel for pixel",
                    size.0,
                    size.1,
                    picture_path.display(),
                    of_picture.0,
                    of_picture.1
                )));
            }
        };
        Ok(DepthSource::Sensor { path: path.into(), unit: self.unit, orientation: picture.orientation, camera })
    }
}

fn warn_of_missing_depth(read: &[(Frame, bool)]) -> Option<String> {
    let without: Vec<&Frame> = read.iter().map(|(frame, _)| frame).filter(|frame| frame.depth.is_none()).collect();
    if without.is_empty() || without.len() == read.len() {
        return None;
    }
    Some(format!("{} of {} frames have no depth: {}", without.len(), read.len(), some_names(&without)))
}

fn warn_of_depth_as_pictures(read: &[(Frame, bool)]) -> Option<String> {
    let grey: Vec<&Frame> = read.iter().filter(|(_, grey16)| *grey16).map(|(frame, _)| frame).collect();
    if grey.is_empty() {
        return None;
    }
    let (count, names) = (grey.len(), some_names(&grey));
    Some(format!("{count} frames are grey pictures of 16 bits ({names}); if they are depth, give them with --depth"))
}

fn some_names(frames: &[&Frame]) -> String {
    let names: Vec<&str> = frames.iter().take(NAMED).map(|frame| frame.name.as_str()).collect();
    let more = if frames.len() > NAMED { ", …" } else { "" };
    format!("{}{more}", names.join(", "))
}
