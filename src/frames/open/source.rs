//! One source given by the user: its items, and the RGB-D recordings recognised in a folder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::headers::Sensor;
use super::listing::{
    IMAGE_ENDINGS, Item, Listed, Origin, has_image_ending, list_images, natural_order, text_of,
    unsupported_image, without_depth,
};
use super::pairing::{pair, says_depth, warn_of_tum_unit, with_depth, without_role};
use super::request::FrameFolder;
use crate::header::{FileKind, kind_of_file, read_header};
use crate::name_parts::without_ending;
use crate::video::{Probed, probe};
use crate::{FrameError, ImageSource};
use ostra_core::job::Progress;

/// The images of one source, in order.
#[derive(Debug)]
pub(super) struct FrameSource {
    /// Path whose last parts prefix names when there are several sources.
    pub place: PathBuf,
    /// Kind of the source.
    pub kind: SourceKind,
    /// Images, at least one.
    pub items: Vec<Item>,
}

/// Kind of a path given as frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SourceKind {
    Folder,
    Image,
    Video,
}

/// Inputs of listing besides the source, and its reports.
pub(super) struct Listing<'a> {
    pub sensor: &'a Sensor,
    /// Whether depth that is found among the images is left out.
    pub ignore_depth: bool,
    pub progress: &'a Progress,
    pub warnings: Vec<String>,
}

impl Listing<'_> {
    /// Lists one source and pairs its depth.
    pub fn list(&mut self, given: &FrameFolder) -> Result<FrameSource, FrameError> {
        let place = located(&given.frames)?;
        let kind = kind_of(&place)?;
        let depth = given.depth.as_deref().map(located).transpose()?;
        let items = match (kind, depth) {
            (SourceKind::Video, depth) => self.video(&place, depth.as_deref())?,
            (SourceKind::Image, None) => vec![without_depth(one_file(&place))],
            (SourceKind::Folder, None) => {
                let listed = self.images_in(&place)?;
                recognise(&place, listed, self)?
            }
            (_, Some(depth)) => self.with_given_depth(&place, &depth)?,
        };
        Ok(FrameSource { place, kind, items })
    }

    fn with_given_depth(&mut self, place: &Path, depth: &Path) -> Result<Vec<Item>, FrameError> {
        let mut images = self.images_at(place)?;
        let mut depths = if depth == place {
            Vec::new()
        } else {
            self.images_at(depth)?
        };
        if depth == place {
            (images, depths) = split_by_name(images);
        } else if depth.starts_with(place) {
            images = next_to_depth(images, depth);
        }
        let items = images.into_iter().map(without_depth).collect();
        self.paired(items, &depths, [place, depth])
    }

    fn video(&mut self, video: &Path, depth: Option<&Path>) -> Result<Vec<Item>, FrameError> {
        let probed = probe(video, self.progress)?;
        if let Some(damage) = &probed.damage {
            let count = probed.times_s.len();
            self.warnings.push(format!(
                "{}: damaged ({damage}); {count} images can be read",
                video.display()
            ));
        }
        let items = video_items(video, &probed);
        match depth {
            Some(depth) => {
                let depths = self.images_at(depth)?;
                self.paired(items, &depths, [video, depth])
            }
            None => Ok(items),
        }
    }

    fn images_at(&mut self, place: &Path) -> Result<Vec<Listed>, FrameError> {
        if place.is_dir() {
            self.images_in(place)
        } else {
            Ok(vec![one_file(place)])
        }
    }

    fn images_in(&mut self, place: &Path) -> Result<Vec<Listed>, FrameError> {
        let found = list_images(place)?;
        if found.images.is_empty() {
            let left_out = found.left_out();
            return Err(FrameError::NotFound(format!(
                "{}: no images in this folder or below it (looked for names ending in {}); give a folder of images, \
                 or a video by its own path{left_out}",
                place.display(),
                IMAGE_ENDINGS.join(", ")
            )));
        }
        self.warnings.extend(found.warnings(place));
        Ok(found.images)
    }

    /// Pairs images with the depth given by the user; it is an error if none matches.
    fn paired(
        &mut self,
        items: Vec<Item>,
        depths: &[Listed],
        places: [&Path; 2],
    ) -> Result<Vec<Item>, FrameError> {
        let names: Vec<Listed> = items.iter().map(Item::listed).collect();
        let pairs = pair(&names, depths, &places, &mut self.warnings)?;
        if pairs.count() == 0 {
            let [place, depth] = places.map(Path::display);
            return Err(FrameError::NotFound(format!(
                "{depth}: no depth image fits a frame of {place}, by name, number or time; check that the two belong \
                 together"
            )));
        }
        self.warnings
            .extend(warn_of_tum_unit(&names, self.sensor.unit));
        Ok(with_depth(items, depths, &pairs))
    }
}

