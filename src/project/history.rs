use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::Edit;
use ostra_masks::{LabelId, Prompt, RunMask};

/// An edit with its inverse.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// The edit.
    pub edit: Edit,
    /// Its inverse.
    pub inverse: Edit,
}

/// The unit of undo: a brush stroke, a prompt, a whole tracking run.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Title to display, e.g. `Paint leaf on frame 3`.
    pub title: String,
    /// Changes in the order in which they were made.
    pub changes: Vec<Change>,
}

/// The undo and redo stacks of a project.
///
/// The history does not hold the project, only the edits that lead back and forth. It is cheap to
/// clone.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    done: Vec<Arc<Step>>,
    undone: Vec<Arc<Step>>,
}

impl Change {
    /// Returns the pixels of a frame's mask before the change, if the change affects them.
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
    /// Returns the edits that redo the step.
    #[must_use]
    pub fn forth(&self) -> Vec<Edit> {
        self.changes
            .iter()
            .map(|change| change.edit.clone())
            .collect()
    }

    /// Returns the edits that undo the step, last change first.
    #[must_use]
    pub fn back(&self) -> Vec<Edit> {
        self.changes
            .iter()
            .rev()
            .map(|change| change.inverse.clone())
            .collect()
    }

    /// Returns the frame, label and prompt if the step is the answer to one prompt.
    #[must_use]
    pub fn answered_prompt(&self) -> Option<(usize, LabelId, &Prompt)> {
        let mut answered = None;
        for change in &self.changes {
            match &change.edit {
                Edit::SetPrompt {
                    frame,
                    label,
                    prompt: Some(prompt),
                } if answered.is_none() => answered = Some((*frame, *label, prompt)),
                Edit::SetPrompt { .. } | Edit::SetLabel { .. } => return None,
                Edit::SetMask { frame, .. } if answered.is_none_or(|(of, ..)| of != *frame) => {
                    return None;
                }
                _ => {}
            }
        }
        answered
    }

    /// Returns the approximate size of the step in memory and on disk, in bytes.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.changes
            .iter()
            .map(|change| change.edit.bytes() + change.inverse.bytes())
            .sum()
    }
}

impl History {
    /// Adds a new step and clears the redo stack.
    pub fn push(&mut self, step: Step) {
        self.undone.clear();
        self.done.push(Arc::new(step));
    }

    /// Adds changes to the last step, or creates a step if there is none.
    ///
    /// A tracking run arrives in several parts.
    pub fn extend(&mut self, step: Step) {
        self.undone.clear();
        match self.done.last_mut() {
            Some(last) => Arc::make_mut(last).changes.extend(step.changes),
            None => self.done.push(Arc::new(step)),
        }
    }

    /// Moves the last step to the redo stack.
    pub fn undo(&mut self) {
        self.undone.extend(self.done.pop());
    }

    /// Moves the last undone step back to the undo stack.
    pub fn redo(&mut self) {
        self.done.extend(self.undone.pop());
    }

    /// Returns the step that undo would revert.
    #[must_use]
    pub fn last(&self) -> Option<&Arc<Step>> {
        self.done.last()
    }

    /// Returns the step that redo would apply again.
    #[must_use]
    pub fn next(&self) -> Option<&Arc<Step>> {
        self.undone.last()
    }

    /// Returns the pixels of a frame's mask before the last step that changed them.
    ///
    /// The mask is empty if the frame had none at that time.
    #[must_use]
    pub fn mask_before(&self, frame: usize) -> Option<Arc<RunMask>> {
        let before = |step: &Arc<Step>| {
            step.changes
                .iter()
                .find_map(|change| change.pixels_before(frame))
        };
        self.done.iter().rev().find_map(before)
    }

    /// Returns all steps, oldest first, and the number of steps at the end that are undone.
    pub fn steps(&self) -> (impl Iterator<Item = &Arc<Step>>, usize) {
        (
            self.done.iter().chain(self.undone.iter().rev()),
            self.undone.len(),
        )
    }

    /// Drops the oldest steps until the total size is at most `bytes`.
    ///
    /// The newest step is always kept. Returns whether any step was dropped.
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
