//! Class names of a YOLO data set.
//!
//! They are in a YAML file with `names`, in `classes.txt` (labelImg) or in `obj.names` (darknet).

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{self, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};

use super::files::{invalid, io_error, read_text};
use crate::MaskError;

/// Number of folders, from the given one upwards, that may be named `labels`.
///
/// Label files lie in `labels/train`.
const LEVELS_TO_LABELS: usize = 3;
/// Maximum size of a file with class names in bytes.
const MAX_BYTES: u64 = 4 << 20;

/// Class names of a data set.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct ClassNames {
    /// Name by class number; empty for a class without name.
    pub names: Vec<String>,
    /// File that the names are from.
    pub place: Option<PathBuf>,
    /// Decisions for the user.
    pub warnings: Vec<String>,
}

/// Returns whether a text file next to label files holds class names.
pub(super) fn is_names_file(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name == "classes.txt" || name == "predefined_classes.txt")
}

/// A folder that may hold class names.
struct NameFolder {
    folder: PathBuf,
    /// Whether the user gave the folder, or label files lie in it.
    is_given: bool,
    /// Whether YAML files of any name are used.
    ///
    /// Above the data set, they belong to something else.
    takes_any_yaml: bool,
}

/// Finds the class names for the labels in `dir`, whose files lie in `folders`.
///
/// The search starts in `dir`, its folder `labels` and the folders of the files. It continues in
/// the folders above, up to the one that contains `labels` and its parent.
pub(super) fn find_names(dir: &Path, folders: &BTreeSet<&Path>) -> Result<ClassNames, MaskError> {
    let given = |folder: PathBuf| NameFolder {
        folder,
        is_given: true,
        takes_any_yaml: true,
    };
    let mut places = vec![given(dir.to_path_buf()), given(dir.join("labels"))];
    places.extend(folders.iter().map(|folder| given(folder.to_path_buf())));
    let full = std::fs::canonicalize(dir).map_err(io_error(dir))?;
    let labels = full
        .ancestors()
        .take(LEVELS_TO_LABELS)
        .position(|folder| folder.file_name().is_some_and(|name| name == "labels"));
    let inside = labels.map_or(0, |depth| depth + 1);
    places.extend(
        full.ancestors()
            .skip(1)
            .take(inside + 1)
            .enumerate()
            .map(|(at, folder)| NameFolder {
                folder: folder.to_path_buf(),
                is_given: false,
                takes_any_yaml: at < inside,
            }),
    );
    let mut warnings = Vec::new();
    for place in places.iter().filter(|place| place.folder.is_dir()) {
        if let Some((names, file)) = names_in(place, &mut warnings)? {
            if !place.is_given {
                warnings.push(format!("class names are from {}", file.display()));
            }
            return Ok(ClassNames {
                names,
                place: Some(file),
                warnings,
            });
        }
    }
    Ok(ClassNames {
        warnings,
        ..ClassNames::default()
    })
}

/// Returns the names in a folder, from a file with a usual name or else from other YAML files.
fn names_in(
    place: &NameFolder,
    warnings: &mut Vec<String>,
) -> Result<Option<(Vec<String>, PathBuf)>, MaskError> {
    for (file, parse) in [
        ("data.yaml", yaml_names as fn(&str) -> Option<Vec<String>>),
        ("data.yml", yaml_names),
        ("dataset.yaml", yaml_names),
        ("classes.txt", plain_names),
        ("obj.names", plain_names),
        ("predefined_classes.txt", plain_names),
    ] {
        let path = place.folder.join(file);
        if !path.is_file() {
            continue;
        }
        let text = match small_text(&path) {
            Ok(text) => text,
            Err(error) if place.is_given => return Err(error),
            Err(error) => {
                warnings.push(format!("class names were not read: {error}"));
                continue;
            }
        };
        match text.and_then(|text| parse(&text)) {
            Some(names) => return Ok(Some((names, path))),
            None if place.is_given && file == "data.yaml" => {
                return Err(invalid(
                    &path,
                    "has no readable `names`; list them as `0: name`",
                ));
            }
            None => warnings.push(format!(
                "{} holds no class names and was not used",
                path.display()
            )),
        }
    }
    if place.takes_any_yaml {
        names_of_any_yaml(&place.folder, warnings)
    } else {
        Ok(None)
    }
}

