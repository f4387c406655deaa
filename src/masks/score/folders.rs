use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::table::{FramePair, MaskScore, misfit, score_pairs};
use crate::formats::{
    FoundFile, NameIndex, PngValues, Skipped, White, ids_in, ids_of_colors, in_parallel,
    is_black_and_white, list_files, listed_labels, meaning_of_white, reconcile_cut_outs,
    unless_stopped, white_as_one,
};
use crate::{LabelId, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// How two folders of masks are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ScoreOptions {
    /// Leave out the first frame (in natural order), whose mask is often given to the method.
    pub skip_first: bool,
    /// Read labels deeper than this as their ancestor there (1 = top), by `labels.json` in either folder.
    pub level: Option<usize>,
}

/// A folder's masks as ids.
struct Folder {
    files: Vec<FoundFile>,
    masks: Vec<RunMask>,
    tree: Option<LabelTree>,
    ids: BTreeSet<LabelId>,
    /// What was decided while reading, for the user.
    warnings: Vec<String>,
}

/// Scores a folder of mask PNGs against one of true masks. Files are matched by name without ending: path below the
/// folder, then file name alone. Pixels are label ids, equal numbers are the same label: palette places (not colours),
/// grey values of up to 16 bits, or the colours that a `labels.json` in the folder lists. The labels scored are those
/// in the truth. A truth whose only value besides 0 is 255 (and which lists no label 255) means label 1; so does such a
/// result, unless 255 is a label of the truth. Next to smaller ids 255 means void. A true mask without result counts as
/// an empty result, and so does a result of another size. Files that cannot be read are left out, with a warning.
///
/// # Errors
/// [`MaskError::Io`], [`MaskError::Invalid`] for a folder without masks that can be read, names of which none match;
/// [`MaskError::Request`] where no result has the size of its true mask, or for a level without `labels.json`;
/// [`MaskError::Stopped`].
pub fn score_masks(
    truth_dir: &Path,
    result_dir: &Path,
    options: &ScoreOptions,
    progress: &Progress,
) -> Result<MaskScore, MaskError> {
    progress.stage("read masks")?;
    let mut truth = Folder::read(truth_dir, progress)?;
    let mut result = Folder::read(result_dir, progress)?;
    if is_black_and_white(&truth.ids, truth.tree.as_ref()) {
        truth.map(white_as_one);
    }
    let void = without_void(&mut truth, &mut result);
    if is_black_and_white(&result.ids, result.tree.as_ref()) && !truth.ids.contains(&LabelId(255)) {
        result.map(white_as_one);
    }
    if let Some(level) = options.level {
        read_at_level(&mut truth, &mut result, level)?;
    }
    let mut warnings: Vec<String> = [&truth, &result]
        .into_iter()
        .flat_map(|folder| folder.warnings.clone())
        .collect();
    warnings.extend(void);
    let mut pairs = pairs(&truth, &result, (truth_dir, result_dir), &mut warnings)?;
    if options.skip_first {
        pairs.remove(0);
    }
    truth.ids.remove(&LabelId::NONE);
    let extra: Vec<String> = result
        .ids
        .difference(&truth.ids)
        .filter(|id| id.0 != 0)
        .map(|id| id.0.to_string())
        .collect();
    if !extra.is_empty() {
        warnings.push(format!(
            "labels that only the result has are not scored: {}",
            extra.join(", ")
        ));
    }
    progress.stage("score masks")?;
    let mut score = score_pairs(&pairs, &truth.ids, progress)?;
    let tree = truth.tree.as_ref().or(result.tree.as_ref());
    for label in &mut score.labels {
        label.name = tree
            .and_then(|tree| tree.get(label.id))
            .map(|label| label.name.clone());
    }
    score.warnings = warnings;
    Ok(score)
}

impl Folder {
    fn read(dir: &Path, progress: &Progress) -> Result<Self, MaskError> {
        let found = list_files(dir, &["png"])?;
        if found.is_empty() {
            let what = "holds no PNG; give the folder of the masks".into();
            return Err(MaskError::Invalid {
                path: dir.to_path_buf(),
                what,
            });
        }
        let listed = listed_labels(dir)?;
        let tree = listed.tree;
        let colors = tree.as_ref().map(ids_of_colors);
        let read_file = |file: &FoundFile| -> Result<_, MaskError> {
            let read = PngValues::read(&file.path, None)?.into_ids(&file.path, colors.as_ref())?;
            Ok((RunMask::encode(&read.mask), read.how))
        };
        let results = in_parallel(&found, progress, |file| unless_stopped(read_file(file)))?;
        let (mut skipped, mut first_error) = (Skipped::default(), None);
        let (mut files, mut read) = (Vec::new(), Vec::new());
        for (file, result) in found.into_iter().zip(results) {
            match result {
                Ok(one) => {
                    files.push(file);
                    read.push(one);
                }
                Err(error) => {
                    skipped.add_unreadable(&error);
                    first_error.get_or_insert(error);
                }
            }
        }
        if let Some(error) = first_error.filter(|_| files.is_empty()) {
            return Err(error);
        }
        reconcile_cut_outs(read.iter_mut().map(|(mask, how)| (mask, how)));
        for (file, (_, how)) in files.iter().zip(&read) {
            for what in how.warnings() {
                skipped.add(what, file.path.display().to_string());
            }
        }
        let masks: Vec<RunMask> = read.into_iter().map(|(mask, _)| mask).collect();
        let ids = ids_in(&masks);
        Ok(Self {
            files,
            masks,
            tree,
            ids,
            warnings: listed
                .warning
                .into_iter()
                .chain(skipped.warnings())
                .collect(),
        })
    }

