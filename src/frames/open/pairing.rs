//! Pairing of depth with images: by TUM associations, time, name or number.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::listing::{Item, Listed};
use super::request::OpenRequest;
use crate::FrameError;
use crate::cameras::TUM_TOLERANCE_S;
use crate::name_parts::{file_of, without_ending};
use ostra_core::disk;

/// Words in file names that describe the content of an image, not its identity.
const ROLE_WORDS: [&str; 5] = ["color", "colour", "rgb", "image", "depth"];

/// Pairs of images and depth: for each image the index of its depth.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct DepthPairs {
    /// Index of the depth of each image.
    pub depth_of: Vec<Option<usize>>,
    used: Vec<bool>,
}

impl DepthPairs {
    /// Returns no pairs among `pictures` images and `depths` depth files.
    pub fn none(images: usize, depths: usize) -> Self {
        Self {
            depth_of: vec![None; images],
            used: vec![false; depths],
        }
    }

    /// Returns the number of images with depth.
    pub fn count(&self) -> usize {
        self.depth_of.iter().flatten().count()
    }

    /// Pairs the two unless one of them already has a partner.
    pub fn join(&mut self, image: usize, depth: usize) {
        if self.depth_of[image].is_none() && !self.used[depth] {
            self.depth_of[image] = Some(depth);
            self.used[depth] = true;
        }
    }

    /// Pairs images and depth with the same key, if only one image and one depth have it.
    fn join_by_key(
        &mut self,
        images: &[&str],
        depths: &[&str],
        key: impl Fn(&str) -> Option<String>,
    ) {
        let (images, depths) = (unique_by_key(images, &key), unique_by_key(depths, &key));
        for (key, image) in images {
            if let (Some(image), Some(Some(depth))) = (image, depths.get(&key)) {
                self.join(image, *depth);
            }
        }
    }
}

/// Adds pairs by name: without extension, then without role words, then by the number.
///
/// Role words distinguish colour from depth.
fn pair_by_name(pairs: &mut DepthPairs, images: &[&str], depths: &[&str]) {
    pairs.join_by_key(images, depths, |name| Some(without_ending(name).into()));
    pairs.join_by_key(images, depths, |name| {
        Some(without_role(without_ending(name)))
    });
    let position = [Position::Last, Position::First]
        .into_iter()
        .max_by_key(|position| {
            let mut trial = DepthPairs::none(images.len(), depths.len());
            trial.join_by_key(images, depths, |name| number_in_file_name(name, *position));
            (trial.count(), *position == Position::Last)
        });
    let position = position.unwrap_or(Position::Last);
    pairs.join_by_key(images, depths, |name| {
        Some(format!(
            "{}/{}",
            folder_of(name),
            number_in_file_name(name, position)?
        ))
    });
    pairs.join_by_key(images, depths, |name| number_in_file_name(name, position));
}

/// Position of the number of a file name that counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Position {
    First,
    Last,
}

fn unique_by_key(
    names: &[&str],
    key: impl Fn(&str) -> Option<String>,
) -> BTreeMap<String, Option<usize>> {
    let mut by_key = BTreeMap::new();
    for (index, name) in names.iter().enumerate() {
        if let Some(key) = key(name) {
            by_key
                .entry(key)
                .and_modify(|one| *one = None)
                .or_insert(Some(index));
        }
    }
    by_key
}

fn folder_of(name: &str) -> &str {
    name.rfind('/').map_or("", |slash| &name[..slash])
}

/// Returns whether a word of the file name is `depth`.
pub(super) fn says_depth(name: &str) -> bool {
    words_of(without_ending(name)).any(|word| word.eq_ignore_ascii_case("depth"))
}

fn words_of(name: &str) -> impl Iterator<Item = &str> {
    file_of(name).split(['.', '_', '-'])
}

/// Returns the name without role words, e.g. `frame-7` for `frame-7.color`.
pub(super) fn without_role(name: &str) -> String {
    let is_role = |word: &&str| {
        ROLE_WORDS
            .iter()
            .any(|role| word.eq_ignore_ascii_case(role))
    };
    let words: Vec<&str> = words_of(name).filter(|word| !is_role(word)).collect();
    format!("{}/{}", folder_of(name), words.join("-"))
}

/// Returns a number of the file name without leading zeros, as text to allow any length.
fn number_in_file_name(name: &str, position: Position) -> Option<String> {
    let stem = file_of(without_ending(name));
    let mut runs = stem
        .split(|c: char| !c.is_ascii_digit())
        .filter(|run| !run.is_empty());
    let run = match position {
        Position::First => runs.next(),
        Position::Last => runs.next_back(),
    }?;
    let number = run.trim_start_matches('0');
    Some(if number.is_empty() {
        "0".into()
    } else {
        number.into()
    })
}