/// Returns the names that all YAML files in a folder agree on.
///
/// Files without names have another purpose and are ignored.
fn names_of_any_yaml(
    dir: &Path,
    warnings: &mut Vec<String>,
) -> Result<Option<(Vec<String>, PathBuf)>, MaskError> {
    let mut found: Vec<(Vec<String>, PathBuf)> = Vec::new();
    let mut entries: Vec<PathBuf> = std::fs::read_dir(dir)
        .map_err(io_error(dir))?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .collect();
    entries.sort();
    for path in entries {
        let ending = path.extension().unwrap_or_default().to_ascii_lowercase();
        if (ending == "yaml" || ending == "yml") && path.is_file() {
            // The user did not give this file, so failing to read it is not an error.
            let names = small_text(&path)
                .ok()
                .flatten()
                .and_then(|text| yaml_names(&text));
            found.extend(names.map(|names| (names, path)));
        }
    }
    if let [(first, one), .., (last, other)] = &found[..]
        && found
            .iter()
            .any(|(names, _)| names != first || names != last)
    {
        warnings.push(format!(
            "{} and {} list different class names, so none of them were used; keep one, or name it data.yaml",
            one.display(),
            other.display()
        ));
        return Ok(None);
    }
    Ok(found.into_iter().next())
}

/// Returns the text of a file; `None` when the file is too large.
fn small_text(path: &Path) -> Result<Option<String>, MaskError> {
    let bytes = std::fs::metadata(path).map_err(io_error(path))?.len();
    if bytes > MAX_BYTES {
        Ok(None)
    } else {
        read_text(path).map(Some)
    }
}

/// Returns the text of `data.yaml` for names in the order of their class numbers.
pub(super) fn yaml(names: &[String]) -> String {
    let mut text = String::from("path: .\ntrain: images\nval: images\nnames:\n");
    for (class, name) in names.iter().enumerate() {
        // Within single quotes, only '' has a meaning, which is a quote.
        text.push_str(&format!("  {class}: '{}'\n", name.replace('\'', "''")));
    }
    text
}

fn plain_names(text: &str) -> Option<Vec<String>> {
    let names: Vec<String> = text
        .lines()
        .map(|line| line.trim().to_owned())
        .filter(|line| !line.is_empty())
        .collect();
    (!names.is_empty()).then_some(names)
}

/// Returns the `names` of a data file: a list, or a map from class number to name.
fn yaml_names(text: &str) -> Option<Vec<String>> {
    let file: DataFile = serde_saphyr::from_str(text).ok()?;
    file.names.map(|names| names.0)
}

/// The part of a data file that is read.
#[derive(Deserialize)]
struct DataFile {
    names: Option<NameList>,
}

/// Class names in the order of their numbers; at least one.
struct NameList(Vec<String>);

impl<'de> Deserialize<'de> for NameList {
    fn deserialize<D: Deserializer<'de>>(file: D) -> Result<Self, D::Error> {
        file.deserialize_any(NamesVisitor)
    }
}

struct NamesVisitor;

