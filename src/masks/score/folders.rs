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
mod tests {
    use super::*;
    use crate::{Label, MaskFormat, MaskFrame, export_masks};

    fn mask(ids: [u16; 12]) -> RunMask {
        RunMask::new(4, 3, ids.map(|id| (LabelId(id), 1)).to_vec()).unwrap()
    }

    fn write(dir: &Path, masks: &[(&str, [u16; 12])], tree: &LabelTree) {
        let frames: Vec<MaskFrame<'_>> = masks
            .iter()
            .map(|&(name, _)| MaskFrame {
                name,
                width: 4,
                height: 3,
            })
            .collect();
        let masks = masks.iter().map(|&(_, ids)| mask(ids)).enumerate();
        export_masks(
            dir,
            MaskFormat::Davis,
            &frames,
            masks,
            tree,
            &Progress::default(),
        )
        .unwrap();
        if tree.iter().next().is_none() {
            std::fs::remove_file(dir.join("labels.json")).unwrap();
        }
    }

    fn score(
        truth: &[(&str, [u16; 12])],
        result: &[(&str, [u16; 12])],
        tree: &LabelTree,
        options: ScoreOptions,
    ) -> Result<MaskScore, MaskError> {
        let dir = tempfile::tempdir().unwrap();
        let (truth_dir, result_dir) = (dir.path().join("truth"), dir.path().join("result"));
        write(&truth_dir, truth, tree);
        write(&result_dir, result, &LabelTree::default());
        score_masks(&truth_dir, &result_dir, &options, &Progress::default())
    }

    const HALF: [u16; 12] = [1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0];
    const FULL: [u16; 12] = [1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0];

    #[test]
    fn names_match_without_ending_and_frames_without_result_count_as_empty() {
        let none = LabelTree::default();
        let truth = [("2.jpg", FULL), ("10.jpg", FULL), ("11.jpg", FULL)];
        let result = [("x/2.png", HALF), ("10.png", FULL), ("99.png", FULL)];
        let found = score(&truth, &result, &none, ScoreOptions::default()).unwrap();
        assert!((found.j - (0.5 + 1.0 + 0.0) / 3.0).abs() < 1e-12);
        assert_eq!(
            found.labels[0]
                .frames
                .iter()
                .map(|frame| frame.frame.as_str())
                .collect::<Vec<_>>(),
            ["2", "10", "11"]
        );
        assert_eq!(found.warnings.len(), 2, "{:?}", found.warnings);
        let later = score(
            &truth,
            &result,
            &none,
            ScoreOptions {
                skip_first: true,
                level: None,
            },
        )
        .unwrap();
        assert!(
            (later.j - 0.5).abs() < 1e-12,
            "the first in natural order is left out"
        );
        assert_eq!(later.frames, 2);
    }

    #[test]
    fn white_is_label_one_on_either_side() {
        let none = LabelTree::default();
        let white = HALF.map(|id| id * 255);
        let j = |truth, result| {
            let found = score(
                &[("a", truth)],
                &[("a", result)],
                &none,
                ScoreOptions::default(),
            )
            .unwrap();
            (found.j, found.labels[0].id.0, found.warnings.len())
        };
        assert_eq!(j(white, white), (1.0, 1, 0));
        assert_eq!(j(white, HALF), (1.0, 1, 0));
        assert_eq!(j(HALF, white), (1.0, 1, 0));
        let mut with_void = HALF;
        with_void[11] = 255;
        assert_eq!(
            j(with_void, HALF),
            (1.0, 1, 1),
            "next to label 1 the 255 of the truth is void, which is reported"
        );
        assert_eq!(
            j(with_void, with_void),
            (1.0, 1, 1),
            "so it is in the result"
        );
        assert_eq!(
            j(with_void, white),
            (1.0, 1, 1),
            "in a black and white result it is the object"
        );
    }

    #[test]
    fn what_transparency_removes_is_reported() {
        let dir = tempfile::tempdir().unwrap();
        let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
        write(&truth, &[("a", HALF)], &LabelTree::default());
        std::fs::create_dir(&result).unwrap();
        let image = image::GrayAlphaImage::from_fn(4, 3, |x, y| {
            image::LumaA([
                HALF[(y * 4 + x) as usize] as u8,
                if x == 0 { 0 } else { 255 },
            ])
        });
        image.save(result.join("a.png")).unwrap();
        let found = score_masks(
            &truth,
            &result,
            &ScoreOptions::default(),
            &Progress::default(),
        )
        .unwrap();
        assert!(
            (found.j - 0.5).abs() < 1e-12 && found.warnings[0].contains("transparent pixels"),
            "{found:?}"
        );
    }

