use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::listing::{Item, Origin};
use crate::cameras::GivenDepthCamera;
use crate::decode::{float_white, not_depth, opaque_pixels};
use crate::error::{NAMED, first_of};
use crate::header::{Content, Header, check_complete, read_header};
use crate::{DepthSource, Frame, FrameError, ImageSource, Orientation};
use ostra_core::job::Progress;
use ostra_geometry::{GeometryError, QuarterRotation};

/// Images with float colours are decoded one at a time, because they are large.
static FLOAT_COLORS: Mutex<()> = Mutex::new(());

/// Properties of the depth of all sources.
pub(super) struct Sensor {
    /// World units per step of a stored integer.
    pub unit: f64,
    /// World units per unit of a stored float.
    pub float_unit: f64,
    /// Camera that measured the depth; `None` = that of the images.
    pub camera: Option<GivenDepthCamera>,
}

/// A frame and its read errors.
struct Read {
    frame: Frame,
    content: Content,
    has_float_depth: bool,
    /// Value of white, if the colours are floats.
    float_white: Option<f32>,
    /// Why the image cannot be read.
    ///
    /// The size is the real one only if the header could be read.
    problem: Option<FrameError>,
    has_size: bool,
    /// Why the depth cannot be read; the frame then has none.
    depth_problem: Option<FrameError>,
}

/// Creates frames of listed images from their headers, read in parallel; returns warnings, too.
///
/// If some images or depth maps can be read, the others are named in a warning. A damaged image
/// keeps its place among the frames.
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
    // All results are collected before the first error is taken, so that it is always the same one.
    let read: Vec<Result<Read, FrameError>> = read.collect();
    let mut read: Vec<Read> = read.into_iter().collect::<Result<_, _>>()?;
    if read.iter().all(|read| read.problem.is_some())
        && let Some(error) = read.iter_mut().find_map(|read| read.problem.take())
    {
        return Err(error);
    }
    let with_depth = |read: &Read| read.frame.depth.is_some();
    if !read.iter().any(with_depth)
        && let Some(error) = read.iter_mut().find_map(|read| read.depth_problem.take())
    {
        return Err(error);
    }
    give_sizes(&mut read);
    let warnings = [
        warn_of_problems(&read),
        warn_of_missing_depth(&read),
        warn_of_float_depth(&read, sensor),
        warn_of_depth_as_images(&read),
        warn_of_float_colors(&read),
        warn_of_alpha(&read),
    ];
    Ok((
        read.into_iter().map(|read| read.frame).collect(),
        warnings.into_iter().flatten().collect(),
    ))
}

/// Gives frames with unreadable headers the size of the frame before them.
///
/// The first ones get the size of the first frame with a readable header.
fn give_sizes(read: &mut [Read]) {
    let size_of = |read: &Read| {
        read.has_size
            .then_some((read.frame.width, read.frame.height))
    };
    let mut size = read.iter().find_map(size_of).unwrap_or((1, 1));
    for one in read {
        size = size_of(one).unwrap_or(size);
        (one.frame.width, one.frame.height) = size;
    }
}

