use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Edit;
use ostra_masks::RunMask;

/// An edit with the one that takes it back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// What was done.
    pub edit: Edit,
    /// What takes it back.
    pub inverse: Edit,
}

/// What one undo takes back: a brush stroke, a prompt, a whole tracking run.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// For people, e.g. `Paint leaf on frame 3`.
    pub title: String,
    /// In the order they were made.
    pub changes: Vec<Change>,
}

/// Steps done and steps taken back. Holds no project: it says which edits lead back and forth. Cheap to clone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    done: Vec<Arc<Step>>,
    undone: Vec<Arc<Step>>,
}

impl Change {
    /// The pixels of a frame's mask before the change, where it changes them.
    fn pixels_before(&self, frame: usize) -> Option<Arc<RunMask>> {
        let runs = |edit: &Edit| match edit {
            Edit::SetMask { frame: of, mask } if *of == frame => {
                Some(mask.as_ref().map(|mask| Arc::clone(&mask.runs)))
            }
            _ => None,
        };
        let (after, before) = (runs(&self.edit)?, runs(&self.inverse)?);
        if before == after {
            return None;
        }
        let empty = |runs: Arc<RunMask>| Arc::new(RunMask::empty(runs.width, runs.height));
        before.or_else(|| after.map(empty))
    }
}

impl Step {
    /// The edits that do the step again.
    #[must_use]
    pub fn forth(&self) -> Vec<Edit> {
        self.changes
            .iter()
            .map(|change| change.edit.clone())
            .collect()
    }

    /// The edits that take the step back, last change first.
    #[must_use]
    pub fn back(&self) -> Vec<Edit> {
        self.changes
            .iter()
            .rev()
            .map(|change| change.inverse.clone())
            .collect()
    }

    /// About as many bytes as the step takes in memory and on disk.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.changes
            .iter()
            .map(|change| change.edit.bytes() + change.inverse.bytes())
            .sum()
    }
}

impl History {
    /// Adds a step just made; what had been taken back can no longer be done again.
    pub fn push(&mut self, step: Step) {
        self.undone.clear();
        self.done.push(Arc::new(step));
    }

    /// Adds changes to the last step (a tracking run arrives in pieces); without one they become a step.
    pub fn extend(&mut self, step: Step) {
        self.undone.clear();
        match self.done.last_mut() {
            Some(last) => Arc::make_mut(last).changes.extend(step.changes),
            None => self.done.push(Arc::new(step)),
        }
    }

    /// Moves the last step to those taken back.
    pub fn undo(&mut self) {
        self.undone.extend(self.done.pop());
    }

    /// Moves the step taken back last to those done.
    pub fn redo(&mut self) {
        self.done.extend(self.undone.pop());
    }

    /// The step that undo takes back.
    #[must_use]
    pub fn last(&self) -> Option<&Arc<Step>> {
        self.done.last()
    }

    /// The step that redo does again.
    #[must_use]
    pub fn next(&self) -> Option<&Arc<Step>> {
        self.undone.last()
    }

    /// The pixels of a frame's mask before the last step that changed them; empty where the frame had no mask then.
    #[must_use]
    pub fn mask_before(&self, frame: usize) -> Option<Arc<RunMask>> {
        let before = |step: &Arc<Step>| {
            step.changes
                .iter()
                .find_map(|change| change.pixels_before(frame))
        };
        self.done.iter().rev().find_map(before)
    }

    /// All steps, oldest first, and how many of the last are taken back.
    pub fn steps(&self) -> (impl Iterator<Item = &Arc<Step>>, usize) {
        (
            self.done.iter().chain(self.undone.iter().rev()),
            self.undone.len(),
        )
    }

    /// Forgets the oldest steps until all take at most `bytes`; the newest step is always kept. Says whether any
    /// was forgotten.
    pub fn keep(&mut self, bytes: usize) -> bool {
        let mut total: usize = self
            .done
            .iter()
            .chain(&self.undone)
            .map(|step| step.bytes())
            .sum();
        let mut forgotten = 0;
        while total > bytes && self.done.len() - forgotten > 1 {
            total -= self.done[forgotten].bytes();
            forgotten += 1;
        }
        self.done.drain(..forgotten);
        forgotten > 0
    }
}

impl Edit {
    fn bytes(&self) -> usize {
        match self {
            Self::SetMask {
                mask: Some(mask), ..
            } => 64 + 8 * mask.runs.runs.len(),
            Self::AddFrames { frames } => 512 * frames.len(),
            Self::SetStale { frames, .. } => 32 + 8 * frames.len(),
            Self::SetFrame { .. } => 512,
            Self::SetPrompt {
                prompt: Some(prompt),
                ..
            } => 64 * (1 + prompt.clicks.len() + prompt.boxes.len()),
            _ => 128,
        }
    }
}