    #[test]
    fn levels_are_read_off_the_list_of_either_side() {
        let label = |id: u16, name: &str, parent: Option<u16>| Label {
            id: LabelId(id),
            name: name.into(),
            color: [0; 3],
            parent: parent.map(LabelId),
        };
        let tree: LabelTree = vec![label(1, "rice", None), label(2, "stem", Some(1))]
            .try_into()
            .unwrap();
        let (truth, result) = ([("a", FULL)], [("a", FULL.map(|id| id * 2))]);
        let level = |level| ScoreOptions {
            skip_first: false,
            level,
        };
        assert!(score(&truth, &result, &tree, level(None)).unwrap().j.abs() < 1e-12);
        let coarse = score(&truth, &result, &tree, level(Some(1))).unwrap();
        assert!((coarse.j - 1.0).abs() < 1e-12);
        assert_eq!(coarse.labels[0].name.as_deref(), Some("rice"));
        let error = score(&truth, &result, &LabelTree::default(), level(Some(1)))
            .unwrap_err()
            .to_string();
        assert!(error.contains("labels.json"), "{error}");
    }

    #[test]
    fn files_that_cannot_be_read_are_left_out_and_named() {
        let dir = tempfile::tempdir().unwrap();
        let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
        let masks = [("a", FULL), ("b", FULL), ("c", FULL)];
        write(&truth, &masks, &LabelTree::default());
        write(&result, &masks, &LabelTree::default());
        let score = || {
            score_masks(
                &truth,
                &result,
                &ScoreOptions::default(),
                &Progress::default(),
            )
        };
        for path in [truth.join("a.png"), result.join("b.png")] {
            let whole = std::fs::read(&path).unwrap();
            std::fs::write(&path, &whole[..20]).unwrap();
        }
        let found = score().unwrap();
        assert!(
            found.frames == 2 && (found.j - 0.5).abs() < 1e-12,
            "a result that is damaged is empty: {found:?}"
        );
        let said = found.warnings.join("; ");
        assert!(
            said.contains("a.png") && said.contains("b.png") && said.contains("count as empty"),
            "{said}"
        );
        for name in ["a.png", "c.png"] {
            std::fs::write(result.join(name), "").unwrap();
        }
        assert!(
            score().unwrap_err().to_string().contains("a.png"),
            "the first of them, where none can be read"
        );
    }

    #[test]
    fn results_of_another_size_count_as_empty() {
        let dir = tempfile::tempdir().unwrap();
        let (truth, result) = (dir.path().join("truth"), dir.path().join("result"));
        let masks = [("a", FULL), ("b", FULL)];
        write(&truth, &masks, &LabelTree::default());
        write(&result, &masks, &LabelTree::default());
        let shrink = |name: &str| {
            image::GrayImage::from_pixel(2, 2, image::Luma([1]))
                .save(result.join(name))
                .unwrap();
            score_masks(
                &truth,
                &result,
                &ScoreOptions::default(),
                &Progress::default(),
            )
        };
        let found = shrink("b.png").unwrap();
        assert!(
            found.frames == 2 && (found.j - 0.5).abs() < 1e-12,
            "{found:?}"
        );
        assert!(
            found.warnings.len() == 1 && found.warnings[0].contains("b: the result is 2×2"),
            "{found:?}"
        );
        let error = shrink("a.png").unwrap_err().to_string();
        assert!(
            error.contains("a: the result is 2×2") && error.contains("4×3"),
            "where none fits: {error}"
        );
    }

    #[test]
    fn what_cannot_be_scored_is_told() {
        let none = LabelTree::default();
        let options = ScoreOptions::default();
        assert!(
            score(&[("a", FULL)], &[("b", FULL)], &none, options)
                .unwrap_err()
                .to_string()
                .contains("'b'")
        );
        assert!(
            score(&[("a", [0; 12])], &[("a", FULL)], &none, options).is_err(),
            "no label in the truth"
        );
        assert!(
            score(
                &[("a", FULL)],
                &[("a", FULL)],
                &none,
                ScoreOptions {
                    skip_first: true,
                    level: None
                }
            )
            .is_err()
        );
        assert!(score(&[], &[("a", FULL)], &none, options).is_err());
        let extra = score(
            &[("a", FULL)],
            &[("a", FULL.map(|id| if id == 0 { 4 } else { id }))],
            &none,
            options,
        )
        .unwrap();
        assert!(extra.warnings[0].ends_with(": 4"), "{:?}", extra.warnings);
    }
}
