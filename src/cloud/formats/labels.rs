//! Names, colours and class numbers of labels in files.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

use serde::Serialize;

use crate::ply::{file_part, label_name};
use crate::whole_file::{unplaced, write_whole};
use crate::{SceneError, UNLABELLED_COLOR};
use ostra_masks::{LabelId, LabelTree};

/// Returns the names from the root of the tree down to a label, as in `plant/leaf`.
pub(super) fn path_name(tree: &LabelTree, id: LabelId) -> String {
    let path = tree.path(id);
    match path.is_empty() {
        true => label_name(tree, id),
        false => path
            .iter()
            .map(|&id| label_name(tree, id))
            .collect::<Vec<_>>()
            .join("/"),
    }
}

/// Returns a unique name per label, derived from its path.
///
/// The names consist only of letters, digits, `-`, `_` and `/`.
pub(super) fn safe_names(
    tree: &LabelTree,
    ids: impl Iterator<Item = LabelId>,
) -> BTreeMap<LabelId, String> {
    let mut taken = BTreeSet::new();
    let name = |id| {
        let path = path_name(tree, id);
        let mut name = path.split('/').map(file_part).collect::<Vec<_>>().join("/");
        while !taken.insert(name.clone()) {
            name = format!("{name}_{}", id.0);
        }
        (id, name)
    };
    ids.map(name).collect()
}

/// Returns the colour of a label, or grey if the tree does not have it.
pub(super) fn color_of(tree: &LabelTree, id: LabelId) -> [u8; 3] {
    tree.get(id).map_or(UNLABELLED_COLOR, |label| label.color)
}

/// First class without a standard meaning.
///
/// Classes below it are assigned by the standard (2 = ground, 6 = building, …): ASPRS, "LAS
/// Specification 1.4-R15", 2019, table 17.
const FIRST_CLASS: u8 = 64;

/// Returns the LAS class of each label, which is the class of its top-level label.
///
/// Top-level labels are numbered from 64. If there are more than 192 of them, the remaining ones
/// share class 255.
pub(super) fn classes(tree: &LabelTree) -> BTreeMap<LabelId, u8> {
    let tops: Vec<LabelId> = tree
        .iter()
        .filter(|label| label.parent.is_none())
        .map(|label| label.id)
        .collect();
    let class = |id: LabelId| {
        let rank = tops
            .iter()
            .position(|&top| top == tree.at_level(id, 1))
            .unwrap_or(tops.len());
        FIRST_CLASS.saturating_add(u8::try_from(rank).unwrap_or(u8::MAX))
    };
    tree.iter()
        .map(|label| (label.id, class(label.id)))
        .collect()
}

#[derive(Serialize)]
struct LabelEntry<'a> {
    id: LabelId,
    name: &'a str,
    parent: Option<LabelId>,
    color: String,
    las_class: u8,
}

pub(super) fn save(path: &Path, tree: &LabelTree) -> Result<(), SceneError> {
    let classes = classes(tree);
    let entries: Vec<LabelEntry<'_>> = tree
        .iter()
        .map(|label| {
            let [red, green, blue] = label.color;
            let color = format!("#{red:02x}{green:02x}{blue:02x}");
            LabelEntry {
                id: label.id,
                name: &label.name,
                parent: label.parent,
                color,
                las_class: classes[&label.id],
            }
        })
        .collect();
    write_whole(path, |out| {
        let text =
            serde_json::to_string_pretty(&entries).map_err(|error| unplaced(error.into()))?;
        writeln!(out, "{text}").map_err(unplaced)
    })
}