impl<'de> Visitor<'de> for NamesVisitor {
    type Value = NameList;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("a list of names, or a map from numbers to names")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<NameList, A::Error> {
        let mut names = Vec::new();
        while let Some(name) = list.next_element::<Option<String>>()? {
            names.push(name.unwrap_or_default());
        }
        checked(names)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<NameList, A::Error> {
        let mut names = Vec::new();
        while let Some((class, name)) = map.next_entry::<u16, Option<String>>()? {
            let class = usize::from(class);
            names.resize(names.len().max(class + 1), String::new());
            names[class] = name.unwrap_or_default();
        }
        checked(names)
    }
}

fn checked<E: de::Error>(names: Vec<String>) -> Result<NameList, E> {
    match names.len() {
        0 => Err(E::custom("there are no names")),
        count if count > usize::from(u16::MAX) + 1 => Err(E::custom("there are too many names")),
        _ => Ok(NameList(names)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_in_every_usual_form() {
        for text in [
            "train: x\nnames:\n  0: leaf\n  1: 'stem 1'\n  2: \"it's\"\nnc: 3\n",
            "names: [leaf, 'stem 1', \"it's\"]\n",
            "nc: 3\nnames:\n- leaf\n- stem 1\n- it's\n",
            "names: {0: leaf, 1: stem 1, 2: \"it's\"}",
            "names:\n  # comment\n  - leaf  # green\n\n  - 'stem 1'\n  - 'it''s'\nother: 1",
            "names: ['leaf',\n  'stem 1', \"it's\"]",
            "names:\n  2: it's\n  0: leaf\n  1: stem 1",
        ] {
            assert_eq!(
                yaml_names(text).unwrap(),
                ["leaf", "stem 1", "it's"],
                "{text}"
            );
        }
        for (text, name) in [
            ("names: # classes\n  0: leaf\n", "leaf"),
            ("names: ['a] b']\n", "a] b"),
            ("names: [\"tab\\there\"]\n", "tab\there"),
            ("other:\n  names: [stem]\nnames: [leaf]\n", "leaf"),
            ("names: [007]\n", "007"),
            ("names:\n- no\n", "no"),
            ("names:\n- 1.0\n", "1.0"),
            ("---\nnames: [leaf]\n", "leaf"),
        ] {
            assert_eq!(yaml_names(text), Some(vec![name.to_owned()]), "{text}");
        }
        assert_eq!(yaml_names("names:\n  0:\n  1: leaf").unwrap(), ["", "leaf"]);
        let names = ["it's", "a: b #c", "[x]", "007"].map(str::to_owned);
        assert_eq!(yaml_names(&yaml(&names)).unwrap(), names);
        assert_eq!(yaml_names("nc: 3"), None);
        assert_eq!(yaml_names("names: []"), None);
        assert_eq!(yaml_names("names: {leaf: 0}"), None);
        assert_eq!(yaml_names("names:\n  9999999: x"), None);
        assert_eq!(
            plain_names("leaf\r\n\nstem 1\n").unwrap(),
            ["leaf", "stem 1"]
        );
    }

    #[test]
    fn names_are_found_in_the_usual_places() {
        for (file, text) in [
            ("set/labels/train/classes.txt", "leaf\r\nstem\r\n"),
            ("set/labels/classes.txt", "\u{feff}leaf\nstem\n"),
            ("set/obj.names", "leaf\nstem"),
            (
                "set/coco8-seg.yaml",
                "path: x\nnames:\n  0: leaf\n  1: stem\n",
            ),
            ("data.yaml", "names: [leaf, stem]"),
            ("set/My Set.YML", "nc: 2\nnames:\n- leaf\n- stem\n"),
        ] {
            let root = tempfile::tempdir().unwrap();
            let labels = root.path().join("set/labels/train");
            std::fs::create_dir_all(&labels).unwrap();
            std::fs::write(root.path().join(file), text).unwrap();
            for dir in [
                root.path().join("set"),
                root.path().join("set/labels"),
                labels.clone(),
            ] {
                let found = find_names(&dir, &BTreeSet::from([labels.as_path()])).unwrap();
                assert_eq!(
                    found.names,
                    ["leaf", "stem"],
                    "{file} for {}",
                    dir.display()
                );
                assert!(found.place.is_some());
            }
        }
    }

    #[test]
    fn disagreeing_yaml_files_are_ignored() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("a.yaml"), "names: [leaf, stem]").unwrap();
        std::fs::write(dir.path().join("b.yaml"), "names: [leaf, stem]").unwrap();
        std::fs::write(dir.path().join("compose.yml"), "services: x").unwrap();
        let find = || find_names(dir.path(), &BTreeSet::new()).unwrap();
        assert_eq!(find().names, ["leaf", "stem"]);
        std::fs::write(dir.path().join("b.yaml"), "names: [cat, dog]").unwrap();
        assert!(
            find().names.is_empty() && find().warnings[0].contains("a.yaml"),
            "{:?}",
            find().warnings
        );
    }

    #[test]
    fn unreadable_names_above_the_folder_are_ignored() {
        for file in ["classes.txt", "obj.names"] {
            let root = tempfile::tempdir().unwrap();
            let set = root.path().join("set");
            std::fs::create_dir(&set).unwrap();
            std::fs::write(root.path().join(file), b"Bl\xe4tt").unwrap();
            let found = find_names(&set, &BTreeSet::new()).unwrap();
            assert!(
                found.names.is_empty() && found.warnings[0].contains(file),
                "{:?}",
                found.warnings
            );
            assert!(
                find_names(root.path(), &BTreeSet::new()).is_err(),
                "given by the user"
            );
        }
    }

    #[test]
    fn written_names_round_trip() {
        let names = ["a: b", "it's", "\"x\", #y", "[z]", "Ä"]
            .map(String::from)
            .to_vec();
        assert_eq!(yaml_names(&yaml(&names)).unwrap(), names);
    }
}
