use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};

use crate::engine::job::Progress;
use crate::frames::{Frame, FrameStore};
use crate::masks::{LabelId, LabelTree, MaskFormat, MaskFrame, RunMask, import_masks};
use crate::session::Project;
use crate::session::evaluate::frames::{PIXEL_BYTES, read_frames};

/// Frames with true masks.
pub struct Sequence {
    /// All frames in order.
    pub frames: Arc<Vec<Frame>>,
    /// Where their pictures are loaded.
    pub store: Arc<FrameStore>,
    /// The labels of the truth.
    pub labels: LabelTree,
    /// True masks by frame number, each of its frame's size; a frame without one is tracked but not judged.
    pub truth: BTreeMap<usize, RunMask>,
}

impl Sequence {
    /// Opens frames (a folder, a film, or a project, whose frames have depth and cameras) and the folder of their true
    /// masks, matched by name as by [`import_masks`]. Gives with it what the user should know.
    ///
    /// # Errors
    /// When frames or masks cannot be read, or no mask belongs to a frame.
    pub fn open(frames: &Path, truth: &Path, progress: &Progress) -> Result<(Self, Vec<String>)> {
        let (frames, mut warnings) = read_frames(frames, progress)?;
        let sized: Vec<MaskFrame<'_>> = frames.iter().map(MaskFrame::from).collect();
        let imported = import_masks(truth, MaskFormat::Davis, &sized, &LabelTree::default(), progress)?;
        warnings.extend(imported.warnings);
        let labels = LabelTree::try_from(imported.new_labels)?;
        let store = Arc::new(FrameStore::new(PIXEL_BYTES));
        Ok((Self { frames: Arc::new(frames), store, labels, truth: imported.masks }, warnings))
    }

    /// The labels that the truth shows anywhere.
    #[must_use]
    pub fn shown(&self) -> BTreeSet<LabelId> {
        self.truth.keys().flat_map(|&frame| self.shown_on(frame)).collect()
    }

    /// The labels that the truth shows on a frame.
    #[must_use]
    pub fn shown_on(&self, frame: usize) -> Vec<LabelId> {
        self.truth.get(&frame).map(|mask| mask.extents().into_keys().collect()).unwrap_or_default()
    }

    /// The true mask of a frame.
    ///
    /// # Errors
    /// When there is none.
    pub fn truth_of(&self, frame: usize) -> Result<&RunMask> {
        self.truth.get(&frame).with_context(|| format!("frame {frame} has no true mask"))
    }

    /// A project in memory with the frames and labels, and nothing else.
    #[must_use]
    pub fn project(&self) -> Project {
        Project { frames: Arc::clone(&self.frames), labels: self.labels.clone(), ..Project::default() }
    }
}
