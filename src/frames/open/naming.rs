use std::collections::BTreeSet;
use std::path::{Component, Path};

use crate::FrameError;

/// The names of frames given as (number of its source, name below it): before each go as many of its source's last
/// parts, at least `at_least`, as make the sources differ and no name one that is `taken`.
///
/// # Errors
/// [`FrameError::NotFound`] when the same source is given twice or the whole path is not enough.
pub(super) fn name_frames(
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
            "{} is given twice; give each folder, picture and film once",
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
        "the frames cannot be told apart from those that are there; rename their folder".into(),
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
    fn one_folder_needs_no_words() {
        assert_eq!(named(&["/data/run1/color"], 0, &[]).unwrap(), ["1.png"]);
        assert_eq!(named(&["/data/film"], 1, &[]).unwrap(), ["film/1.png"]);
    }

    #[test]
    fn several_take_as_many_parts_as_make_them_differ() {
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
    fn the_same_twice_is_an_error() {
        assert!(
            named(&["/data/run1", "/data/run1"], 1, &[])
                .unwrap_err()
                .contains("/data/run1 is given twice")
        );
    }
}
