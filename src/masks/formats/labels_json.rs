use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::files::{invalid, io_error, read_text, write_whole};
use crate::{Label, LabelId, LabelTree, MaskError};

/// Name of the file with the label tree, stored next to the masks.
pub(super) const LABELS_FILE: &str = "labels.json";
/// Maximum size of a list of labels in bytes.
///
/// 65,535 labels with long names take a tenth of it.
const MAX_BYTES: u64 = 64 << 20;

/// A label in the file: `{"id": 2, "name": "stem 1", "parent": 1, "color": "#3cb44b"}`.
#[derive(Serialize, Deserialize)]
struct LabelEntry {
    id: LabelId,
    name: String,
    /// Id of the parent; `null` at the top level.
    #[serde(default)]
    parent: Option<LabelId>,
    #[serde(default)]
    color: Option<LabelColor>,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum LabelColor {
    /// `#rrggbb`.
    Text(String),
    /// Red, green, blue.
    Channels([u8; 3]),
}

/// Writes `labels.json` into a folder of masks.
///
/// The file is a list of `{"id", "name", "parent", "color"}`. Parents are ids or null, and colours
/// are `#rrggbb`.
///
/// # Errors
/// [`MaskError::Io`] when the file cannot be written.
pub fn write_labels_json(dir: &Path, tree: &LabelTree) -> Result<(), MaskError> {
    let entry = |label: &Label| {
        let [red, green, blue] = label.color;
        let color = Some(LabelColor::Text(format!("#{red:02x}{green:02x}{blue:02x}")));
        serde_json::to_string(&LabelEntry {
            id: label.id,
            name: label.name.clone(),
            parent: label.parent,
            color,
        })
    };
    let path = dir.join(LABELS_FILE);
    let lines: Vec<String> = tree
        .iter()
        .map(entry)
        .collect::<Result<_, _>>()
        .map_err(|error| io_error(&path)(error.into()))?;
    let text = if lines.is_empty() {
        "[]\n".into()
    } else {
        format!("[\n  {}\n]\n", lines.join(",\n  "))
    };
    write_whole(&path, text.as_bytes())
}

/// Reads the `labels.json` of a folder of masks, or of the folder above it.
///
/// The ground truth of synthetic scenes stores it in the folder above. Returns `None` when there is
/// no file, or only one of another program. Colours may also be `[r, g, b]`; a label without colour
/// gets one.
///
/// # Errors
/// [`MaskError::Io`], or [`MaskError::Invalid`] for a damaged list of labels.
pub fn read_labels_json(dir: &Path) -> Result<Option<LabelTree>, MaskError> {
    Ok(listed_labels(dir)?.tree)
}

/// Labels listed for a folder of masks.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct ListedLabels {
    /// The listed labels; `None` without a list.
    pub tree: Option<LabelTree>,
    /// Which file was ignored and why, for the user.
    pub warning: Option<String>,
}

/// Reads labels like [`read_labels_json`], with a warning about an ignored file.
///
/// Other programs write files of the same name, so a file that is not a list of labels is ignored.
/// A damaged list in the folder above is ignored too, because the user did not select that folder.
pub(crate) fn listed_labels(dir: &Path) -> Result<ListedLabels, MaskError> {
    let above = dir
        .canonicalize()
        .ok()
        .and_then(|full| Some(full.parent()?.to_path_buf()));
    let mut files = [Some(dir.to_path_buf()), above]
        .into_iter()
        .flatten()
        .map(|folder| folder.join(LABELS_FILE));
    let Some(file) = files.find(|file| file.is_file()) else {
        return Ok(ListedLabels::default());
    };
    let is_given = file.parent() == Some(dir);
    if std::fs::metadata(&file).is_ok_and(|data| data.len() > MAX_BYTES) {
        return Ok(unused(&file, "it is too large for a list of labels"));
    }
    let text = match read_text(&file) {
        Ok(text) => text,
        Err(error) if is_given => return Err(error),
        Err(_) => {
            return Ok(unused(
                &file,
                "it cannot be read as text, and is not in the given folder",
            ));
        }
    };
    match read_tree(&file, &text) {
        Ok(tree) => Ok(ListedLabels {
            tree: Some(tree),
            warning: None,
        }),
        Err(error) if is_given && is_list_of_labels(&text) && !has_foreign_ids(&text) => Err(error),
        Err(_) if is_given => Ok(unused(
            &file,
            "it is not a list of labels; another program may have written it",
        )),
        Err(_) => Ok(unused(
            &file,
            "it is not a readable list of labels, and not in the given folder",
        )),
    }
}

