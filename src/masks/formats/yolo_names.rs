//! Class names of a YOLO data set: `data.yaml` (its `names` only), `classes.txt` or `obj.names`.

use std::path::Path;

use super::files::{invalid, io_error};
use crate::masks::MaskError;

/// Reads the names in a folder, by class number; empty when there is no such file.
pub(super) fn read_names(dir: &Path) -> Result<Vec<String>, MaskError> {
    for (file, parse) in [
        ("data.yaml", yaml_names as fn(&str) -> Option<Vec<String>>),
        ("data.yml", yaml_names),
        ("dataset.yaml", yaml_names),
        ("classes.txt", plain_names),
        ("obj.names", plain_names),
    ] {
        let path = dir.join(file);
        if path.is_file() {
            let text = std::fs::read_to_string(&path).map_err(io_error(&path))?;
            return parse(&text).ok_or_else(|| invalid(&path, "has no readable `names`; list them as `0: name`"));
        }
    }
    Ok(Vec::new())
}

/// `data.yaml` for names in the order of their class numbers.
pub(super) fn yaml(names: &[String]) -> String {
    let mut text = String::from("path: .\ntrain: images\nval: images\nnames:\n");
    for (class, name) in names.iter().enumerate() {
        // Single quotes: nothing in between means anything but '' for a quote.
        text.push_str(&format!("  {class}: '{}'\n", name.replace('\'', "''")));
    }
    text
}

fn plain_names(text: &str) -> Option<Vec<String>> {
    Some(text.lines().map(|line| line.trim().to_owned()).filter(|line| !line.is_empty()).collect())
}

/// `names:` as a list or a map, in brackets on one line or one entry a line.
fn yaml_names(text: &str) -> Option<Vec<String>> {
    let mut lines = text.lines();
    let first = lines.find_map(|line| line.strip_prefix("names:"))?.trim();
    if let Some(open) = first.strip_prefix(['[', '{']) {
        let rest: Vec<&str> = std::iter::once(open).chain(lines).collect();
        return numbered(&split_outside_quotes(rest.join(" ").split_once([']', '}'])?.0));
    }
    let block = lines.map(str::trim_end).filter(|line| !line.trim().is_empty() && !line.trim().starts_with('#'));
    let block = block.take_while(|line| line.starts_with([' ', '\t', '-']));
    let entries: Vec<String> = block.map(|line| line.trim().trim_start_matches("- ").to_owned()).collect();
    numbered(&entries)
}

/// Puts entries (`name` or `number: name`) in the order of their numbers.
fn numbered(entries: &[String]) -> Option<Vec<String>> {
    let mut names = Vec::new();
    for (at, entry) in entries.iter().map(|entry| entry.trim()).filter(|entry| !entry.is_empty()).enumerate() {
        let keyed = entry.split_once(':').and_then(|(key, name)| Some((key.trim().parse().ok()?, name)));
        let (class, name): (usize, &str) = keyed.unwrap_or((at, entry));
        if class > usize::from(u16::MAX) {
            return None;
        }
        names.resize(names.len().max(class + 1), String::new());
        names[class] = unquoted(name.trim());
    }
    (!names.is_empty()).then_some(names)
}

fn split_outside_quotes(text: &str) -> Vec<String> {
    let mut entries = vec![String::new()];
    let mut quote = None;
    for c in text.chars() {
        match (quote, c) {
            (None, ',') => entries.push(String::new()),
            (None, '\'' | '"') => quote = Some(c),
            (Some(open), _) if open == c => quote = None,
            _ => {}
        }
        if let (true, Some(entry)) = (c != ',' || quote.is_some(), entries.last_mut()) {
            entry.push(c);
        }
    }
    entries
}

fn unquoted(text: &str) -> String {
    let inner = |quote: char| text.strip_prefix(quote).and_then(|rest| rest.split_once(quote)).map(|(name, _)| name);
    let single = text.strip_prefix('\'').and_then(|rest| rest.strip_suffix('\'')).map(|name| name.replace("''", "'"));
    let bare = || text.split_once(" #").map_or(text, |(name, _)| name).trim().to_owned();
    single.or_else(|| inner('"').map(str::to_owned)).unwrap_or_else(bare)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_in_every_usual_form() {
        for text in [
            "train: x\nnames:\n  0: leaf\n  1: 'stem 1'\n  2: \"it's\"\nnc: 3\n",
            "names: [leaf, 'stem 1', \"it's\"]\n",
            "nc: 3\nnames:\n- leaf\n- stem 1\n- it's\n",
            "names: {0: leaf, 1: stem 1, 2: \"it's\"}",
            "names:\n  # comment\n  - leaf  # green\n\n  - 'stem 1'\n  - 'it''s'\nother: 1",
            "names: ['leaf',\n  'stem 1', \"it's\"]",
            "names:\n  2: it's\n  0: leaf\n  1: stem 1",
        ] {
            assert_eq!(yaml_names(text).unwrap(), ["leaf", "stem 1", "it's"], "{text}");
        }
        assert_eq!(yaml_names("nc: 3"), None);
        assert_eq!(yaml_names("names:\n  9999999: x"), None);
        assert_eq!(plain_names("leaf\r\n\nstem 1\n").unwrap(), ["leaf", "stem 1"]);
    }

    #[test]
    fn written_names_are_read_again() {
        let names = ["a: b", "it's", "\"x\", #y", "[z]", "Ä"].map(String::from).to_vec();
        assert_eq!(yaml_names(&yaml(&names)).unwrap(), names);
    }
}
