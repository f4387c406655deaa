use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};

use crate::evaluate::frames::{PIXEL_BYTES, read_frames, readable_frames};
use ostra_core::job::Progress;
use ostra_frames::{Frame, FrameStore};
use ostra_masks::{LabelId, LabelTree, MaskFormat, MaskFrame, RunMask, import_masks};
use ostra_project::Project;

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
    /// masks, matched by name as by [`import_masks`]. Frames whose image or depth cannot be read are left out. Gives with it
    /// what the user should know.
    ///
    /// # Errors
    /// When no frame or no mask can be read, or no mask belongs to a frame.
    pub fn open(frames: &Path, truth: &Path, progress: &Progress) -> Result<(Self, Vec<String>)> {
        // Depths that a reconstruction made lie in the project's folder.
        let store = FrameStore::at_home(PIXEL_BYTES, frames.to_owned());
        let (frames, mut warnings) = read_frames(frames, progress)?;
        let read = |frame: &Frame| {
            store
                .image(frame)
                .and_then(|_| store.depth(frame))
                .map(drop)
        };
        let (frames, unreadable) = readable_frames(frames, read, progress)?;
        warnings.extend(unreadable);
        let sized: Vec<MaskFrame<'_>> = frames.iter().map(MaskFrame::from).collect();
        let imported = import_masks(
            truth,
            MaskFormat::Davis,
            &sized,
            &LabelTree::default(),
            progress,
        )?;
        warnings.extend(imported.warnings);
        let labels = LabelTree::try_from(imported.new_labels)?;
        let (frames, store) = (Arc::new(frames), Arc::new(store));
        Ok((
            Self {
                frames,
                store,
                labels,
                truth: imported.masks,
            },
            warnings,
        ))
    }

    /// The labels that the truth shows anywhere.
    #[must_use]
    pub fn shown(&self) -> BTreeSet<LabelId> {
        self.truth
            .keys()
            .flat_map(|&frame| self.shown_on(frame))
            .collect()
    }

    /// The labels that the truth shows on a frame.
    #[must_use]
    pub fn shown_on(&self, frame: usize) -> Vec<LabelId> {
        self.truth
            .get(&frame)
            .map(|mask| mask.extents().into_keys().collect())
            .unwrap_or_default()
    }

    /// The true mask of a frame.
    ///
    /// # Errors
    /// When there is none.
    pub fn truth_of(&self, frame: usize) -> Result<&RunMask> {
        self.truth
            .get(&frame)
            .with_context(|| format!("frame {frame} has no true mask"))
    }

    /// A project in memory with the frames and labels, and nothing else.
    #[must_use]
    pub fn project(&self) -> Project {
        Project {
            frames: Arc::clone(&self.frames),
            labels: self.labels.clone(),
            ..Project::default()
        }
    }
}
