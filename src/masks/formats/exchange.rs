use std::borrow::Borrow;
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::frame_matching::{Export, Imported, MaskFrame, file_stems};
use super::{binary, coco, davis, yolo};
use crate::{LabelTree, MaskError, RunMask};
use ostra_core::job::Progress;

/// How masks lie in files. Every format keeps ids, names, parents and colours; on import a label is found by its name,
/// where there is no name by its number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MaskFormat {
    /// `FRAME.png`, palette or grey, pixel value = label id, and `labels.json`; as in the DAVIS data sets.
    #[default]
    Davis,
    /// `LABEL/FRAME.png`, white where the label is, and `labels.json`; one folder per object, as video segmentation
    /// tools read it.
    Binary,
    /// One JSON of the COCO data set with run-length encoded regions; categories are labels, supercategories parents.
    Coco,
    /// `labels/FRAME.txt` with normalised outlines, `data.yaml` with the names, and `labels.json`.
    Yolo,
}

impl MaskFormat {
    /// All formats, the default first.
    pub const ALL: [Self; 4] = [Self::Davis, Self::Binary, Self::Coco, Self::Yolo];

    /// Its name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Davis => "davis",
            Self::Binary => "binary",
            Self::Coco => "coco",
            Self::Yolo => "yolo",
        }
    }
}

impl FromStr for MaskFormat {
    type Err = MaskError;

    fn from_str(name: &str) -> Result<Self, MaskError> {
        let unknown = || {
            MaskError::Request(format!(
                "there is no mask format '{name}'; use davis, binary, coco or yolo"
            ))
        };
        Self::ALL
            .into_iter()
            .find(|format| format.name() == name)
            .ok_or_else(unknown)
    }
}

/// Reads masks from a folder (for COCO also the file itself). Files are matched to frames by name without ending: full
/// path, then file name alone. Files (or entries) that are damaged or of another size than their frame are left out and
/// named in the warnings.
///
/// # Errors
/// [`MaskError::Io`], [`MaskError::Invalid`] when no file can be used, nothing fits a frame, or the values of the masks
/// are no label ids; [`MaskError::Stopped`].
pub fn import_masks(
    dir: &Path,
    format: MaskFormat,
    frames: &[MaskFrame<'_>],
    tree: &LabelTree,
    progress: &Progress,
) -> Result<Imported, MaskError> {
    progress.stage("import masks")?;
    match format {
        MaskFormat::Davis => davis::import(dir, frames, tree, progress),
        MaskFormat::Binary => binary::import(dir, frames, tree, progress),
        MaskFormat::Coco => coco::import(dir, frames, tree, progress),
        MaskFormat::Yolo => yolo::import(dir, frames, tree, progress),
    }
}

/// Writes masks (frame number, mask) to a folder, which is made where it is missing; each file is there whole or not at
/// all. Pixels go out under the label they carry, the deepest (see [`RunMask::at_level`] for coarser ones).
///
/// # Errors
/// [`MaskError::Io`] for a folder that cannot be written, [`MaskError::Request`] for a mask that does not fit its frame
/// or a frame name that is no file name, [`MaskError::Stopped`].
pub fn export_masks<M: Borrow<RunMask>>(
    dir: &Path,
    format: MaskFormat,
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
                "the mask of frame {frame} has not the frame's size; make it anew"
            )));
        }
    }
    let export = Export {
        frames,
        stems: file_stems(frames)?,
        masks,
        tree,
    };
    match format {
        MaskFormat::Davis => davis::export(dir, &export, progress),
        MaskFormat::Binary => binary::export(dir, &export, progress),
        MaskFormat::Coco => coco::export(dir, &export, progress),
        MaskFormat::Yolo => yolo::export(dir, &export, progress),
    }
}