fn video_items(video: &Path, probed: &Probed) -> Vec<Item> {
    let item = |(index, &time_s): (u64, &f64)| {
        let source = ImageSource::Video {
            path: video.into(),
            index,
            time_s,
        };
        Item {
            name: format!("{index:06}"),
            origin: Origin::Video(source, (probed.width, probed.height)),
            depth: None,
        }
    };
    (0..).zip(&probed.times_s).map(item).collect()
}

/// Returns the prefix of names of a source's frames: for a video its name without extension.
pub(super) fn stem(source: &FrameSource) -> PathBuf {
    match (source.kind, source.place.to_str()) {
        (SourceKind::Video, Some(place)) => without_ending(place).into(),
        _ => source.place.clone(),
    }
}

fn kind_of(place: &Path) -> Result<SourceKind, FrameError> {
    if place.is_dir() {
        return Ok(SourceKind::Folder);
    }
    if has_image_ending(place) {
        return Ok(SourceKind::Image);
    }
    // The content decides if it is clear. Raw files of cameras begin like TIFF.
    match (kind_of_file(place)?, unsupported_image(place)) {
        (FileKind::Image, _) | (FileKind::Tiff, None) => Ok(SourceKind::Image),
        (_, Some(error)) | (FileKind::Heif(error), None) => Err(error),
        (FileKind::Other, None) => Ok(SourceKind::Video),
    }
}

/// Returns the absolute path of a source, keeping its own last name even if that is a link.
fn located(given: &Path) -> Result<PathBuf, FrameError> {
    if !given.exists() {
        return Err(FrameError::NotFound(format!(
            "{}: no such file or folder; check the path",
            given.display()
        )));
    }
    let io = |source| FrameError::io(given, source);
    let whole = std::path::absolute(given).map_err(io)?;
    let path = match (whole.parent(), whole.file_name()) {
        (Some(parent), Some(name)) => parent.canonicalize().map_err(io)?.join(name),
        _ => whole.canonicalize().map_err(io)?,
    };
    text_of(&path)?;
    Ok(path)
}

fn one_file(path: &Path) -> Listed {
    Listed {
        name: String::new(),
        path: path.into(),
    }
}

/// Folder names of the colour images of an RGB-D recording, most likely first.
pub(super) const COLOR_FOLDERS: [&str; 5] = ["color", "colour", "rgb", "image", "images"];

/// Folder names of its depth images.
pub(super) const DEPTH_FOLDERS: [&str; 2] = ["depth", "depths"];

/// One RGB-D recording among the listed images.
///
/// It is a folder with one folder of colour and one of depth, or the remaining files, distinguished
/// by file names.
#[derive(Debug, Default)]
struct Recording {
    place: PathBuf,
    images: Vec<Listed>,
    depths: Vec<Listed>,
    left_out: usize,
}

/// Finds the RGB-D recordings in a folder given without depth, and adds a warning.
///
/// Colour and depth are in `color/` and `depth/`, or in `*.color.png` and `*.depth.png`. This
/// prevents depth from being used as images.
fn recognise(
    place: &Path,
    listed: Vec<Listed>,
    listing: &mut Listing,
) -> Result<Vec<Item>, FrameError> {
    let mut items = Vec::new();
    for recording in recordings(place, listed) {
        items.extend(recording.items(listing)?);
    }
    items.sort_by(|a, b| natural_order(&a.name, &b.name));
    Ok(items)
}

/// Splits images into colour and depth by words in file names.
///
/// All are colour unless a depth name matches a colour name.
fn split_by_name(listed: Vec<Listed>) -> (Vec<Listed>, Vec<Listed>) {
    let (depths, images): (Vec<_>, Vec<_>) =
        listed.into_iter().partition(|file| says_depth(&file.name));
    let key = |file: &Listed| without_role(without_ending(&file.name));
    let keys: BTreeSet<String> = images.iter().map(key).collect();
    if depths.iter().any(|depth| keys.contains(&key(depth))) {
        return (images, depths);
    }
    let mut all = [images, depths].concat();
    all.sort_by(|a, b| natural_order(&a.name, &b.name));
    (all, Vec::new())
}

/// Returns the images that belong to a depth folder among them.
///
/// These are the images of the colour folder next to it, if there is one.
fn next_to_depth(mut images: Vec<Listed>, depth: &Path) -> Vec<Listed> {
    images.retain(|image| !image.path.starts_with(depth));
    let adjacent = COLOR_FOLDERS.iter().map(|name| depth.with_file_name(name));
    let color = adjacent
        .into_iter()
        .find(|color| images.iter().any(|image| image.path.starts_with(color)));
    if let Some(color) = color {
        images.retain(|image| image.path.starts_with(&color));
    }
    images
}