fn unused(file: &Path, why: &str) -> ListedLabels {
    ListedLabels {
        tree: None,
        warning: Some(format!("{} was not used: {why}", file.display())),
    }
}

/// Returns whether a text starts like the output of [`write_labels_json`].
///
/// That is a list of objects with an id and a name.
fn is_list_of_labels(text: &str) -> bool {
    let first = text.trim_start().strip_prefix('[').map(str::trim_start);
    first
        .and_then(|rest| rest.strip_prefix('{'))
        .is_some_and(|rest| {
            let object = rest.split('}').next().unwrap_or(rest);
            object.contains("\"id\"") && object.contains("\"name\"")
        })
}

/// Returns whether a list has ids that are not valid label ids: 0, or above 65535.
fn has_foreign_ids(text: &str) -> bool {
    let entries: Vec<serde_json::Value> = serde_json::from_str(text).unwrap_or_default();
    let is_ours = |id: &serde_json::Value| {
        id.as_u64()
            .is_some_and(|id| (1..=u64::from(u16::MAX)).contains(&id))
    };
    entries
        .iter()
        .filter_map(|entry| entry.get("id"))
        .any(|id| id.is_number() && !is_ours(id))
}

fn read_tree(path: &Path, text: &str) -> Result<LabelTree, MaskError> {
    let broken = |error: &dyn std::fmt::Display| {
        invalid(
            path,
            format!(
                "is a damaged list of labels ({error}); correct it, or remove it to read ids as numbers"
            ),
        )
    };
    let entries: Vec<LabelEntry> = serde_json::from_str(text).map_err(|error| broken(&error))?;
    let label = |entry: LabelEntry| {
        let color = match &entry.color {
            None => LabelTree::color_for(entry.id),
            Some(LabelColor::Channels(channels)) => *channels,
            Some(LabelColor::Text(text)) => parse_color(text)
                .ok_or_else(|| broken(&format!("colour '{text}' is not #rrggbb")))?,
        };
        Ok(Label {
            id: entry.id,
            name: entry.name,
            color,
            parent: entry.parent,
        })
    };
    let labels: Vec<Label> = entries
        .into_iter()
        .map(label)
        .collect::<Result<_, MaskError>>()?;
    LabelTree::try_from(labels).map_err(|error| broken(&error))
}

/// Returns the label of each colour, for masks saved as colour images.
///
/// A colour shared by several labels is excluded.
pub(crate) fn ids_of_colors(tree: &LabelTree) -> BTreeMap<[u8; 3], LabelId> {
    let mut found: BTreeMap<[u8; 3], Vec<LabelId>> = BTreeMap::new();
    for label in tree.iter() {
        found.entry(label.color).or_default().push(label.id);
    }
    found
        .into_iter()
        .filter(|(_, ids)| ids.len() == 1)
        .map(|(color, ids)| (color, ids[0]))
        .collect()
}