fn frame_of(item: &Item, sensor: &Sensor) -> Result<Read, FrameError> {
    let mut float = None;
    let (image, header, problem) = match &item.origin {
        Origin::File(path) => {
            let (header, problem) = match read_header(path) {
                Ok(header) if header.is_only_depth() => (Some(header), Some(only_depth(path))),
                Ok(header) if header.content.is_float_color() => {
                    let _one = FLOAT_COLORS.lock().unwrap_or_else(PoisonError::into_inner);
                    let white = float_white(path);
                    float = white.as_ref().ok().copied();
                    (Some(header), white.err())
                }
                Ok(header) => (Some(header), check_complete(path).err()),
                Err(stopped @ FrameError::Stopped(_)) => return Err(stopped),
                Err(error) => (None, Some(error)),
            };
            let orientation = header.map_or_else(Orientation::default, |header| header.orientation);
            (
                ImageSource::File {
                    path: path.clone(),
                    orientation,
                },
                header,
                problem,
            )
        }
        Origin::Video(source, (width, height)) => {
            let orientation = Orientation::default();
            let header = Header {
                width: *width,
                height: *height,
                orientation,
                content: Content::Color,
            };
            (source.clone(), Some(header), None)
        }
    };
    let (mut depth_problem, mut depth, mut has_float_depth) = (None, None, false);
    // Depth of an image of unknown size cannot be checked.
    if let (Some(path), Some(header)) = (&item.depth, header) {
        match sensor.depth(path, image.path(), header) {
            Ok((source, is_float)) => (depth, has_float_depth) = (Some(source), is_float),
            Err(error) => depth_problem = Some(error),
        }
    }
    let has_size = header.is_some();
    let header = header.unwrap_or(Header {
        width: 1,
        height: 1,
        orientation: Orientation::default(),
        content: Content::Color,
    });
    let (width, height) = header.orientation.shown_size(header.width, header.height);
    let frame = Frame {
        name: item.name.clone(),
        width,
        height,
        image,
        depth,
        camera: None,
    };
    let content = header.content;
    Ok(Read {
        frame,
        content,
        has_float_depth,
        float_white: float,
        problem,
        has_size,
        depth_problem,
    })
}

fn only_depth(path: &Path) -> FrameError {
    let what = "one channel of floats or of large integers is depth, not an image; give it with --depth, or convert it \
                to grey of 8 or 16 bits";
    FrameError::Invalid {
        path: path.into(),
        what: what.into(),
    }
}

impl Sensor {
    /// Returns an error if a depth camera is given but no frame has depth.
    pub fn check(&self, items: &[Item]) -> Result<(), FrameError> {
        if self.camera.is_some() && items.iter().all(|item| item.depth.is_none()) {
            let what = "a depth camera is given but no frame has depth; give the folder of depths (--depth)";
            return Err(FrameError::NotFound(what.into()));
        }
        Ok(())
    }

    /// Returns an image's depth, judged by its header, and whether it has float values.
    fn depth(
        &self,
        path: &Path,
        image_path: &Path,
        image: Header,
    ) -> Result<(DepthSource, bool), FrameError> {
        let depth = read_header(path)?;
        if !depth.is_depth() {
            return Err(not_depth(path));
        }
        check_complete(path)?;
        let invalid = |what: String| FrameError::Invalid {
            path: path.into(),
            what,
        };
        let (size, of_image) = ((depth.width, depth.height), (image.width, image.height));
        let camera = match &self.camera {
            Some(given) => {
                let mirrored = |error: GeometryError| FrameError::Invalid {
                    path: image_path.into(),
                    what: format!("{error}; its depth has a camera, which cannot be mirrored"),
                };
                let turn = QuarterRotation::from_exif(image.orientation.0).map_err(mirrored)?;
                let camera = given.for_depth(depth.width, depth.height, turn);
                Some(Box::new(camera.map_err(invalid)?))
            }
            None if size == of_image => None,
            None => {
                return Err(invalid(format!(
                    "depth of {} × {} pixels does not fit its image {} of {} × {}; give the camera that measured it \
                     (--depth-intrinsics), or depth registered to the image, pixel for pixel",
                    size.0,
                    size.1,
                    image_path.display(),
                    of_image.0,
                    of_image.1
                )));
            }
        };
        let is_float = depth.content == Content::FloatDepth;
        let unit = if is_float { self.float_unit } else { self.unit };
        Ok((
            DepthSource::Sensor {
                path: path.into(),
                unit,
                orientation: image.orientation,
                camera,
            },
            is_float,
        ))
    }
}

