//! A folder of masks without frames, and the matching of two such folders by name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::files::{FoundFile, Skipped, in_parallel, list_files, unless_stopped};
use super::frame_matching::NameIndex;
use super::grey_kinds::{White, ids_in, is_black_and_white, meaning_of_white, white_as_one};
use super::labels_json::{ids_of_colors, listed_labels};
use super::png_values::{PngValues, reconcile_cut_outs};
use crate::{LabelId, LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// Masks of a folder, with pixels as ids.
pub struct MaskFolder {
    dir: PathBuf,
    files: Vec<FoundFile>,
    masks: Vec<RunMask>,
    /// Labels listed by a `labels.json` of the folder.
    pub tree: Option<LabelTree>,
    /// All ids in the masks, including 0.
    pub ids: BTreeSet<LabelId>,
    /// Decisions and faults while reading, for the user.
    pub warnings: Vec<String>,
}

/// Masks of a folder, matched to the masks of another folder.
pub struct MatchedMasks<'f> {
    /// Matched masks in the order of the other folder.
    pub pairs: Vec<MatchedMask<'f>>,
    /// Names of masks that match none of the other folder.
    pub unmatched: Vec<&'f str>,
}

/// A mask that matches one of another folder.
pub struct MatchedMask<'f> {
    /// Index of the matching mask in [`MaskFolder::masks`] of the other folder.
    pub place: usize,
    /// Mask of this folder.
    pub mask: &'f RunMask,
}

impl MaskFolder {
    /// Reads all PNG files below a folder.
    ///
    /// Pixels are label ids: palette indices (not colours), grey values of up to 16 bits, or the
    /// colours listed by a `labels.json` of the folder. Unreadable files are skipped with a
    /// warning.
    ///
    /// # Errors
    /// [`MaskError::Io`]; [`MaskError::Invalid`] for a folder without readable masks;
    /// [`MaskError::Stopped`].
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

    /// Returns the name of each mask in natural order.
    ///
    /// A name is the path below the folder without extension.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(|file| file.stem.as_str())
    }

    /// Returns the masks in the order of their names.
    #[must_use]
    pub fn masks(&self) -> &[RunMask] {
        &self.masks
    }

    /// Replaces each mask by the result of `change`.
    pub fn map(&mut self, change: impl Fn(&RunMask) -> RunMask) {
        self.masks = self.masks.iter().map(change).collect();
        self.ids = ids_in(&self.masks);
    }

    /// Returns whether the masks are black and white images of one object.
    ///
    /// Their only value besides 0 is 255 (65535 in 16 bits), and no listed label has that id.
    #[must_use]
    pub fn is_black_and_white(&self) -> bool {
        is_black_and_white(&self.ids, self.tree.as_ref())
    }

    /// Sets every labelled pixel to label 1.
    pub fn read_white_as_one(&mut self) {
        self.map(white_as_one);
    }

    /// Returns the value that means "void" next to smaller ids.
    ///
    /// A value with a listed label is not void.
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

    /// Matches each mask to the mask of `truth` with its name.
    ///
    /// Names match by the path below the folder, then by the file name alone.
    ///
    /// # Errors
    /// [`MaskError::Invalid`] when no name matches, or two masks match the same one equally well.
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
