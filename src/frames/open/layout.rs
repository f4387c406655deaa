use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::depth::{pair, warn_of_tum_unit, with_depth};
use super::headers::Sensor;
use super::listing::Listed;
use super::natural::natural_order;
use super::pairing::{says_depth, without_ending, without_role};
use super::source::{Item, Listing, without_depth};
use crate::FrameError;
use crate::header::read_header;

/// Names of folders that hold the colour pictures of an RGB-D recording, the likeliest first.
const COLOR_FOLDERS: [&str; 5] = ["color", "colour", "rgb", "image", "images"];

/// Names of folders that hold its depth pictures.
const DEPTH_FOLDERS: [&str; 2] = ["depth", "depths"];

/// One RGB-D recording among the listed pictures: a folder with a folder of colour and one of depth, or the rest,
/// told apart by file names.
#[derive(Debug, Default)]
struct Recording {
    place: PathBuf,
    pictures: Vec<Listed>,
    depths: Vec<Listed>,
    left_out: usize,
}

/// Finds the RGB-D recordings in a folder given without depth (`color/` beside `depth/`, or `*.color.png` beside
/// `*.depth.png`), so that depth is never taken for pictures, and says so in a warning.
pub(super) fn recognise(
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

/// Tells colour from depth by the words in file names; depth is what says so and has a colour picture beside it.
pub(super) fn split_by_name(listed: Vec<Listed>) -> (Vec<Listed>, Vec<Listed>) {
    let (depths, pictures): (Vec<_>, Vec<_>) =
        listed.into_iter().partition(|file| says_depth(&file.name));
    let key = |file: &Listed| without_role(without_ending(&file.name));
    let keys: BTreeSet<String> = pictures.iter().map(key).collect();
    if depths.iter().any(|depth| keys.contains(&key(depth))) {
        return (pictures, depths);
    }
    let mut all = [pictures, depths].concat();
    all.sort_by(|a, b| natural_order(&a.name, &b.name));
    (all, Vec::new())
}

/// The pictures that belong to a depth folder among them: those of the folder of colour beside it, if there is one.
pub(super) fn beside_depth(mut pictures: Vec<Listed>, depth: &Path) -> Vec<Listed> {
    pictures.retain(|picture| !picture.path.starts_with(depth));
    let beside = COLOR_FOLDERS.iter().map(|name| depth.with_file_name(name));
    let color = beside.into_iter().find(|color| {
        pictures
            .iter()
            .any(|picture| picture.path.starts_with(color))
    });
    if let Some(color) = color {
        pictures.retain(|picture| picture.path.starts_with(&color));
    }
    pictures
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
            recording.pictures.push(file);
        } else if is_below(&file.name, depth) {
            recording.depths.push(file);
        } else {
            recording.left_out += 1;
        }
    }
    let (pictures, depths) = split_by_name(rest);
    let rest = Recording {
        place: place.into(),
        pictures,
        depths,
        left_out: 0,
    };
    found.into_values().chain([rest]).collect()
}

/// Folders that have a folder of colour and one of depth: folder → (colour, depth), all below the source.
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
        let items: Vec<Item> = self.pictures.iter().cloned().map(without_depth).collect();
        if self.depths.is_empty() {
            return Ok(items);
        }
        let pairs = pair(
            &self.pictures,
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
            other => format!(", {other} other pictures in it are left out"),
        };
        let paired = pairs.count();
        listing.warnings.push(format!(
            "{place}: taken for an RGB-D recording: {paired} of {count} pictures have depth{left_out}; if that is wrong, \
             name its folders with --frames and --depth"
        ));
        listing
            .warnings
            .extend(warn_of_tum_unit(&self.pictures, listing.sensor.unit));
        Ok(with)
    }
}

/// Why depth that nobody asked for cannot be used, judged by the first pair.
fn why_unfit(items: &[Item], sensor: &Sensor) -> Option<String> {
    let Some((picture, depth)) = items.iter().find_map(Item::files_with_depth) else {
        return Some("no depth picture fits a colour picture by name, number or time".into());
    };
    let (Ok(picture), Ok(depth)) = (read_header(picture), read_header(depth)) else {
        return None;
    };
    if !depth.is_depth() {
        return Some("its depth images are not grey images of 16 bits or of floats".into());
    }
    let sizes = ((picture.width, picture.height), (depth.width, depth.height));
    (sizes.0 != sizes.1 && sensor.camera.is_none()).then(|| {
        let ((w, h), (depth_w, depth_h)) = sizes;
        format!("depth of {depth_w} × {depth_h} pixels does not fit pictures of {w} × {h} (--depth-intrinsics)")
    })
}
