//! A folder of mask files without frames: its masks, matched to those of another folder by name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::files::{FoundFile, Skipped, in_parallel, list_files, unless_stopped};
use super::frame_matching::NameIndex;
use super::grey_kinds::{White, ids_in, is_black_and_white, meaning_of_white, white_as_one};
use super::labels_json::{ids_of_colors, listed_labels};
use super::png_values::{PngValues, reconcile_cut_outs};
use crate::{LabelId, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// A folder's masks as ids.
pub struct MaskFolder {
    dir: PathBuf,
    files: Vec<FoundFile>,
    masks: Vec<RunMask>,
    /// The labels that a `labels.json` in the folder lists.
    pub tree: Option<LabelTree>,
    /// All ids in the masks, 0 among them.
    pub ids: BTreeSet<LabelId>,
    /// What was decided while reading, for the user.
    pub warnings: Vec<String>,
}

/// Which masks of a folder belong to which of another.
pub struct MatchedMasks<'f> {
    /// In the order of the other folder.
    pub pairs: Vec<MatchedMask<'f>>,
    /// Names of the masks that belong to none.
    pub unmatched: Vec<&'f str>,
}

/// A mask that belongs to one of another folder.
pub struct MatchedMask<'f> {
    /// Which of the other folder, by [`MaskFolder::masks`].
    pub place: usize,
    /// The mask.
    pub mask: &'f RunMask,
}

impl MaskFolder {
    /// Reads all PNGs below a folder. Pixels are label ids: palette places (not colours), grey values of up to 16 bits, or
    /// the colours that a `labels.json` in the folder lists. Files that cannot be read are left out, with a warning.
    ///
    /// # Errors
    /// [`MaskError::Io`], [`MaskError::Invalid`] for a folder without masks that can be read; [`MaskError::Stopped`].
    pub fn read(dir: &Path, progress: &Progress) -> Result<Self, MaskError> {
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
            dir: dir.to_path_buf(),
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

    /// The name of each mask, its path below the folder without ending, in natural order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|file| file.stem.as_str())
    }

    /// The masks in the order of their names.
    #[must_use]
    pub fn masks(&self) -> &[RunMask] {
        &self.masks
    }

    /// Puts a changed mask in the place of each.
    pub fn map(&mut self, change: impl Fn(&RunMask) -> RunMask) {
        self.masks = self.masks.iter().map(change).collect();
        self.ids = ids_in(&self.masks);
    }

    /// Whether the masks are black and white images of one object: their only value besides 0 is 255 (65535 in 16 bits),
    /// and no label is listed with that id.
    #[must_use]
    pub fn is_black_and_white(&self) -> bool {
        is_black_and_white(&self.ids, self.tree.as_ref())
    }

    /// Makes every labelled pixel label 1.
    pub fn read_white_as_one(&mut self) {
        self.map(white_as_one);
    }

    /// The value that means "void" next to smaller ids, unless a label is listed with that id.
    #[must_use]
    pub fn void_value(&self) -> Option<LabelId> {
        let known = |id| {
            self.tree
                .as_ref()
                .is_some_and(|tree| tree.get(id).is_some())
        };
        match meaning_of_white(&self.ids, known) {
            White::Void(void) => Some(void),
            _ => None,
        }
    }

    /// Finds for each mask the one of `truth` with its name: path below the folder, then file name alone.
    ///
    /// # Errors
    /// [`MaskError::Invalid`] where no name matches or two masks fit the same one equally well.
    pub fn matched_to(&self, truth: &Self) -> Result<MatchedMasks<'_>, MaskError> {
        let matched = NameIndex::new(truth.names()).match_files(&self.dir, &self.files)?;
        if matched.pairs.is_empty() {
            let (first, other) = (&self.files[0].stem, &truth.files[0].stem);
            let what = format!(
                "no mask has the name of one in {} (first '{first}' and '{other}'); name the results as the truth",
                truth.dir.display()
            );
            return Err(MaskError::Invalid {
                path: self.dir.clone(),
                what,
            });
        }
        let masks: BTreeMap<&Path, &RunMask> = self
            .files
            .iter()
            .map(|file| file.path.as_path())
            .zip(&self.masks)
            .collect();
        let pairs = matched.pairs.into_iter().map(|(place, file)| MatchedMask {
            place,
            mask: masks[file.path.as_path()],
        });
        Ok(MatchedMasks {
            pairs: pairs.collect(),
            unmatched: matched
                .unmatched
                .into_iter()
                .map(|file| file.stem.as_str())
                .collect(),
        })
    }
}
