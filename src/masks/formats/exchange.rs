use std::borrow::Borrow;
use std::path::Path;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::frame_matching::{Export, Imported, MaskFrame, file_stems};
use super::{binary, coco, davis, yolo};
use crate::{LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;
use ostra_core::lists::in_words;

/// File format of masks.
///
/// Every format keeps ids, names, parents and colours. On import a label is found by its name, or
/// by its number when it has no name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MaskFormat {
    /// `FRAME.png` with palette or grey values equal to label ids, and `labels.json`.
    ///
    /// The DAVIS data sets use this layout.
    #[default]
    Davis,
    /// `LABEL/FRAME.png`, white inside the label, and `labels.json`.
    ///
    /// Video segmentation tools read such folders, one per object.
    Binary,
    /// One JSON file in COCO format with run-length encoded regions.
    ///
    /// Categories are labels, and supercategories are parents.
    Coco,
    /// `labels/FRAME.txt` with normalised outlines, `data.yaml` with names, and `labels.json`.
    Yolo,
}

impl MaskFormat {
    /// All formats, the default first.
    pub const ALL: [Self; 4] = [Self::Davis, Self::Binary, Self::Coco, Self::Yolo];

    /// Returns the format's name on the command line and in recipes.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Davis => "davis",
            Self::Binary => "binary",
            Self::Coco => "coco",
            Self::Yolo => "yolo",
        }
    }

    /// Reads masks from a folder; for COCO, `dir` may also be the file itself.
    ///
    /// Files are matched to frames by name without extension: by the full path, then by the file
    /// name alone. Damaged files or entries, and those whose size differs from their frame, are
    /// skipped and named in the warnings.
    ///
    /// # Errors
    /// [`MaskError::Io`]; [`MaskError::Invalid`] when no file can be used, nothing matches a frame,
    /// or the mask values are not label ids; [`MaskError::Stopped`].
    pub fn import_masks(
        self,
        dir: &Path,
        frames: &[MaskFrame<'_>],
        tree: &LabelTree,
        progress: &Progress,
    ) -> Result<Imported, MaskError> {
        progress.stage("import masks")?;
        match self {
            Self::Davis => davis::import(dir, frames, tree, progress),
            Self::Binary => binary::import(dir, frames, tree, progress),
            Self::Coco => coco::import(dir, frames, tree, progress),
            Self::Yolo => yolo::import(dir, frames, tree, progress),
        }
    }

    /// Writes masks (frame number, mask) to a folder, creating it if needed.
    ///
    /// Each file is written atomically. Pixels keep their own, deepest label; use
    /// [`RunMask::at_level`] for coarser ones.
    ///
    /// # Errors
    /// [`MaskError::Io`] when the folder cannot be written; [`MaskError::Request`] when a mask does
    /// not fit its frame or a frame name is not a valid file name; [`MaskError::Stopped`].
    pub fn export_masks<M: Borrow<RunMask>>(
        self,
        dir: &Path,
        frames: &[MaskFrame<'_>],
        masks: impl IntoIterator<Item = (usize, M)>,
        tree: &LabelTree,
        progress: &Progress,
    ) -> Result<(), MaskError> {
        progress.stage("export masks")?;
        let held: Vec<(usize, M)> = masks.into_iter().collect();
        let masks: Vec<(usize, &RunMask)> = held
            .iter()
            .map(|(frame, mask)| (*frame, mask.borrow()))
            .collect();
        for &(frame, mask) in &masks {
            let fits = frames
                .get(frame)
                .is_some_and(|frame| (frame.width, frame.height) == (mask.width, mask.height));
            if !fits {
                return Err(MaskError::Request(format!(
                    "the mask of frame {frame} does not have the frame's size; make it again"
                )));
            }
        }
        let export = Export {
            frames,
            stems: file_stems(frames)?,
            masks,
            tree,
        };
        match self {
            Self::Davis => davis::export(dir, &export, progress),
            Self::Binary => binary::export(dir, &export, progress),
            Self::Coco => coco::export(dir, &export, progress),
            Self::Yolo => yolo::export(dir, &export, progress),
        }
    }
}

impl FromStr for MaskFormat {
    type Err = MaskError;

    fn from_str(name: &str) -> Result<Self, MaskError> {
        let unknown = || {
            MaskError::Request(format!(
                "there is no mask format '{name}'; use {}",
                in_words(Self::ALL.map(Self::name), "or")
            ))
        };
        Self::ALL
            .into_iter()
            .find(|format| format.name() == name)
            .ok_or_else(unknown)
    }
}
