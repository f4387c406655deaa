use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::carry::{Testimony, Witnesses};
use ostra_core::job::Progress;
use ostra_masks::MaskError;

/// What anchors say of the frames of a walk, asked for a few frames at once: one for each thread.
pub struct Ahead<'a> {
    witnesses: &'a Witnesses<'a>,
    ready: BTreeMap<usize, Result<Option<Testimony>, MaskError>>,
}

impl<'a> Ahead<'a> {
    pub fn new(witnesses: &'a Witnesses<'a>) -> Self {
        Self {
            witnesses,
            ready: BTreeMap::new(),
        }
    }

    /// What they say of a frame, with the frames that will be asked for next; `None` where they cannot be asked
    /// or it cannot be read.
    ///
    /// # Errors
    /// As [`Witnesses::tell_of`].
    pub fn take(
        &mut self,
        frame: usize,
        next: impl Iterator<Item = usize>,
        progress: &Progress,
    ) -> Result<Option<Testimony>, MaskError> {
        if !self.witnesses.can_tell_of(frame) {
            return Ok(None);
        }
        if !self.ready.contains_key(&frame) {
            let next = next.filter(|&frame| self.witnesses.can_tell_of(frame));
            let frames: Vec<usize> = [frame]
                .into_iter()
                .chain(next)
                .take(rayon::current_num_threads())
                .collect();
            let told = frames
                .into_par_iter()
                .map(|frame| (frame, self.witnesses.tell_of(frame, progress)));
            self.ready = told.collect();
        }
        Ok(self.ready.remove(&frame).transpose()?.flatten())
    }
}
