use std::path::{Path, PathBuf};

use super::listing::{Listed, PICTURE_ENDINGS, list_pictures, text_of};
use super::pairing::{Pairs, pair_by_name};
use super::request::FrameFolder;
use super::tum::{pair_by_associations, pair_by_time};
use crate::frames::FrameError;

/// The pictures of one source, in order.
#[derive(Debug)]
pub(super) struct Source {
    /// The path whose last parts go before names when there are several sources.
    pub place: PathBuf,
    /// Whether names need no words of `place` when this is the only source.
    pub is_folder: bool,
    /// At least one.
    pub items: Vec<Item>,
}

/// One picture before its header is read.
#[derive(Debug)]
pub(super) struct Item {
    /// Below the source; empty when the source is this one picture.
    pub name: String,
    /// The picture file.
    pub picture: PathBuf,
    /// The depth file that belongs to it.
    pub depth: Option<PathBuf>,
}

/// Lists one source and pairs its depth; what the user should know goes to `warnings`.
pub(super) fn list_source(given: &FrameFolder, warnings: &mut Vec<String>) -> Result<Source, FrameError> {
    let place = located(&given.frames)?;
    let depth = given.depth.as_deref().map(located).transpose()?;
    let (is_folder, mut pictures) = (place.is_dir(), pictures_at(&place)?);
    let Some(depth) = depth else {
        let items = pictures.into_iter().map(|p| Item { name: p.name, picture: p.path, depth: None }).collect();
        return Ok(Source { place, is_folder, items });
    };
    let depths = pictures_at(&depth)?;
    if depth != place {
        pictures.retain(|picture| !picture.path.starts_with(&depth));
    }
    let pairs = pair(&pictures, &depths, &[&place, &depth], warnings)?;
    if pairs.count() == 0 {
        return Err(FrameError::NotFound(format!(
            "{}: no depth picture fits a frame of {}, by name, number or time; check that the folders belong together",
            depth.display(),
            place.display()
        )));
    }
    Ok(Source { place, is_folder, items: paired(pictures, &depths, &pairs) })
}

/// Decides which depth belongs to which picture.
pub(super) fn pair(
    pictures: &[Listed],
    depths: &[Listed],
    places: &[&Path],
    warnings: &mut Vec<String>,
) -> Result<Pairs, FrameError> {
    let mut pairs = Pairs::none(pictures.len(), depths.len());
    if let (&[_], &[_]) = (pictures, depths) {
        pairs.join(0, 0);
        return Ok(pairs);
    }
    let folders: Vec<&Path> = places.iter().flat_map(|place| [Some(*place), place.parent()]).flatten().collect();
    if pair_by_associations(&mut pairs, &folders, pictures, depths)? {
        if pairs.count() > 0 {
            return Ok(pairs);
        }
        warnings.push("associations.txt names none of these pictures; depth is paired by name".into());
    }
    let names = |listed: &[Listed]| listed.iter().map(|file| file.name.clone()).collect::<Vec<_>>();
    let (pictures, depths) = (names(pictures), names(depths));
    let pictures: Vec<&str> = pictures.iter().map(String::as_str).collect();
    let depths: Vec<&str> = depths.iter().map(String::as_str).collect();
    if !pair_by_time(&mut pairs, &pictures, &depths) {
        pair_by_name(&mut pairs, &pictures, &depths);
    }
    Ok(pairs)
}

/// Pictures with the depths they were paired with.
pub(super) fn paired(pictures: Vec<Listed>, depths: &[Listed], pairs: &Pairs) -> Vec<Item> {
    let with_depth = |(picture, depth): (Listed, &Option<usize>)| Item {
        name: picture.name,
        picture: picture.path,
        depth: depth.map(|index| depths[index].path.clone()),
    };
    pictures.into_iter().zip(&pairs.depth_of).map(with_depth).collect()
}

/// The absolute path of what the user named, with its own last name kept even where that is a link.
fn located(given: &Path) -> Result<PathBuf, FrameError> {
    if !given.exists() {
        return Err(FrameError::NotFound(format!("{}: no such file or folder; check the path", given.display())));
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

fn pictures_at(place: &Path) -> Result<Vec<Listed>, FrameError> {
    if !place.is_dir() {
        return Ok(vec![Listed { name: String::new(), path: place.into() }]);
    }
    let pictures = list_pictures(place)?;
    if pictures.is_empty() {
        return Err(FrameError::NotFound(format!(
            "{}: no pictures in this folder or below it (looked for names ending in {})",
            place.display(),
            PICTURE_ENDINGS.join(", ")
        )));
    }
    Ok(pictures)
}
