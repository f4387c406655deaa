use serde::{Deserialize, Serialize};
use std::path::Path;

use super::table::{FramePair, MaskScore, misfit, score_pairs};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, MaskError, MaskFolder, RunMask};

/// Options for the comparison of two folders of masks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct ScoreOptions {
    /// Whether the first frame (in natural order) is left out.
    ///
    /// Its mask is often given to the method.
    pub skip_first: bool,
    /// Depth in the label tree (1 = top); deeper labels are replaced by their ancestor there.
    ///
    /// The tree is the `labels.json` of either folder.
    pub level: Option<usize>,
}

/// Scores a folder of mask PNGs against a folder of ground truth masks.
///
/// Files are matched by name without extension: first by path below the folder, then by file name
/// alone. Pixels are label ids: palette indices (not colours), grey values of up to 16 bits, or the
/// colours that a `labels.json` in the folder lists. Equal ids are the same label. Only labels in
/// the ground truth are scored.
///
/// A ground truth whose only value besides 0 is 255 (and which lists no label 255) has label 1
/// there. The same holds for a result, unless 255 is a label of the ground truth. If there are
/// smaller ids as well, 255 means void.
///
/// A missing result, or one of another size, counts as empty. Unreadable files are left out, with a
/// warning.
///
/// # Errors
/// Returns [`MaskError::Io`] or [`MaskError::Invalid`] if a folder has no readable masks or no
/// names match. Returns [`MaskError::Request`] if no result has the size of its ground truth mask,
/// or if a level is given without `labels.json`. Returns [`MaskError::Stopped`] if stopped.
pub fn score_masks(
    truth_dir: &Path,
    result_dir: &Path,
    options: &ScoreOptions,
    progress: &Progress,
) -> Result<MaskScore, MaskError> {
    progress.stage("read masks")?;
    let mut truth = MaskFolder::read(truth_dir, progress)?;
    let mut result = MaskFolder::read(result_dir, progress)?;
    if truth.is_black_and_white() {
        truth.read_white_as_one();
    }
    let void = without_void(&mut truth, &mut result);
    if result.is_black_and_white() && !truth.ids.contains(&LabelId(255)) {
        result.read_white_as_one();
    }
    if let Some(level) = options.level {
        read_at_level(&mut truth, &mut result, level)?;
    }
    let mut warnings: Vec<String> = [&truth, &result]
        .into_iter()
        .flat_map(|folder| folder.warnings.clone())
        .collect();
    warnings.extend(void);
    let mut pairs = pairs(&truth, &result, &mut warnings)?;
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

/// Removes the void value of the ground truth from both folders.
///
/// A black and white result keeps it, because there it is the object.
fn without_void(truth: &mut MaskFolder, result: &mut MaskFolder) -> Option<String> {
    let void = truth.void_value()?;
    let cleared = |mask: &RunMask| mask.map_ids(|id| if id == void { LabelId::NONE } else { id });
    truth.map(cleared);
    if !result.is_black_and_white() {
        result.map(cleared);
    }
    Some(format!(
        "the value {} means void next to smaller ids; its pixels were taken as unlabelled",
        void.0
    ))
}

/// Applies the level to each folder by its own tree, or by the other's if it has none.
fn read_at_level(
    truth: &mut MaskFolder,
    result: &mut MaskFolder,
    level: usize,
) -> Result<(), MaskError> {
    let missing = || {
        let what = "levels are not known: there is no labels.json; put the one that `ostra masks export` writes next \
                    to the masks";
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

/// Returns every ground truth mask with its result, in natural order.
fn pairs(
    truth: &MaskFolder,
    result: &MaskFolder,
    warnings: &mut Vec<String>,
) -> Result<Vec<FramePair>, MaskError> {
    let matched = result.matched_to(truth)?;
    let mut pairs: Vec<FramePair> = truth
        .names()
        .zip(truth.masks())
        .map(|(name, mask)| FramePair {
            name: name.to_owned(),
            truth: mask.clone(),
            result: RunMask::empty(mask.width, mask.height),
        })
        .collect();
    let mut has_result = vec![false; pairs.len()];
    let (count, mut misfits) = (matched.pairs.len(), Vec::new());
    for one in matched.pairs {
        let (mask, pair) = (one.mask, &mut pairs[one.place]);
        has_result[one.place] = true;
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
            "{count} masks of the result have no true mask and were left out (first: {first})"
        ));
    }
    Ok(pairs)
}

#[cfg(test)]
mod tests;
