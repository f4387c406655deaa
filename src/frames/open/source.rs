use std::path::{Path, PathBuf};

use super::depth::{pair, warn_of_tum_unit, with_depth};
use super::headers::Sensor;
use super::layout::{beside_depth, recognise, split_by_name};
use super::listing::{
    Listed, PICTURE_ENDINGS, has_picture_ending, list_pictures, text_of, unsupported_image,
};
use super::pairing::without_ending;
use super::request::FrameFolder;
use crate::film::{Probed, probe};
use crate::header::{FileKind, kind_of_file};
use crate::{FrameError, PictureSource};
use ostra_core::job::Progress;

/// The pictures of one source, in order.
#[derive(Debug)]
pub(super) struct Source {
    /// The path whose last parts go before names when there are several sources.
    pub place: PathBuf,
    /// What the source is.
    pub kind: Kind,
    /// At least one.
    pub items: Vec<Item>,
}

/// What a path given as frames can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Folder,
    Picture,
    Film,
}

/// One picture before its header is read.
#[derive(Debug)]
pub(super) struct Item {
    /// Below the source; empty when the source is this one picture.
    pub name: String,
    /// Where the picture comes from.
    pub origin: Origin,
    /// The depth file that belongs to it.
    pub depth: Option<PathBuf>,
}

/// Where a picture comes from, before its header is read.
#[derive(Debug, Clone)]
pub(super) enum Origin {
    /// A picture file.
    File(PathBuf),
    /// A picture of a film, with its size as shown.
    Film(PictureSource, (u32, u32)),
}

/// What listing needs to know besides the source, and what it tells.
pub(super) struct Listing<'a> {
    pub sensor: &'a Sensor,
    pub progress: &'a Progress,
    pub warnings: Vec<String>,
}

impl Listing<'_> {
    /// Lists one source and pairs its depth.
    pub fn list(&mut self, given: &FrameFolder) -> Result<Source, FrameError> {
        let place = located(&given.frames)?;
        let kind = kind_of(&place)?;
        let depth = given.depth.as_deref().map(located).transpose()?;
        let items = match (kind, depth) {
            (Kind::Film, depth) => self.film(&place, depth.as_deref())?,
            (Kind::Picture, None) => vec![without_depth(one_file(&place))],
            (Kind::Folder, None) => {
                let listed = self.pictures_in(&place)?;
                recognise(&place, listed, self)?
            }
            (_, Some(depth)) => self.with_given_depth(&place, &depth)?,
        };
        Ok(Source { place, kind, items })
    }

    fn with_given_depth(&mut self, place: &Path, depth: &Path) -> Result<Vec<Item>, FrameError> {
        let mut pictures = self.pictures_at(place)?;
        let mut depths = if depth == place {
            Vec::new()
        } else {
            self.pictures_at(depth)?
        };
        if depth == place {
            (pictures, depths) = split_by_name(pictures);
        } else if depth.starts_with(place) {
            pictures = beside_depth(pictures, depth);
        }
        let items = pictures.into_iter().map(without_depth).collect();
        self.paired(items, &depths, [place, depth])
    }

    fn film(&mut self, film: &Path, depth: Option<&Path>) -> Result<Vec<Item>, FrameError> {
        let probed = probe(film, self.progress)?;
        if let Some(damage) = &probed.damage {
            let count = probed.times_s.len();
            self.warnings.push(format!(
                "{}: damaged ({damage}); {count} pictures can be read",
                film.display()
            ));
        }
        let items = film_items(film, &probed);
        match depth {
            Some(depth) => {
                let depths = self.pictures_at(depth)?;
                self.paired(items, &depths, [film, depth])
            }
            None => Ok(items),
        }
    }

    fn pictures_at(&mut self, place: &Path) -> Result<Vec<Listed>, FrameError> {
        if place.is_dir() {
            self.pictures_in(place)
        } else {
            Ok(vec![one_file(place)])
        }
    }

    fn pictures_in(&mut self, place: &Path) -> Result<Vec<Listed>, FrameError> {
        let found = list_pictures(place)?;
        if found.pictures.is_empty() {
            let left_out = found.left_out();
            return Err(FrameError::NotFound(format!(
                "{}: no pictures in this folder or below it (looked for names ending in {}); give a folder of pictures, \
                 or a film by its own path{left_out}",
                place.display(),
                PICTURE_ENDINGS.join(", ")
            )));
        }
        self.warnings.extend(found.warnings(place));
        Ok(found.pictures)
    }

    /// Gives pictures the depth the user named; that none fits is an error.
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
                "{depth}: no depth picture fits a frame of {place}, by name, number or time; check that the two belong \
                 together"
            )));
        }
        self.warnings
            .extend(warn_of_tum_unit(&names, self.sensor.unit));
        Ok(with_depth(items, depths, &pairs))
    }
}

impl Item {
    /// Name and file, as pairing wants them.
    fn listed(&self) -> Listed {
        let path = match &self.origin {
            Origin::File(path) => path.clone(),
            Origin::Film(source, _) => source.path().into(),
        };
        Listed {
            name: self.name.clone(),
            path,
        }
    }

    /// What tells this picture from all others: its file, and which one of the film.
    pub fn identity(&self) -> (PathBuf, u64) {
        match &self.origin {
            Origin::File(path) => (path.clone(), 0),
            Origin::Film(source, _) => source.identity(),
        }
    }

    /// The picture file and the depth file, where there are both.
    pub fn files_with_depth(&self) -> Option<(&Path, &Path)> {
        match (&self.origin, &self.depth) {
            (Origin::File(picture), Some(depth)) => Some((picture, depth)),
            _ => None,
        }
    }
}

/// A picture without depth so far.
pub(super) fn without_depth(picture: Listed) -> Item {
    Item {
        name: picture.name,
        origin: Origin::File(picture.path),
        depth: None,
    }
}

fn film_items(film: &Path, probed: &Probed) -> Vec<Item> {
    let item = |(index, &time_s): (u64, &f64)| {
        let source = PictureSource::Film {
            path: film.into(),
            index,
            time_s,
        };
        Item {
            name: format!("{index:06}"),
            origin: Origin::Film(source, (probed.width, probed.height)),
            depth: None,
        }
    };
    (0..).zip(&probed.times_s).map(item).collect()
}

/// What names of a source's frames begin with: for a film its name without the ending.
pub(super) fn stem(source: &Source) -> PathBuf {
    match (source.kind, source.place.to_str()) {
        (Kind::Film, Some(place)) => without_ending(place).into(),
        _ => source.place.clone(),
    }
}

fn kind_of(place: &Path) -> Result<Kind, FrameError> {
    if place.is_dir() {
        return Ok(Kind::Folder);
    }
    if has_picture_ending(place) {
        return Ok(Kind::Picture);
    }
    // By the content where that is clear. Raw files of cameras begin like TIFF.
    match (kind_of_file(place)?, unsupported_image(place)) {
        (FileKind::Image, _) | (FileKind::Tiff, None) => Ok(Kind::Picture),
        (_, Some(error)) | (FileKind::Heif(error), None) => Err(error),
        (FileKind::Other, None) => Ok(Kind::Film),
    }
}

/// The absolute path of what the user named, with its own last name kept even where that is a link.
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
