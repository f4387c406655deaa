use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::files::{invalid, io_error, write_whole};
use crate::masks::{Label, LabelId, LabelTree, MaskError};

/// The name of the file with the label tree, beside masks.
pub(super) const LABELS_FILE: &str = "labels.json";

/// A label as it stands in the file: `{"id": 2, "name": "stem 1", "parent": 1, "color": "#3cb44b"}`.
#[derive(Serialize, Deserialize)]
struct LabelEntry {
    id: LabelId,
    name: String,
    /// `null` = top level.
    #[serde(default)]
    parent: Option<LabelId>,
    #[serde(default)]
    color: Option<Color>,
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Color {
    /// `#rrggbb`.
    Text(String),
    /// Red, green, blue.
    Channels([u8; 3]),
}

/// Writes `labels.json` into a folder of masks: a list of `{"id", "name", "parent", "color"}`, parents by their id or
/// null, colours as `#rrggbb`.
///
/// # Errors
/// [`MaskError::Io`].
pub fn write_labels_json(dir: &Path, tree: &LabelTree) -> Result<(), MaskError> {
    let entry = |label: &Label| {
        let [red, green, blue] = label.color;
        let color = Some(Color::Text(format!("#{red:02x}{green:02x}{blue:02x}")));
        serde_json::to_string(&LabelEntry { id: label.id, name: label.name.clone(), parent: label.parent, color })
    };
    let path = dir.join(LABELS_FILE);
    let lines: Vec<String> =
        tree.iter().map(entry).collect::<Result<_, _>>().map_err(|error| io_error(&path)(error.into()))?;
    let text = if lines.is_empty() { "[]\n".into() } else { format!("[\n  {}\n]\n", lines.join(",\n  ")) };
    write_whole(&path, text.as_bytes())
}

/// Reads the `labels.json` of a folder of masks: the one in it, else the one in the folder above (as the made scene's
/// truth has it); `None` when there is none. Colours may be `[r, g, b]` too; a label without colour gets one.
///
/// # Errors
/// [`MaskError::Io`], or [`MaskError::Invalid`] for a file that is no label tree.
pub fn read_labels_json(dir: &Path) -> Result<Option<LabelTree>, MaskError> {
    let above = dir.canonicalize().ok().and_then(|full| Some(full.parent()?.to_path_buf()));
    let mut files = [Some(dir.to_path_buf()), above].into_iter().flatten().map(|folder| folder.join(LABELS_FILE));
    files.find(|file| file.is_file()).map(|file| read_tree(&file)).transpose()
}

fn read_tree(path: &Path) -> Result<LabelTree, MaskError> {
    let text = std::fs::read_to_string(path).map_err(io_error(path))?;
    let broken = |error: &dyn std::fmt::Display| invalid(path, format!("is no list of labels ({error}); put it right"));
    let entries: Vec<LabelEntry> = serde_json::from_str(&text).map_err(|error| broken(&error))?;
    let label = |entry: LabelEntry| {
        let color = match &entry.color {
            None => LabelTree::color_for(entry.id),
            Some(Color::Channels(channels)) => *channels,
            Some(Color::Text(text)) => {
                parse_color(text).ok_or_else(|| broken(&format!("colour '{text}' is not #rrggbb")))?
            }
        };
        Ok(Label { id: entry.id, name: entry.name, color, parent: entry.parent })
    };
    let labels: Vec<Label> = entries.into_iter().map(label).collect::<Result<_, MaskError>>()?;
    LabelTree::try_from(labels).map_err(|error| broken(&error))
}

/// Which label has which colour, for masks saved as colour pictures; a colour of two labels is left out.
pub(in crate::masks) fn ids_of_colors(tree: &LabelTree) -> BTreeMap<[u8; 3], LabelId> {
    let mut found: BTreeMap<[u8; 3], Vec<LabelId>> = BTreeMap::new();
    for label in tree.iter() {
        found.entry(label.color).or_default().push(label.id);
    }
    found.into_iter().filter(|(_, ids)| ids.len() == 1).map(|(color, ids)| (color, ids[0])).collect()
}

fn parse_color(text: &str) -> Option<[u8; 3]> {
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
    let channel = |at: usize| u8::from_str_radix(&digits[at..at + 2], 16).ok();
    Some([channel(0)?, channel(2)?, channel(4)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tree_survives_its_file() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read_labels_json(dir.path()).unwrap(), None);
        let label = |id: u16, name: &str, parent: Option<u16>| Label {
            id: LabelId(id),
            name: name.into(),
            color: [0, 10, 255],
            parent: parent.map(LabelId),
        };
        let tree: LabelTree = vec![label(1, "rice \"A\"", Some(700)), label(700, "Ä/b", None)].try_into().unwrap();
        write_labels_json(dir.path(), &tree).unwrap();
        assert_eq!(read_labels_json(dir.path()).unwrap().as_ref(), Some(&tree));
        std::fs::create_dir(dir.path().join("masks")).unwrap();
        assert_eq!(read_labels_json(&dir.path().join("masks")).unwrap(), Some(tree));
        let text = std::fs::read_to_string(dir.path().join("labels.json")).unwrap();
        assert!(text.contains(r##""color":"#000aff""##) && text.contains(r#""parent":null"#), "{text}");
    }

    #[test]
    fn colours_in_every_form() {
        let dir = tempfile::tempdir().unwrap();
        let text =
            r##"[{"id":1,"name":"a","color":"#0102ff"},{"id":2,"name":"b","color":[3,4,5]},{"id":3,"name":"c"}]"##;
        std::fs::write(dir.path().join("labels.json"), text).unwrap();
        let tree = read_labels_json(dir.path()).unwrap().unwrap();
        let colors: Vec<[u8; 3]> = tree.iter().map(|label| label.color).collect();
        assert_eq!(colors, [[1, 2, 255], [3, 4, 5], LabelTree::color_for(LabelId(3))]);
    }

    #[test]
    fn broken_files_are_told() {
        let dir = tempfile::tempdir().unwrap();
        for text in [
            "{",
            r#"{"labels":[]}"#,
            r#"[{"id":0,"name":"a"}]"#,
            r#"[{"id":1,"name":"a","parent":2}]"#,
            r#"[{"id":1,"name":"a"},{"id":1,"name":"b"}]"#,
            r##"[{"id":1,"name":"a","color":"#12é45"}]"##,
            r#"[{"id":70000,"name":"a"}]"#,
        ] {
            std::fs::write(dir.path().join("labels.json"), text).unwrap();
            let error = read_labels_json(dir.path()).unwrap_err().to_string();
            assert!(error.contains("labels.json"), "{error}");
        }
    }
}