fn recordings(place: &Path, listed: Vec<Listed>) -> Vec<Recording> {
    let roles = role_folders(&listed);
    let mut found = BTreeMap::<String, Recording>::new();
    let mut rest = Vec::new();
    for file in listed {
        let Some((folder, (color, depth))) = roles
            .iter()
            .find(|(folder, _)| is_below(&file.name, folder))
        else {
            rest.push(file);
            continue;
        };
        let recording = found.entry(folder.clone()).or_insert_with(|| Recording {
            place: if folder.is_empty() {
                place.into()
            } else {
                place.join(folder)
            },
            ..Recording::default()
        });
        if is_below(&file.name, color) {
            recording.images.push(file);
        } else if is_below(&file.name, depth) {
            recording.depths.push(file);
        } else {
            recording.left_out += 1;
        }
    }
    let (images, depths) = split_by_name(rest);
    let rest = Recording {
        place: place.into(),
        images,
        depths,
        left_out: 0,
    };
    found.into_values().chain([rest]).collect()
}

/// Returns the folders with a folder of colour and one of depth, as folder → (colour, depth).
///
/// All paths are below the source.
fn role_folders(listed: &[Listed]) -> BTreeMap<String, (String, String)> {
    let mut children = BTreeMap::<&str, BTreeSet<&str>>::new();
    for file in listed {
        let mut path = file.name.as_str();
        while let Some(slash) = path.rfind('/') {
            path = &path[..slash];
            let (parent, child) = path.rsplit_once('/').unwrap_or(("", path));
            children.entry(parent).or_default().insert(child);
        }
    }
    let both = children.into_iter().filter_map(|(parent, children)| {
        let named = |names: &[&str]| {
            let find = |name| {
                children
                    .iter()
                    .find(|child| child.eq_ignore_ascii_case(name))
            };
            let child = names.iter().copied().find_map(find)?;
            Some(if parent.is_empty() {
                (*child).to_owned()
            } else {
                format!("{parent}/{child}")
            })
        };
        Some((
            parent.to_owned(),
            (named(&COLOR_FOLDERS)?, named(&DEPTH_FOLDERS)?),
        ))
    });
    both.collect()
}

fn is_below(name: &str, folder: &str) -> bool {
    folder.is_empty()
        || name
            .strip_prefix(folder)
            .is_some_and(|rest| rest.starts_with('/'))
}

impl Recording {
    fn items(self, listing: &mut Listing) -> Result<Vec<Item>, FrameError> {
        let items: Vec<Item> = self.images.iter().cloned().map(without_depth).collect();
        if self.depths.is_empty() || listing.ignore_depth {
            return Ok(items);
        }
        let pairs = pair(
            &self.images,
            &self.depths,
            &[&self.place],
            &mut listing.warnings,
        )?;
        let with = with_depth(items, &self.depths, &pairs);
        let (place, count) = (self.place.display(), with.len());
        if let Some(why) = why_unfit(&with, listing.sensor) {
            listing.warnings.push(format!(
                "{place}: looks like an RGB-D recording but is opened without depth: {why}"
            ));
            return Ok(with
                .into_iter()
                .map(|item| Item {
                    depth: None,
                    ..item
                })
                .collect());
        }
        let left_out = match self.left_out {
            0 => String::new(),
            other => format!(", {other} other images in it are left out"),
        };
        let paired = pairs.count();
        listing.warnings.push(format!(
            "{place}: recognised as an RGB-D recording: {paired} of {count} images have depth{left_out}. Not right? Give the \
             folders of images and depth (--frames and --depth)"
        ));
        listing
            .warnings
            .extend(warn_of_tum_unit(&self.images, listing.sensor.unit));
        Ok(with)
    }
}

/// Returns why depth that was not requested cannot be used, judged by the first pair.
fn why_unfit(items: &[Item], sensor: &Sensor) -> Option<String> {
    let Some((image, depth)) = items.iter().find_map(Item::files_with_depth) else {
        return Some("no depth image fits a colour image by name, number or time".into());
    };
    let (Ok(image), Ok(depth)) = (read_header(image), read_header(depth)) else {
        return None;
    };
    if !depth.is_depth() {
        return Some("its depth images are not grey images of 16 bits or of floats".into());
    }
    let sizes = ((image.width, image.height), (depth.width, depth.height));
    (sizes.0 != sizes.1 && sensor.camera.is_none()).then(|| {
        let ((w, h), (depth_w, depth_h)) = sizes;
        format!("depth of {depth_w} × {depth_h} pixels does not fit images of {w} × {h} (--depth-intrinsics)")
    })
}