    fn map(&mut self, change: impl Fn(&RunMask) -> RunMask) {
        self.masks = self.masks.iter().map(change).collect();
        self.ids = ids_in(&self.masks);
    }
}

/// Removes the value that means void in the truth from both folders. It stays in a black and white result, where it is
/// the object.
fn without_void(truth: &mut Folder, result: &mut Folder) -> Option<String> {
    let known = |id| {
        truth
            .tree
            .as_ref()
            .is_some_and(|tree| tree.get(id).is_some())
    };
    let White::Void(void) = meaning_of_white(&truth.ids, known) else {
        return None;
    };
    let cleared = |mask: &RunMask| mask.map_ids(|id| if id == void { LabelId::NONE } else { id });
    truth.map(cleared);
    if !is_black_and_white(&result.ids, result.tree.as_ref()) {
        result.map(cleared);
    }
    Some(format!(
        "the value {} means void next to smaller ids; its pixels were taken as unlabelled",
        void.0
    ))
}

/// Each folder by its own tree, or by the other's where it has none.
fn read_at_level(truth: &mut Folder, result: &mut Folder, level: usize) -> Result<(), MaskError> {
    let missing = || {
        let what = "levels are not known: there is no labels.json; put the one that `ostra masks export` writes beside \
                    the masks";
        MaskError::Request(what.into())
    };
    let truth_tree = truth
        .tree
        .clone()
        .or_else(|| result.tree.clone())
        .ok_or_else(missing)?;
    let result_tree = result.tree.clone().unwrap_or_else(|| truth_tree.clone());
    truth.map(|mask| mask.at_level(&truth_tree, level));
    result.map(|mask| mask.at_level(&result_tree, level));
    Ok(())
}

/// Every true mask with its result, in natural order.
fn pairs(
    truth: &Folder,
    result: &Folder,
    (truth_dir, result_dir): (&Path, &Path),
    warnings: &mut Vec<String>,
) -> Result<Vec<FramePair>, MaskError> {
    let index = NameIndex::new(truth.files.iter().map(|file| file.stem.as_str()));
    let matched = index.match_files(result_dir, &result.files)?;
    if matched.pairs.is_empty() {
        let (first, other) = (&result.files[0].stem, &truth.files[0].stem);
        let what = format!(
            "no mask has the name of one in {} (first '{first}' and '{other}'); name the results as the truth",
            truth_dir.display()
        );
        return Err(MaskError::Invalid {
            path: result_dir.to_path_buf(),
            what,
        });
    }
    let mut pairs: Vec<FramePair> = truth
        .files
        .iter()
        .zip(&truth.masks)
        .map(|(file, mask)| FramePair {
            name: file.stem.clone(),
            truth: mask.clone(),
            result: RunMask::empty(mask.width, mask.height),
        })
        .collect();
    let mut has_result = vec![false; pairs.len()];
    let masks: BTreeMap<&Path, &RunMask> = result
        .files
        .iter()
        .map(|file| file.path.as_path())
        .zip(&result.masks)
        .collect();
    let (count, mut misfits) = (matched.pairs.len(), Vec::new());
    for (frame, file) in matched.pairs {
        let (mask, pair) = (masks[file.path.as_path()], &mut pairs[frame]);
        has_result[frame] = true;
        if (mask.width, mask.height) == (pair.truth.width, pair.truth.height) {
            pair.result.clone_from(mask);
        } else {
            misfits.push(misfit(pair, mask));
        }
    }
    if let Some(first) = misfits.first() {
        if misfits.len() == count {
            return Err(MaskError::Request(first.clone()));
        }
        warnings.push(format!(
            "{} results have another size and count as empty (first: {first})",
            misfits.len()
        ));
    }
    let missing: Vec<&str> = pairs
        .iter()
        .zip(has_result)
        .filter(|(_, has)| !has)
        .map(|(pair, _)| pair.name.as_str())
        .collect();
    if let Some(first) = missing.first() {
        warnings.push(format!(
            "{} true masks have no result and count as empty (first: {first})",
            missing.len()
        ));
    }
    if let Some(first) = matched.unmatched.first() {
        let count = matched.unmatched.len();
        warnings.push(format!(
            "{count} masks of the result have no true mask and were left out (first: {})",
            first.stem
        ));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests;