/// Pairs depth with images.
///
/// It uses `associations.txt` in `places` or above them, else the times in names, else name and
/// number.
pub(super) fn pair(
    images: &[Listed],
    depths: &[Listed],
    places: &[&Path],
    warnings: &mut Vec<String>,
) -> Result<DepthPairs, FrameError> {
    let mut pairs = DepthPairs::none(images.len(), depths.len());
    if let (&[_], &[_]) = (images, depths) {
        pairs.join(0, 0);
        return Ok(pairs);
    }
    let folders: Vec<&Path> = places
        .iter()
        .flat_map(|place| [Some(*place), place.parent()])
        .flatten()
        .collect();
    if let Some(list) = pair_by_associations(&mut pairs, &folders, images, depths)? {
        if pairs.count() > 0 {
            return Ok(pairs);
        }
        warnings.push(format!(
            "{}: names none of these images; depth is paired by name",
            list.display()
        ));
    }
    let (images, depths) = (names(images), names(depths));
    if !pair_by_time(&mut pairs, &images, &depths) {
        pair_by_name(&mut pairs, &images, &depths);
    }
    Ok(pairs)
}

/// Returns the items with their paired depth.
pub(super) fn with_depth(items: Vec<Item>, depths: &[Listed], pairs: &DepthPairs) -> Vec<Item> {
    let one = |(item, depth): (Item, &Option<usize>)| Item {
        depth: depth.map(|at| depths[at].path.clone()),
        ..item
    };
    items.into_iter().zip(&pairs.depth_of).map(one).collect()
}

/// Returns a warning for TUM recordings, whose names are times and which have their own depth unit.
pub(super) fn warn_of_tum_unit(images: &[Listed], depth_unit: f64) -> Option<String> {
    let usual = depth_unit.to_bits() == OpenRequest::default().depth_unit.to_bits();
    (usual && times_of(&names(images)).is_some()).then(|| {
        "the names are times, as in TUM recordings, whose depth has 5000 steps a metre: if this is one, the depth unit is \
         0.0002, not 0.001 (--depth-unit 0.0002)"
            .into()
    })
}

fn names(listed: &[Listed]) -> Vec<&str> {
    listed.iter().map(|file| file.name.as_str()).collect()
}

/// Adds the pairs of the first `associations.txt` in `folders`; returns the file if there is one.
///
/// Its lines are `time path time path`, colour or depth first.
fn pair_by_associations(
    pairs: &mut DepthPairs,
    folders: &[&Path],
    images: &[Listed],
    depths: &[Listed],
) -> Result<Option<PathBuf>, FrameError> {
    let found = folders
        .iter()
        .map(|folder| folder.join("associations.txt"))
        .find(|path| path.is_file());
    let Some(path) = found else { return Ok(None) };
    let text = disk::read_text(&path).map_err(|reason| FrameError::io(&path, reason))?;
    let (images, depths) = (ByFileName::new(images), ByFileName::new(depths));
    for line in text
        .lines()
        .filter(|line| !line.trim_start().starts_with('#'))
    {
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[_, one, _, other, ..] = words.as_slice() else {
            continue;
        };
        for (image, depth) in [(one, other), (other, one)] {
            if let (Some(image), Some(depth)) = (images.find(image), depths.find(depth)) {
                pairs.join(image, depth);
            }
        }
    }
    Ok(Some(path))
}

/// Adds pairs of nearest times, at most 0.02 s apart.
///
/// Returns whether all names are times in seconds; otherwise nothing is paired.
fn pair_by_time(pairs: &mut DepthPairs, images: &[&str], depths: &[&str]) -> bool {
    let (Some(images), Some(depths)) = (times_of(images), times_of(depths)) else {
        return false;
    };
    let mut by_time: Vec<(f64, usize)> = depths.iter().copied().zip(0..).collect();
    by_time.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut candidates = Vec::new();
    for (image, time) in images.iter().enumerate() {
        let start = by_time.partition_point(|(t, _)| *t < time - TUM_TOLERANCE_S);
        let near = by_time[start..]
            .iter()
            .take_while(|(t, _)| *t <= time + TUM_TOLERANCE_S);
        candidates.extend(near.map(|(t, depth)| ((t - time).abs(), image, *depth)));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for (_, image, depth) in candidates {
        pairs.join(image, depth);
    }
    true
}

/// Returns the times in file names if all of them are decimal numbers of seconds.
fn times_of(names: &[&str]) -> Option<Vec<f64>> {
    let time_of = |name: &&str| {
        let stem = without_ending(name);
        let stem = stem.rsplit('/').next().unwrap_or(stem);
        let (seconds, fraction) = stem.split_once('.')?;
        let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
        (digits(seconds) && digits(fraction))
            .then(|| stem.parse().ok())
            .flatten()
    };
    names.iter().map(time_of).collect()
}

/// Listed files by the end of their path.
struct ByFileName<'a> {
    files: BTreeMap<&'a std::ffi::OsStr, Vec<(usize, &'a Path)>>,
}

