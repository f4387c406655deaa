use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::headers::{Sensor, read_frames};
use super::naming::name_frames;
use super::request::{OpenRequest, Opened};
use super::source::{Item, Kind, Listing, Source, stem};
use crate::cameras::DepthCameraSource;
use crate::{Frame, FrameError};
use ostra_core::job::Progress;

/// Lists the sources, pairs depth, reads the headers (in parallel) and names the frames.
///
/// # Errors
/// [`FrameError`] when a source is missing or empty, no image or no depth can be read (where some can, the others are named
/// in warnings), no depth fits, no frame is left by `every`, `from` and `to`, or the user stopped it.
pub fn open(request: &OpenRequest, progress: &Progress) -> Result<Opened, FrameError> {
    open_more(&[], request, progress)
}

/// As [`open`], for frames that join `existing` ones: pictures that are there already are left out, and names that are
/// taken get more of the path's last parts in front. Only the new frames are returned.
///
/// # Errors
/// As [`open`], and when there is no new picture.
pub fn open_more(
    existing: &[Frame],
    request: &OpenRequest,
    progress: &Progress,
) -> Result<Opened, FrameError> {
    check(request)?;
    progress.stage("open")?;
    let sensor = Sensor {
        unit: request.depth_unit,
        float_unit: request.float_depth_unit,
        camera: request
            .depth_camera
            .as_ref()
            .map(DepthCameraSource::read)
            .transpose()?,
    };
    let mut listing = Listing {
        sensor: &sensor,
        progress,
        warnings: Vec::new(),
    };
    let sources = request
        .sources
        .iter()
        .map(|source| listing.list(source))
        .collect::<Result<Vec<_>, _>>()?;
    let places = Places::of(&sources);
    let items = new_items(existing, thinned(sources, request)?, &mut listing.warnings)?;
    let items = places.name(items, existing)?;
    sensor.check(&items)?;
    let (frames, warnings) = read_frames(&items, &sensor, progress)?;
    Ok(Opened {
        frames,
        warnings: [listing.warnings, warnings].concat(),
    })
}

fn check(request: &OpenRequest) -> Result<(), FrameError> {
    if request.sources.is_empty() {
        return Err(FrameError::NotFound(
            "no frames are given; name a folder of pictures, a picture or a film".into(),
        ));
    }
    if request.every == 0 {
        return Err(FrameError::NotFound(
            "the step between frames must be 1 or more".into(),
        ));
    }
    let units = [request.depth_unit, request.float_depth_unit];
    if let Some(unit) = units
        .into_iter()
        .find(|unit| !(unit.is_finite() && *unit > 0.0))
    {
        let what = format!("a depth unit of {unit} cannot be; give metres per step, e.g. 0.001");
        return Err(FrameError::NotFound(what));
    }
    Ok(())
}

/// The items that `every`, `from` and `to` leave, each with the number of its source.
fn thinned(sources: Vec<Source>, request: &OpenRequest) -> Result<Vec<(usize, Item)>, FrameError> {
    let count: usize = sources.iter().map(|source| source.items.len()).sum();
    let (from, to) = (request.from.unwrap_or(0), request.to.unwrap_or(usize::MAX));
    let all = sources
        .into_iter()
        .enumerate()
        .flat_map(|(at, source)| source.items.into_iter().map(move |i| (at, i)));
    let kept = all
        .enumerate()
        .skip(from)
        .take_while(|(index, _)| *index <= to);
    let kept: Vec<(usize, Item)> = kept.step_by(request.every).map(|(_, item)| item).collect();
    if kept.is_empty() {
        let to = request
            .to
            .map_or_else(|| "the end".into(), |to| to.to_string());
        return Err(FrameError::NotFound(format!(
            "no frame from {from} to {to}: there are {count}, numbered from 0; give other numbers"
        )));
    }
    Ok(kept)
}

/// Leaves out what is a frame already, or comes twice because one source lies in another.
fn new_items(
    existing: &[Frame],
    items: Vec<(usize, Item)>,
    warnings: &mut Vec<String>,
) -> Result<Vec<(usize, Item)>, FrameError> {
    let mut seen: BTreeSet<(PathBuf, u64)> = existing
        .iter()
        .map(|frame| frame.picture.identity())
        .collect();
    let count = items.len();
    let new: Vec<_> = items
        .into_iter()
        .filter(|(_, item)| seen.insert(item.identity()))
        .collect();
    if new.is_empty() {
        return Err(FrameError::NotFound(format!(
            "all {count} pictures are frames already; give other pictures"
        )));
    }
    if new.len() < count {
        warnings.push(format!(
            "{} of {count} pictures are frames already and are left out",
            count - new.len()
        ));
    }
    Ok(new)
}

/// What goes before the names of each source's frames.
struct Places {
    stems: Vec<PathBuf>,
    whole: Vec<PathBuf>,
    at_least: usize,
}

impl Places {
    fn of(sources: &[Source]) -> Self {
        let alone = matches!(
            sources,
            [Source {
                kind: Kind::Folder,
                ..
            }]
        );
        let stems = sources.iter().map(stem).collect();
        Self {
            stems,
            whole: sources.iter().map(|s| s.place.clone()).collect(),
            at_least: usize::from(!alone),
        }
    }

    fn name(&self, items: Vec<(usize, Item)>, existing: &[Frame]) -> Result<Vec<Item>, FrameError> {
        let taken: BTreeSet<&str> = existing.iter().map(|frame| frame.name.as_str()).collect();
        let own: Vec<(usize, &str)> = items
            .iter()
            .map(|(at, item)| (*at, item.name.as_str()))
            .collect();
        let name = |places: &[PathBuf]| {
            let places: Vec<&Path> = places.iter().map(PathBuf::as_path).collect();
            name_frames(&own, &places, self.at_least, &taken)
        };
        let names = name(&self.stems).or_else(|_| name(&self.whole))?;
        Ok(items
            .into_iter()
            .zip(names)
            .map(|((_, item), name)| Item { name, ..item })
            .collect())
    }
}
