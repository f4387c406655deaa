use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::table::{FramePair, MaskScore, score_pairs};
use crate::engine::job::Progress;
use crate::masks::formats::{
    FoundFile, NameIndex, PngValues, ids_in, ids_of_colors, in_parallel, is_black_and_white, list_files, white_as_one,
};
use crate::masks::{LabelId, LabelTree, MaskError, RunMask, read_labels_json};

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
}

/// Scores a folder of mask PNGs against one of true masks. Files are matched by name without ending: path below the
/// folder, then file name alone. Pixels are label ids, equal numbers are the same label: palette places (not colours),
/// grey values of up to 16 bits, or the colours that a `labels.json` in the folder lists. The labels scored are those
/// in the truth. A truth whose only value besides 0 is 255 (and which lists no label 255) means label 1; so does such a
/// result, unless 255 is a label of the truth. A true mask without result counts as an empty result.
///
/// # Errors
/// [`MaskError::Io`], [`MaskError::Invalid`] for a damaged file, a folder without masks, names of which none match;
/// [`MaskError::Request`] for masks of different sizes or a level without `labels.json`; [`MaskError::Stopped`].
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
    if is_black_and_white(&result.ids, result.tree.as_ref()) && !truth.ids.contains(&LabelId(255)) {
        result.map(white_as_one);
    }
    if let Some(level) = options.level {
        read_at_level(&mut truth, &mut result, level)?;
    }
    let mut warnings = Vec::new();
    let mut pairs = pairs(&truth, &result, (truth_dir, result_dir), &mut warnings)?;
    if options.skip_first {
        pairs.remove(0);
    }
    truth.ids.remove(&LabelId::NONE);
    let extra: Vec<String> =
        result.ids.difference(&truth.ids).filter(|id| id.0 != 0).map(|id| id.0.to_string()).collect();
    if !extra.is_empty() {
        warnings.push(format!("labels that only the result has are not scored: {}", extra.join(", ")));
    }
    progress.stage("score masks")?;
    let mut score = score_pairs(&pairs, &truth.ids, progress)?;
    let tree = truth.tree.as_ref().or(result.tree.as_ref());
    for label in &mut score.labels {
        label.name = tree.and_then(|tree| tree.get(label.id)).map(|label| label.name.clone());
    }
    score.warnings = warnings;
    Ok(score)
}

impl Folder {
    fn read(dir: &Path, progress: &Progress) -> Result<Self, MaskError> {
        let files = list_files(dir, &["png"])?;
        if files.is_empty() {
            let what = "holds no PNG; give the folder of the masks".into();
            return Err(MaskError::Invalid { path: dir.to_path_buf(), what });
        }
        let tree = read_labels_json(dir)?;
        let colors = tree.as_ref().map(ids_of_colors);
        let masks = in_parallel(&files, progress, |file| {
            let ids = PngValues::read(&file.path, None)?.into_ids(&file.path, colors.as_ref())?;
            Ok(RunMask::encode(&ids))
        })?;
        let ids = ids_in(&masks);
        Ok(Self { files, masks, tree, ids })
    }

    fn map(&mut self, change: impl Fn(&RunMask) -> RunMask) {
        self.masks = self.masks.iter().map(change).collect();
        self.ids = ids_in(&self.masks);
    }
}

/// Each folder by its own tree, or by the other's where it has none.
fn read_at_level(truth: &mut Folder, result: &mut Folder, level: usize) -> Result<(), MaskError> {
    let missing = || {
        let what = "levels are not known: there is no labels.json; put the one that `ostra masks export` writes beside \
                    the masks";
        MaskError::Request(what.into())
    };
    let truth_tree = truth.tree.clone().or_else(|| result.tree.clone()).ok_or_else(missing)?;
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
        return Err(MaskError::Invalid { path: result_dir.to_path_buf(), what });
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
    let masks: BTreeMap<&Path, &RunMask> =
        result.files.iter().map(|file| file.path.as_path()).zip(&result.masks).collect();
    for (frame, file) in matched.pairs {
        pairs[frame].result.clone_from(masks[file.path.as_path()]);
        has_result[frame] = true;
    }
    let missing: Vec<&str> =
        pairs.iter().zip(has_result).filter(|(_, has)| !has).map(|(pair, _)| pair.name.as_str()).collect();
    if let Some(first) = missing.first() {
        warnings.push(format!("{} true masks have no result and count as empty (first: {first})", missing.len()));
    }
    if let Some(first) = matched.unmatched.first() {
        let count = matched.unmatched.len();
        warnings
            .push(format!("{count} masks of the result have no true mask and were left out (first: {})", first.stem));
    }
    Ok(pairs)
}