impl<'a> ByFileName<'a> {
    fn new(listed: &'a [Listed]) -> Self {
        let mut files = BTreeMap::<_, Vec<_>>::new();
        for (index, file) in listed.iter().enumerate() {
            files
                .entry(file.path.file_name().unwrap_or_default())
                .or_default()
                .push((index, file.path.as_path()));
        }
        Self { files }
    }

    fn find(&self, path: &str) -> Option<usize> {
        let path = Path::new(path.trim_start_matches("./"));
        let same_name = self.files.get(path.file_name()?)?;
        same_name
            .iter()
            .find(|(_, file)| file.ends_with(path))
            .map(|(index, _)| *index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(images: &[&str], depths: &[&str]) -> Vec<Option<usize>> {
        let mut pairs = DepthPairs::none(images.len(), depths.len());
        pair_by_name(&mut pairs, images, depths);
        pairs.depth_of
    }

    #[test]
    fn pairs_by_name_without_extension() {
        assert_eq!(
            pair(&["a/x.jpg", "a/y.jpg", "b/x.jpg"], &["a/x.png", "b/x.png"]),
            [Some(0), None, Some(1)]
        );
    }

    #[test]
    fn pairs_by_name_without_the_words_color_and_depth() {
        let images = ["frame-000000.color.png", "frame-000001.color.png"];
        assert_eq!(
            pair(
                &images,
                &["frame-000001.depth.png", "frame-000000.depth.png"]
            ),
            [Some(1), Some(0)]
        );
    }

    #[test]
    fn pairs_by_number_with_other_padding() {
        assert_eq!(
            pair(&["9.jpg", "10.jpg", "11.jpg"], &["d009.png", "d010.png"]),
            [Some(0), Some(1), None]
        );
        assert_eq!(
            pair(&["98.jpg", "100.jpg"], &["098.png", "100.png"]),
            [Some(0), Some(1)]
        );
    }

    #[test]
    fn pairs_by_the_first_number_if_a_time_follows() {
        let depths = ["0000001-000000000040.png", "0000002-000000033407.png"];
        assert_eq!(
            pair(
                &["0000001-000000000000.jpg", "0000002-000000033369.jpg"],
                &depths
            ),
            [Some(0), Some(1)]
        );
    }

    #[test]
    fn ambiguous_number_pairs_nothing() {
        assert_eq!(
            pair(&["left_1.jpg", "right_1.jpg"], &["d1.png"]),
            [None, None]
        );
        assert_eq!(
            pair(&["a/img1.jpg", "b/img1.jpg"], &["b/d1.png", "a/d1.png"]),
            [Some(1), Some(0)]
        );
    }

    fn listed(names: &[&str]) -> Vec<Listed> {
        names
            .iter()
            .map(|name| Listed {
                name: (*name).into(),
                path: Path::new("/rec").join(name),
            })
            .collect()
    }

    #[test]
    fn nearest_times_are_paired_one_to_one() {
        let images = ["10.000.png", "10.033.png", "11.0.png"];
        let depths = ["10.030.png", "10.012.png", "11.021.png"];
        let mut pairs = DepthPairs::none(3, 3);
        assert!(pair_by_time(&mut pairs, &images, &depths));
        assert_eq!(
            pairs.depth_of,
            [Some(1), Some(0), None],
            "0.021 s is too far"
        );
    }

    #[test]
    fn names_that_are_not_times_are_not_paired() {
        let mut pairs = DepthPairs::none(2, 1);
        assert!(!pair_by_time(
            &mut pairs,
            &["10.0.png", "frame.png"],
            &["10.0.png"]
        ));
        assert_eq!(pairs.count(), 0);
    }

    #[test]
    fn associations_are_read_in_either_order() {
        let folder = tempfile::tempdir().unwrap();
        let text = "# depth first\n1.0 depth/b.png 1.01 rgb/a.png\n2.0 rgb/c.png 2.0 depth/d.png\nbroken line\n";
        std::fs::write(folder.path().join("associations.txt"), text).unwrap();
        let (images, depths) = (
            listed(&["rgb/a.png", "rgb/c.png"]),
            listed(&["depth/b.png", "depth/d.png"]),
        );
        let mut pairs = DepthPairs::none(2, 2);
        assert!(
            pair_by_associations(&mut pairs, &[folder.path()], &images, &depths)
                .unwrap()
                .is_some()
        );
        assert_eq!(pairs.depth_of, [Some(0), Some(1)]);
    }
}
