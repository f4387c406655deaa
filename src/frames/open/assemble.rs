//! Opening of a request: named frames in project order.

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};

use super::headers::{Sensor, read_frames};
use super::listing::Item;
use super::request::{OpenRequest, Opened};
use super::source::{FrameSource, Listing, SourceKind, stem};
use crate::cameras::DepthCameraSource;
use crate::{Frame, FrameError};
use ostra_core::job::Progress;

/// Opens the frames of a request.
///
/// The sources are listed and paired with depth, headers are read in parallel, and frames get
/// names.
///
/// # Errors
///
/// [`FrameError`] if:
///
/// - a source is missing or empty,
/// - no image or no depth can be read (if some can, warnings name the others),
/// - no depth matches,
/// - `every`, `from` and `to` leave no frame,
/// - the user stopped it.
pub fn open(request: &OpenRequest, progress: &Progress) -> Result<Opened, FrameError> {
    open_more(&[], request, progress)
}

/// Opens frames that are added to `existing` ones; returns only the new frames.
///
/// Images that are already there are skipped. Names that are taken get more of the path's last
/// parts in front. Otherwise this is [`open`].
///
/// # Errors
///
/// As [`open`], and if there is no new image.
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
        ignore_depth: request.ignore_depth,
        progress,
        warnings: Vec::new(),
    };
    let sources = request
        .sources
        .iter()
        .map(|source| listing.list(source))
        .collect::<Result<Vec<_>, _>>()?;
    let places = NamePrefixes::of(&sources);
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
            "no frames are given; name a folder of images, an image or a video".into(),
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
        let what =
            format!("the depth unit must be above 0, got {unit}; give metres per step, e.g. 0.001");
        return Err(FrameError::NotFound(what));
    }
    Ok(())
}

/// Returns the items that `every`, `from` and `to` select, each with the number of its source.
fn thinned(
    sources: Vec<FrameSource>,
    request: &OpenRequest,
) -> Result<Vec<(usize, Item)>, FrameError> {
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

/// Drops items that already are frames, or appear twice because one source contains another.
fn new_items(
    existing: &[Frame],
    items: Vec<(usize, Item)>,
    warnings: &mut Vec<String>,
) -> Result<Vec<(usize, Item)>, FrameError> {
    let mut seen: BTreeSet<(PathBuf, u64)> = existing
        .iter()
        .map(|frame| frame.image.identity())
        .collect();
    let count = items.len();
    let new: Vec<_> = items
        .into_iter()
        .filter(|(_, item)| seen.insert(item.identity()))
        .collect();
    if new.is_empty() {
        return Err(FrameError::NotFound(format!(
            "all {count} images are frames already; give other images"
        )));
    }
    if new.len() < count {
        warnings.push(format!(
            "{} of {count} images are frames already and are left out",
            count - new.len()
        ));
    }
    Ok(new)
}

/// Path parts that prefix the names of each source's frames.
struct NamePrefixes {
    stems: Vec<PathBuf>,
    whole: Vec<PathBuf>,
    at_least: usize,
}

impl NamePrefixes {
    fn of(sources: &[FrameSource]) -> Self {
        let alone = matches!(
            sources,
            [FrameSource {
                kind: SourceKind::Folder,
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

/// Returns the names of frames given as (number of its source, name below it).
///
/// Names are prefixed by the last parts of their source's path. The number of parts is at least
/// `at_least`, and as many as make the sources differ and no name one that is `taken`.
///
/// # Errors
///
/// [`FrameError::NotFound`] if the same source is given twice or the whole path is not enough.
fn name_frames(
    items: &[(usize, &str)],
    sources: &[&Path],
    at_least: usize,
    taken: &BTreeSet<&str>,
) -> Result<Vec<String>, FrameError> {
    let parts: Vec<Vec<String>> = sources.iter().map(|path| parts_of(path)).collect();
    let mut seen = BTreeSet::new();
    if let Some(twice) = sources
        .iter()
        .zip(&parts)
        .find(|(_, parts)| !seen.insert(*parts))
        .map(|(path, _)| path)
    {
        let what = format!(
            "{} is given twice; give each folder, image and video once",
            twice.display()
        );
        return Err(FrameError::NotFound(what));
    }
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    for count in at_least..=longest.max(at_least) {
        let prefixes: Vec<String> = parts
            .iter()
            .map(|parts| parts[parts.len().saturating_sub(count)..].join("/"))
            .collect();
        if prefixes.iter().collect::<BTreeSet<_>>().len() < prefixes.len() {
            continue;
        }
        let names: Vec<String> = items
            .iter()
            .map(|(source, name)| joined(&prefixes[*source], name))
            .collect();
        let unique = names.iter().collect::<BTreeSet<_>>().len() == names.len();
        if unique && !names.iter().any(|name| taken.contains(name.as_str())) {
            return Ok(names);
        }
    }
    Err(FrameError::NotFound(
        "the new frames have the same names as those in the project; rename their folder".into(),
    ))
}

fn joined(prefix: &str, name: &str) -> String {
    [prefix, name]
        .into_iter()
        .filter(|part| !part.is_empty())
        .collect::<Vec<_>>()
        .join("/")
}

fn parts_of(path: &Path) -> Vec<String> {
    let normal = path.components().filter_map(|part| match part {
        Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
        _ => None,
    });
    normal.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn named(sources: &[&str], at_least: usize, taken: &[&str]) -> Result<Vec<String>, String> {
        let sources: Vec<&Path> = sources.iter().map(Path::new).collect();
        let items: Vec<(usize, &str)> =
            (0..sources.len()).map(|source| (source, "1.png")).collect();
        let taken = taken.iter().copied().collect();
        name_frames(&items, &sources, at_least, &taken).map_err(|error| error.to_string())
    }

    #[test]
    fn one_folder_needs_no_prefix() {
        assert_eq!(named(&["/data/run1/color"], 0, &[]).unwrap(), ["1.png"]);
        assert_eq!(named(&["/data/film"], 1, &[]).unwrap(), ["film/1.png"]);
    }

    #[test]
    fn several_folders_take_as_many_parts_as_make_them_differ() {
        assert_eq!(
            named(&["/data/run1", "/data/run2"], 1, &[]).unwrap(),
            ["run1/1.png", "run2/1.png"]
        );
        assert_eq!(
            named(&["/a/run1/color", "/a/run2/color"], 1, &[]).unwrap(),
            ["run1/color/1.png", "run2/color/1.png"]
        );
        assert_eq!(
            named(&["/a/color", "/x/a/color"], 1, &[]).unwrap(),
            ["a/color/1.png", "x/a/color/1.png"]
        );
    }

    #[test]
    fn taken_names_are_avoided() {
        assert_eq!(named(&["/b/color"], 0, &["2.png"]).unwrap(), ["1.png"]);
        assert_eq!(
            named(&["/b/color"], 0, &["1.png", "color/1.png"]).unwrap(),
            ["b/color/1.png"]
        );
        assert!(
            named(&["/b"], 0, &["1.png", "b/1.png"])
                .unwrap_err()
                .contains("rename")
        );
    }

    #[test]
    fn same_folder_twice_is_an_error() {
        assert!(
            named(&["/data/run1", "/data/run1"], 1, &[])
                .unwrap_err()
                .contains("/data/run1 is given twice")
        );
    }
}
