use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::listing::Listed;
use super::pairing::{Pairs, without_ending};
use crate::FrameError;
use ostra_core::disk;

/// Pictures and depths of a TUM recording farther apart than this, in seconds, do not belong together.
const MAX_TIME_DIFFERENCE_S: f64 = 0.02;

/// Adds the pairs that `associations.txt` lists (`time path time path` a line, colour or depth first), looked for in
/// `folders` in order. Returns the file where there is one.
pub(super) fn pair_by_associations(
    pairs: &mut Pairs,
    folders: &[&Path],
    pictures: &[Listed],
    depths: &[Listed],
) -> Result<Option<PathBuf>, FrameError> {
    let found = folders
        .iter()
        .map(|folder| folder.join("associations.txt"))
        .find(|path| path.is_file());
    let Some(path) = found else { return Ok(None) };
    let text = disk::read_text(&path).map_err(|reason| FrameError::io(&path, reason))?;
    let (pictures, depths) = (ByFileName::new(pictures), ByFileName::new(depths));
    for line in text
        .lines()
        .filter(|line| !line.trim_start().starts_with('#'))
    {
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[_, one, _, other, ..] = words.as_slice() else {
            continue;
        };
        for (picture, depth) in [(one, other), (other, one)] {
            if let (Some(picture), Some(depth)) = (pictures.find(picture), depths.find(depth)) {
                pairs.join(picture, depth);
            }
        }
    }
    Ok(Some(path))
}

/// Adds pairs of nearest times, at most 0.02 s apart, where every name is a time in seconds. Returns whether they are.
pub(super) fn pair_by_time(pairs: &mut Pairs, pictures: &[&str], depths: &[&str]) -> bool {
    let (Some(pictures), Some(depths)) = (times_of(pictures), times_of(depths)) else {
        return false;
    };
    let mut by_time: Vec<(f64, usize)> = depths.iter().copied().zip(0..).collect();
    by_time.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut candidates = Vec::new();
    for (picture, time) in pictures.iter().enumerate() {
        let start = by_time.partition_point(|(t, _)| *t < time - MAX_TIME_DIFFERENCE_S);
        let near = by_time[start..]
            .iter()
            .take_while(|(t, _)| *t <= time + MAX_TIME_DIFFERENCE_S);
        candidates.extend(near.map(|(t, depth)| ((t - time).abs(), picture, *depth)));
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    for (_, picture, depth) in candidates {
        pairs.join(picture, depth);
    }
    true
}

/// The times that file names are, where all of them are decimal numbers of seconds.
pub(super) fn times_of(names: &[&str]) -> Option<Vec<f64>> {
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

/// Listed files, found by the end of their path.
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
    fn nearest_times_one_to_one() {
        let pictures = ["10.000.png", "10.033.png", "11.0.png"];
        let depths = ["10.030.png", "10.012.png", "11.021.png"];
        let mut pairs = Pairs::none(3, 3);
        assert!(pair_by_time(&mut pairs, &pictures, &depths));
        assert_eq!(
            pairs.depth_of,
            [Some(1), Some(0), None],
            "0.021 s is too far"
        );
    }

    #[test]
    fn names_that_are_no_times_are_left_alone() {
        let mut pairs = Pairs::none(2, 1);
        assert!(!pair_by_time(
            &mut pairs,
            &["10.0.png", "frame.png"],
            &["10.0.png"]
        ));
        assert_eq!(pairs.count(), 0);
    }

    #[test]
    fn associations_in_either_order() {
        let folder = tempfile::tempdir().unwrap();
        let text = "# depth first\n1.0 depth/b.png 1.01 rgb/a.png\n2.0 rgb/c.png 2.0 depth/d.png\nbroken line\n";
        std::fs::write(folder.path().join("associations.txt"), text).unwrap();
        let (pictures, depths) = (
            listed(&["rgb/a.png", "rgb/c.png"]),
            listed(&["depth/b.png", "depth/d.png"]),
        );
        let mut pairs = Pairs::none(2, 2);
        assert!(
            pair_by_associations(&mut pairs, &[folder.path()], &pictures, &depths)
                .unwrap()
                .is_some()
        );
        assert_eq!(pairs.depth_of, [Some(0), Some(1)]);
    }
}
