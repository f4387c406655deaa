use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::masks::{LabelId, LabelTree};
use crate::scene::{LabelledCloud, SceneError};

/// The points of one label.
#[derive(Debug, Clone, PartialEq)]
pub struct LabelPart {
    /// Its id; 0 for the points without a label.
    pub id: LabelId,
    /// Its name; `unlabelled` for id 0.
    pub name: String,
    /// Its points, in the order of the whole cloud and under the whole tree.
    pub cloud: LabelledCloud,
}

/// Splits a cloud into one part for each label that has points, ordered by id, the unlabelled points first.
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

/// Writes one file for each label that has points beside `path` ([`label_paths`]) by `save`. Returns the files written.
///
/// # Errors
/// Those of `save`; the files before the fault stay.
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

/// Where the parts of a cloud or mesh go that is written to `path`, for each label that has points: `STEM_NAME.ENDING`.
#[must_use]
pub fn label_paths(path: &Path, cloud: &LabelledCloud) -> BTreeMap<LabelId, PathBuf> {
    let ids: BTreeSet<LabelId> = cloud.labels.iter().copied().collect();
    let mut paths: BTreeMap<LabelId, PathBuf> = BTreeMap::new();
    for id in ids {
        let name = file_part(&label_name(&cloud.tree, id));
        let mut file = beside(path, &name);
        if paths.values().any(|taken| *taken == file) {
            file = beside(path, &format!("{name}_{}", id.0));
        }
        paths.insert(id, file);
    }
    paths
}

/// Where the twin of a cloud in label colours goes: `STEM_labels.ENDING` beside it.
#[must_use]
pub fn twin_path(path: &Path) -> PathBuf {
    beside(path, "labels")
}

fn beside(path: &Path, suffix: &str) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().map_or("ply".into(), std::ffi::OsStr::to_string_lossy);
    path.with_file_name(format!("{stem}_{suffix}.{ending}"))
}

/// A label's name; `unlabelled` for id 0, the number of one that the tree lacks.
pub(in crate::scene) fn label_name(tree: &LabelTree, id: LabelId) -> String {
    match tree.get(id) {
        Some(label) => label.name.clone(),
        None if id == LabelId::NONE => "unlabelled".into(),
        None => id.0.to_string(),
    }
}

/// A label's name with everything that a file name cannot hold on some system replaced.
pub(in crate::scene) fn file_part(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || matches!(c, '-' | '_') { c } else { '_' }).collect()
}
