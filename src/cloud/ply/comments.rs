//! Origin and labels in the comments of a PLY file.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec3;

use ostra_masks::{Label, LabelId, LabelTree, MAX_DEPTH};

/// Returns the comment lines that store a label tree in a PLY header.
///
/// The lines are `label ID PARENT NAME`, then `color ID RRGGBB`. They are ASCII, which is all that
/// PLY headers may hold (plyfile rejects anything else).
pub(crate) fn comments_of(tree: &LabelTree) -> Vec<String> {
    let names = tree.iter().map(|label| {
        let parent = label.parent.map_or(0, |id| id.0);
        format!("label {} {parent} {}", label.id.0, escaped(&label.name))
    });
    let colors = tree.iter().map(|label| {
        let [red, green, blue] = label.color;
        format!("color {} {red:02x}{green:02x}{blue:02x}", label.id.0)
    });
    names.chain(colors).collect()
}

/// Returns the comment line `origin X Y Z` that stores a non-zero origin.
///
/// It has enough digits to read the same numbers back.
pub(crate) fn origin_comment(origin: DVec3) -> Option<String> {
    let DVec3 { x, y, z } = origin;
    (origin != DVec3::ZERO).then(|| format!("origin {x} {y} {z}"))
}

/// Returns the origin stored in the comments of a header, or zero if there is none.
pub(super) fn origin_from_comments(comments: &[String]) -> DVec3 {
    let origin = |comment: &String| -> Option<DVec3> {
        let numbers: Vec<f64> = comment
            .strip_prefix("origin ")?
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()
            .ok()?;
        <[f64; 3]>::try_from(numbers)
            .ok()
            .map(DVec3::from_array)
            .filter(|origin| origin.is_finite())
    };
    comments.iter().find_map(origin).unwrap_or_default()
}

/// Returns the label tree stored in the comments of a header.
///
/// Lines that are neither a label nor a colour are ignored. A parent that is missing, part of a
/// cycle or too deep is dropped, which moves the label to the top level. A name that is already
/// taken gets a number: `leaf (2)`.
pub(super) fn tree_from_comments(comments: &[String]) -> LabelTree {
    let mut labels: Vec<Label> = comments
        .iter()
        .filter_map(|comment| label_from(comment))
        .collect();
    let mut listed = BTreeSet::new();
    labels.retain(|label| listed.insert(label.id));
    number_repeated_names(&mut labels);
    let mut below: BTreeMap<Option<LabelId>, Vec<Label>> = BTreeMap::new();
    for mut label in labels {
        label.parent = label.parent.filter(|parent| listed.contains(parent));
        below.entry(label.parent).or_default().push(label);
    }
    let mut tree = LabelTree::default();
    // The top level comes first. The remaining labels form cycles, and one label of each moves to
    // the top level.
    while let Some((_, mut open)) = below.pop_first() {
        open.reverse();
        while let Some(label) = open.pop() {
            open.extend(
                below
                    .remove(&Some(label.id))
                    .unwrap_or_default()
                    .into_iter()
                    .rev(),
            );
            add(&mut tree, label);
        }
    }
    for (id, color) in comments.iter().filter_map(|comment| color_from(comment)) {
        recolor(&mut tree, id, color);
    }
    tree
}

fn label_from(comment: &str) -> Option<Label> {
    let mut words = comment.strip_prefix("label ")?.splitn(3, ' ');
    let id = LabelId(words.next()?.parse().ok()?);
    let parent: u16 = words.next()?.parse().ok()?;
    let name = unescaped(words.next()?.trim());
    let known = id != LabelId::NONE && !name.is_empty();
    known.then(|| Label {
        id,
        name,
        color: LabelTree::color_for(id),
        parent: (parent != 0).then_some(LabelId(parent)),
    })
}

fn color_from(comment: &str) -> Option<(LabelId, [u8; 3])> {
    let (id, hex) = comment.strip_prefix("color ")?.split_once(' ')?;
    let hex = hex.trim();
    let value = u32::from_str_radix(hex, 16)
        .ok()
        .filter(|_| hex.len() == 6)?;
    let [_, red, green, blue] = value.to_be_bytes();
    Some((LabelId(id.parse().ok()?), [red, green, blue]))
}

/// Appends a number to each name that an earlier label already has.
///
/// The next number of a name is remembered, so that thousands of equal names take no longer than
/// different ones.
fn number_repeated_names(labels: &mut [Label]) {
    let mut taken: BTreeSet<String> = BTreeSet::new();
    let mut next: BTreeMap<String, usize> = BTreeMap::new();
    for label in labels {
        let name = label.name.clone();
        while !taken.insert(label.name.clone()) {
            let number = next
                .entry(name.clone())
                .and_modify(|number| *number += 1)
                .or_insert(2);
            label.name = format!("{name} ({number})");
        }
    }
}

/// Returns the name in printable ASCII.
///
/// Other characters become `\u{HEX}`, and so does a backslash before `u{`.
pub(crate) fn escaped(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for (at, c) in name.char_indices() {
        match c {
            '\\' if name[at + 1..].starts_with("u{") => text.push_str("\\u{5c}"),
            ' '..='~' => text.push(c),
            _ => text.extend(c.escape_unicode()),
        }
    }
    text
}

/// Reverts [`escaped`]; text that is not an escape sequence is unchanged.
fn unescaped(text: &str) -> String {
    let mut name = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("\\u{") {
        name.push_str(&rest[..at]);
        let inside = &rest[at + 3..];
        let decoded = inside.find('}').and_then(|end| {
            let value =
                u32::from_str_radix(inside.get(..end).filter(|hex| hex.len() <= 6)?, 16).ok()?;
            Some((char::from_u32(value)?, end))
        });
        let (c, skipped) = decoded.map_or(('\\', at + 1), |(c, end)| (c, at + 3 + end + 1));
        name.push(c);
        rest = &rest[skipped..];
    }
    name.push_str(rest);
    name
}

fn add(tree: &mut LabelTree, mut label: Label) {
    label.parent = label
        .parent
        .filter(|&parent| (1..MAX_DEPTH).contains(&tree.depth(parent)));
    // The tree's invariants hold: the parent exists, the name is free, and the id is new and not 0.
    let _ = tree.set(label);
}

fn recolor(tree: &mut LabelTree, id: LabelId, color: [u8; 3]) {
    if let Some(label) = tree.get(id).cloned() {
        let _ = tree.set(Label { color, ..label });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_survive_a_round_trip_as_ascii() {
        for name in [
            "leaf",
            "Stängel",
            "名前",
            "a\\b",
            "\\u{41}",
            "C:\\users{1}",
            "tab\tand é\u{202e}",
            "\\",
            "\\u{zz}",
        ] {
            let text = escaped(name);
            assert!(
                text.bytes().all(|byte| (b' '..=b'~').contains(&byte)),
                "{text}"
            );
            assert_eq!(unescaped(&text), name, "{text}");
        }
        // Files written before names were escaped.
        assert_eq!(unescaped("Stängel \\u{ and \\x"), "Stängel \\u{ and \\x");
    }

    #[test]
    fn thousands_of_equal_names_are_numbered() {
        let comments: Vec<String> = (1..=2000).map(|id| format!("label {id} 0 a")).collect();
        let tree = tree_from_comments(&comments);
        assert_eq!(tree.iter().count(), 2000);
        assert_eq!(tree.get(LabelId(2000)).unwrap().name, "a (2000)");
    }
}
