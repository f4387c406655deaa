use std::collections::BTreeSet;
use std::path::{Component, Path};

use crate::frames::FrameError;

/// For each source the words to put before the names of its frames: as many of its path's last parts, at least
/// `at_least`, as make all of them differ.
///
/// # Errors
/// [`FrameError::NotFound`] when the same source is given twice.
pub(super) fn prefixes(sources: &[&Path], at_least: usize) -> Result<Vec<String>, FrameError> {
    let parts: Vec<Vec<String>> = sources.iter().map(|path| parts_of(path)).collect();
    let longest = parts.iter().map(Vec::len).max().unwrap_or(0);
    for count in at_least..=longest.max(at_least) {
        let prefixes: Vec<String> =
            parts.iter().map(|parts| parts[parts.len().saturating_sub(count)..].join("/")).collect();
        if prefixes.iter().collect::<BTreeSet<_>>().len() == prefixes.len() {
            return Ok(prefixes);
        }
    }
    let mut seen = BTreeSet::new();
    let twice = sources.iter().find(|path| !seen.insert(parts_of(path)));
    let twice = twice.map(|path| path.display().to_string()).unwrap_or_default();
    Err(FrameError::NotFound(format!("{twice} is given twice; give each folder, picture and film once")))
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

    fn named(sources: &[&str], at_least: usize) -> Vec<String> {
        let sources: Vec<&Path> = sources.iter().map(Path::new).collect();
        prefixes(&sources, at_least).unwrap()
    }

    #[test]
    fn one_source_needs_no_words() {
        assert_eq!(named(&["/data/run1/color"], 0), [""]);
        assert_eq!(named(&["/data/film"], 1), ["film"]);
    }

    #[test]
    fn several_take_as_many_parts_as_make_them_differ() {
        assert_eq!(named(&["/data/run1", "/data/run2"], 1), ["run1", "run2"]);
        assert_eq!(named(&["/data/run1/color", "/data/run2/color"], 1), ["run1/color", "run2/color"]);
        assert_eq!(named(&["/a/color", "/x/a/color"], 1), ["a/color", "x/a/color"]);
    }

    #[test]
    fn the_same_twice_is_an_error() {
        let twice = [Path::new("/data/run1"), Path::new("/data/run1")];
        assert!(prefixes(&twice, 1).unwrap_err().to_string().contains("/data/run1 is given twice"));
    }
}
