use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::ply::{file_part, label_name};
use crate::{SceneError, UNLABELLED_COLOR};
use ostra_masks::{LabelId, LabelTree};

/// What the ending of a file stands for.
pub(super) fn by_ending<T: Copy, const N: usize>(
    path: &Path,
    known: [(T, &str); N],
    what: &str,
) -> Result<T, SceneError> {
    let ending = path.extension().unwrap_or_default();
    let found = known
        .iter()
        .find(|(_, name)| ending.eq_ignore_ascii_case(name));
    found.map(|(format, _)| *format).ok_or_else(|| {
        let names: Vec<String> = known.iter().map(|(_, name)| format!(".{name}")).collect();
        let what = format!(
            "{what} cannot be written under this ending; give a name that ends in {}",
            names.join(", ")
        );
        SceneError::Invalid {
            path: path.to_path_buf(),
            what,
        }
    })
}

/// The names from the top of the tree down to a label: `plant/leaf`.
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

/// For each label a name like its path, of letters, digits, `-`, `_` and `/` alone and no other label's.
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

/// A label's colour; grey for none.
pub(super) fn color_of(tree: &LabelTree, id: LabelId) -> [u8; 3] {
    tree.get(id).map_or(UNLABELLED_COLOR, |label| label.color)
}
