use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::{LabelledCloud, SceneError};
use ostra_masks::{LabelId, LabelTree};

/// The points of one label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelPart {
    /// Id of the label; 0 for the unlabelled points.
    pub id: LabelId,
    /// Name of the label; `unlabelled` for id 0.
    pub name: String,
    /// The points of the label, in the order of the whole cloud and with the whole tree.
    pub cloud: LabelledCloud,
}

/// Splits a cloud into one part per label that has points, ordered by id.
///
/// The unlabelled points come first.
#[must_use]
pub fn split_by_label(cloud: &LabelledCloud) -> Vec<LabelPart> {
    let mut indices: BTreeMap<LabelId, Vec<u32>> = BTreeMap::new();
    for (index, &id) in cloud.labels.iter().enumerate() {
        indices.entry(id).or_default().push(index as u32);
    }
    let part = |(id, indices): (LabelId, Vec<u32>)| LabelPart {
        id,
        name: label_name(&cloud.tree, id),
        cloud: cloud.select(&indices),
    };
    indices.into_iter().map(part).collect()
}

/// Writes one file next to `path` ([`label_paths`]) for each label that has points, using `save`.
///
/// Returns the files written.
///
/// # Errors
///
/// Returns the errors of `save`. Files written before the error are kept.
pub fn save_per_label(
    path: &Path,
    cloud: &LabelledCloud,
    save: impl Fn(&Path, &LabelledCloud) -> Result<(), SceneError>,
) -> Result<Vec<PathBuf>, SceneError> {
    let files = label_paths(path, cloud);
    for part in split_by_label(cloud) {
        save(&files[&part.id], &part.cloud)?;
    }
    Ok(files.into_values().collect())
}

/// Maximum length in bytes of a label name in a file name.
///
/// File systems allow 255 for the whole name.
const MAX_NAME_BYTES: usize = 120;

/// Returns the path `STEM_NAME.ENDING` for each label that has points, next to `path`.
///
/// The id of the label is appended to a name that another label of the tree already has, ignoring
/// case, and to the name of the file in label colours.
#[must_use]
pub fn label_paths(path: &Path, cloud: &LabelledCloud) -> BTreeMap<LabelId, PathBuf> {
    let present: BTreeSet<LabelId> = cloud.labels.iter().copied().collect();
    let all: BTreeSet<LabelId> = present
        .iter()
        .copied()
        .chain(cloud.tree.iter().map(|label| label.id))
        .collect();
    let mut taken = BTreeSet::from([TWIN.to_owned()]);
    let mut paths = BTreeMap::new();
    for id in all {
        let mut name = shortened(&file_part(&label_name(&cloud.tree, id)));
        while !taken.insert(name.to_lowercase()) {
            name = format!("{name}_{}", id.0);
        }
        if present.contains(&id) {
            paths.insert(id, adjacent(path, &name));
        }
    }
    paths
}

fn shortened(name: &str) -> String {
    let end = name
        .char_indices()
        .map(|(at, c)| at + c.len_utf8())
        .take_while(|&end| end <= MAX_NAME_BYTES)
        .last();
    name[..end.unwrap_or(0)].to_owned()
}

/// File name suffix of the copy in label colours.
const TWIN: &str = "labels";

/// Returns the path of the copy of a cloud in label colours: `STEM_labels.ENDING`.
#[must_use]
pub fn twin_path(path: &Path) -> PathBuf {
    adjacent(path, TWIN)
}

fn adjacent(path: &Path, suffix: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path
        .extension()
        .map_or("ply".into(), std::ffi::OsStr::to_string_lossy);
    path.with_file_name(format!("{stem}_{suffix}.{ending}"))
}

/// Returns the name of a label: `unlabelled` for id 0, or the id if the tree lacks it.
pub(crate) fn label_name(tree: &LabelTree, id: LabelId) -> String {
    match tree.get(id) {
        Some(label) => label.name.clone(),
        None if id == LabelId::NONE => "unlabelled".into(),
        None => id.0.to_string(),
    }
}

/// Returns a name with all characters replaced that are invalid in file names on some system.
pub(crate) fn file_part(name: &str) -> String {
    name.chars()
        .map(|c| {
            if c.is_alphanumeric() || matches!(c, '-' | '_') {
                c
            } else {
                '_'
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ostra_masks::Label;

    #[test]
    fn exported_files_have_unique_names() {
        let long = "x".repeat(300);
        let names = [
            "labels",
            "Leaf",
            "leaf",
            "a/b",
            "a b",
            &long,
            &format!("{long}y"),
            "unlabelled",
            "leaf_2",
        ];
        let mut cloud = LabelledCloud::from_positions(vec![glam::Vec3::ZERO; names.len() + 1]);
        for (at, name) in names.into_iter().enumerate() {
            let id = LabelId(at as u16 + 1);
            cloud.labels[at] = id;
            cloud
                .tree
                .set(Label {
                    id,
                    name: name.into(),
                    color: [1; 3],
                    parent: None,
                })
                .unwrap();
        }
        let path = Path::new("/out/c.ply");
        let mut files: Vec<PathBuf> = label_paths(path, &cloud)
            .into_values()
            .chain([twin_path(path)])
            .collect();
        let count = files.len();
        assert_eq!(count, names.len() + 2);
        files.sort_by_key(|file| file.to_string_lossy().to_lowercase());
        files.dedup_by_key(|file| file.to_string_lossy().to_lowercase());
        assert_eq!(files.len(), count, "{files:?}");
        assert!(
            files
                .iter()
                .all(|file| file.file_name().unwrap().len() <= 255)
        );
        // The names do not depend on which labels have points.
        let whole = label_paths(path, &cloud);
        let some = label_paths(path, &cloud.select(&[2, 6]));
        assert!(some.iter().all(|(id, file)| whole[id] == *file));
    }
}
