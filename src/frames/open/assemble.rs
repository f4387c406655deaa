use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::naming::prefixes;
use super::request::{OpenRequest, Opened};
use super::source::{Item, Kind, Listing, Origin, Source, stem};
use crate::engine::job::Progress;
use crate::frames::decode::not_depth;
use crate::frames::header::{Header, read_header};
use crate::frames::{DepthSource, Frame, FrameError, Orientation, PictureSource};

/// How many frames a warning names.
const NAMED: usize = 3;

/// Lists the sources, pairs depth, reads the headers (in parallel) and names the frames.
///
/// # Errors
/// [`FrameError`] when a source is missing or empty, a header is damaged, no depth fits or a depth has another size
/// than its picture, no frame is left by `every`, `from` and `to`, or the user stopped it.
pub fn open(request: &OpenRequest, progress: &Progress) -> Result<Opened, FrameError> {
    check(request)?;
    progress.stage("open")?;
    let mut listing = Listing { depth_unit: request.depth_unit, progress, warnings: Vec::new() };
    let sources = request.sources.iter().map(|source| listing.list(source)).collect::<Result<_, _>>()?;
    let items = thinned(named_items(sources)?, request)?;
    let done = AtomicUsize::new(0);
    let read = items.par_iter().map(|item| {
        progress.step(done.fetch_add(1, Ordering::Relaxed), items.len())?;
        frame_of(item, request.depth_unit)
    });
    let read: Vec<Result<(Frame, bool), FrameError>> = read.collect();
    let read: Vec<(Frame, bool)> = read.into_iter().collect::<Result<_, _>>()?;
    let mut warnings = listing.warnings;
    warnings.extend(warn_of_missing_depth(&read));
    warnings.extend(warn_of_depth_as_pictures(&read));
    Ok(Opened { frames: read.into_iter().map(|(frame, _)| frame).collect(), warnings })
}

fn check(request: &OpenRequest) -> Result<(), FrameError> {
    if request.sources.is_empty() {
        return Err(FrameError::NotFound("no frames are given; name a folder of pictures, a picture or a film".into()));
    }
    if request.every == 0 {
        return Err(FrameError::NotFound("every 0th frame is none; give 1 or more".into()));
    }
    if !(request.depth_unit.is_finite() && request.depth_unit > 0.0) {
        let unit = request.depth_unit;
        return Err(FrameError::NotFound(format!(
            "a depth unit of {unit} cannot be; give metres per step, e.g. 0.001"
        )));
    }
    Ok(())
}

/// The items of all sources, with their names in the project.
fn named_items(sources: Vec<Source>) -> Result<Vec<Item>, FrameError> {
    let alone = matches!(sources.as_slice(), [Source { kind: Kind::Folder, .. }]);
    let stems: Vec<PathBuf> = sources.iter().map(stem).collect();
    let (stems, places): (Vec<&Path>, Vec<&Path>) =
        stems.iter().zip(&sources).map(|(stem, source)| (stem.as_path(), source.place.as_path())).unzip();
    let prefixes = prefixes(&stems, usize::from(!alone)).or_else(|_| prefixes(&places, 1))?;
    let mut items = Vec::new();
    for (source, prefix) in sources.into_iter().zip(prefixes) {
        items.extend(source.items.into_iter().map(|item| {
            let parts = [prefix.as_str(), item.name.as_str()];
            let name = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("/");
            Item { name, ..item }
        }));
    }
    Ok(items)
}

fn thinned(items: Vec<Item>, request: &OpenRequest) -> Result<Vec<Item>, FrameError> {
    let count = items.len();
    let (from, to) = (request.from.unwrap_or(0), request.to.unwrap_or(usize::MAX));
    let kept = items.into_iter().enumerate().skip(from).take_while(|(index, _)| *index <= to);
    let kept: Vec<Item> = kept.step_by(request.every).map(|(_, item)| item).collect();
    if kept.is_empty() {
        let to = request.to.map_or_else(|| "the end".into(), |to| to.to_string());
        return Err(FrameError::NotFound(format!(
            "no frame from {from} to {to}: there are {count}, numbered from 0; give other numbers"
        )));
    }
    Ok(kept)
}

/// A frame and whether its picture is one channel of 16 bits.
fn frame_of(item: &Item, depth_unit: f64) -> Result<(Frame, bool), FrameError> {
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
    let depth = item.depth.as_ref().map(|path| {
        check_depth(path, picture.path(), header)?;
        Ok::<_, FrameError>(DepthSource { path: path.clone(), unit: depth_unit, orientation })
    });
    let depth = depth.transpose()?;
    Ok((Frame { name: item.name.clone(), width, height, picture, depth, camera: None }, header.grey16))
}

fn check_depth(path: &Path, picture_path: &Path, picture: Header) -> Result<(), FrameError> {
    let depth = read_header(path)?;
    if !depth.grey16 {
        return Err(not_depth(path));
    }
    if (depth.width, depth.height) == (picture.width, picture.height) {
        return Ok(());
    }
    let what = format!(
        "depth of {} × {} pixels does not fit its picture {} of {} × {}; give depth registered to the colour camera, \
         pixel for pixel",
        depth.width,
        depth.height,
        picture_path.display(),
        picture.width,
        picture.height
    );
    Err(FrameError::Invalid { path: path.into(), what })
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