pub(super) fn parse_color(text: &str) -> Option<[u8; 3]> {
    let digits = text
        .strip_prefix('#')
        .filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let channel = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).ok();
    Some([channel(0)?, channel(2)?, channel(4)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn label_tree_round_trips_through_its_file() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read_labels_json(dir.path()).unwrap(), None);
        let label = |id: u16, name: &str, parent: Option<u16>| Label {
            id: LabelId(id),
            name: name.into(),
            color: [0, 10, 255],
            parent: parent.map(LabelId),
        };
        let tree: LabelTree = vec![label(1, "rice \"A\"", Some(700)), label(700, "Ä/b", None)]
            .try_into()
            .unwrap();
        write_labels_json(dir.path(), &tree).unwrap();
        assert_eq!(read_labels_json(dir.path()).unwrap().as_ref(), Some(&tree));
        std::fs::create_dir(dir.path().join("masks")).unwrap();
        assert_eq!(
            read_labels_json(&dir.path().join("masks")).unwrap(),
            Some(tree)
        );
        let text = std::fs::read_to_string(dir.path().join("labels.json")).unwrap();
        assert!(
            text.contains(r##""color":"#000aff""##) && text.contains(r#""parent":null"#),
            "{text}"
        );
    }

    #[test]
    fn colors_are_read_in_every_form() {
        let dir = tempfile::tempdir().unwrap();
        let text = r##"[{"id":1,"name":"a","color":"#0102ff"},{"id":2,"name":"b","color":[3,4,5]},{"id":3,"name":"c"}]"##;
        std::fs::write(dir.path().join("labels.json"), text).unwrap();
        let tree = read_labels_json(dir.path()).unwrap().unwrap();
        let colors: Vec<[u8; 3]> = tree.iter().map(|label| label.color).collect();
        assert_eq!(
            colors,
            [[1, 2, 255], [3, 4, 5], LabelTree::color_for(LabelId(3))]
        );
    }

    #[test]
    fn damaged_lists_are_errors_that_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        for text in [
            r#"[{"id":1,"name":"a","parent":2}]"#,
            r#"[{"id":1,"name":"a"},{"id":1,"name":"b"}]"#,
            r##"[{"id":1,"name":"a","color":"#12é45"}]"##,
            r#"[{"id":1,"name":"a"},{"id":2,"na"#,
        ] {
            std::fs::write(dir.path().join("labels.json"), text).unwrap();
            let error = read_labels_json(dir.path()).unwrap_err().to_string();
            assert!(error.contains("labels.json"), "{error}");
        }
    }

    #[test]
    fn files_of_other_programs_are_ignored_with_a_warning() {
        let dir = tempfile::tempdir().unwrap();
        let masks = dir.path().join("masks");
        std::fs::create_dir(&masks).unwrap();
        for text in [
            "{",
            "",
            r#"{"labels":[]}"#,
            r#"["leaf","stem"]"#,
            "[1,2]",
            r#"[{"trainId":1,"name":"a"}]"#,
            r#"[{"id":0,"name":"a"}]"#,
            r#"[{"id":1,"name":"b"},{"id":70000,"name":"a"}]"#,
        ] {
            std::fs::write(dir.path().join("labels.json"), text).unwrap();
            for folder in [dir.path(), &masks] {
                let listed = listed_labels(folder).unwrap();
                assert!(
                    listed.tree.is_none()
                        && listed.warning.unwrap().contains("labels.json was not used"),
                    "{text}"
                );
            }
        }
        for bytes in [
            &br#"[{"id":1,"name":"a","parent":2}]"#[..],
            b"[{\"id\":1,\"name\":\"\xe4\"}]",
        ] {
            std::fs::write(dir.path().join("labels.json"), bytes).unwrap();
            assert!(
                listed_labels(&masks).unwrap().warning.is_some(),
                "not in the given folder"
            );
            assert!(listed_labels(dir.path()).is_err());
        }
        std::fs::write(
            dir.path().join("labels.json"),
            "\u{feff}[{\"id\":1,\"name\":\"a\"}]",
        )
        .unwrap();
        assert!(listed_labels(&masks).unwrap().tree.is_some());
    }
}