fn warn_of_problems(read: &[Read]) -> Option<String> {
    let reasons = |problems: &[&FrameError]| first_of(problems.iter(), "; ");
    let images: Vec<&FrameError> = read
        .iter()
        .filter_map(|read| read.problem.as_ref())
        .collect();
    let depths: Vec<&FrameError> = read
        .iter()
        .filter_map(|read| read.depth_problem.as_ref())
        .collect();
    let images = (!images.is_empty()).then(|| {
        let (count, all) = (images.len(), read.len());
        let shown = if count == 1 {
            "is shown as a grey tile"
        } else {
            "are shown as grey tiles"
        };
        format!(
            "{count} of {all} images cannot be read and {shown}: {}",
            reasons(&images)
        )
    });
    let depths = (!depths.is_empty()).then(|| {
        format!(
            "{} depths cannot be used; their frames have none: {}",
            depths.len(),
            reasons(&depths)
        )
    });
    let lines: Vec<String> = images.into_iter().chain(depths).collect();
    (!lines.is_empty()).then(|| lines.join(". "))
}

fn warn_of_missing_depth(read: &[Read]) -> Option<String> {
    let without: Vec<&Frame> = read
        .iter()
        .map(|read| &read.frame)
        .filter(|frame| frame.depth.is_none())
        .collect();
    if without.is_empty() || without.len() == read.len() {
        return None;
    }
    Some(format!(
        "{} of {} frames have no depth: {}",
        without.len(),
        read.len(),
        some_names(&without)
    ))
}

fn warn_of_float_depth(read: &[Read], sensor: &Sensor) -> Option<String> {
    let count = read.iter().filter(|read| read.has_float_depth).count();
    (count > 0).then(|| {
        let unit = sensor.float_unit;
        format!("{count} depths are floats: one unit is taken for {unit} m; if that is wrong, give the depth unit (--depth-unit)")
    })
}

fn warn_of_depth_as_images(read: &[Read]) -> Option<String> {
    let grey = read
        .iter()
        .filter(|read| read.content == Content::Grey16)
        .map(|read| &read.frame);
    let grey: Vec<&Frame> = grey.collect();
    if grey.is_empty() {
        return None;
    }
    let (count, names) = (grey.len(), some_names(&grey));
    Some(format!(
        "{count} frames are grey images of 16 bits ({names}); if they are depth, give their folder as depth (--depth)"
    ))
}

fn warn_of_alpha(read: &[Read]) -> Option<String> {
    let alpha = read
        .iter()
        .filter(|read| read.content.has_alpha())
        .map(|read| &read.frame);
    let alpha: Vec<&Frame> = alpha.collect();
    // Many programs write an alpha channel into images that are opaque everywhere.
    let samples = [0, alpha.len() / 2, alpha.len().saturating_sub(1)];
    if !samples
        .into_iter()
        .filter_map(|at| alpha.get(at))
        .any(|frame| is_transparent(frame))
    {
        return None;
    }
    let (count, all, names) = (alpha.len(), read.len(), some_names(&alpha));
    Some(format!(
        "{count} of {all} images have an alpha channel: transparent pixels are shown in grey and give no features: {names}"
    ))
}

/// Returns whether an image has transparent pixels; one that cannot be decoded has none.
fn is_transparent(frame: &Frame) -> bool {
    match &frame.image {
        ImageSource::File { path, orientation } => {
            opaque_pixels(path, *orientation, &|_| Ok(())).is_ok_and(|opaque| opaque.is_some())
        }
        ImageSource::Video { .. } => false,
    }
}

fn warn_of_float_colors(read: &[Read]) -> Option<String> {
    let divided: Vec<(&Frame, f32)> = read
        .iter()
        .filter_map(|read| Some((&read.frame, read.float_white.filter(|&white| white > 1.0)?)))
        .collect();
    if divided.is_empty() {
        return None;
    }
    let names = first_of(
        divided
            .iter()
            .map(|(frame, white)| format!("{} by {white}", frame.name)),
        ", ",
    );
    let count = divided.len();
    Some(format!(
        "the colours of {count} images are floats beyond 1 and are divided: {names}; if that is wrong, convert the images \
         to PNG"
    ))
}

fn some_names(frames: &[&Frame]) -> String {
    let names: Vec<&str> = frames
        .iter()
        .take(NAMED)
        .map(|frame| frame.name.as_str())
        .collect();
    let more = if frames.len() > NAMED { ", …" } else { "" };
    format!("{}{more}", names.join(", "))
}
