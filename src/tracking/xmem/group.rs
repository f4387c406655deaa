use std::ops::Range;

use rayon::prelude::*;

use super::elements::{Elements, Widths, row};
use super::similarity::{Lookup, Match, best, prototypes};

/// How much XMem sees and remembers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XMemOptions {
    /// Shorter side of the pictures that the networks see, in pixels; `None` = as they are. More shows thinner things and
    /// takes longer.
    pub short_side: Option<u32>,
    /// Every so many frames one is remembered, at least 1.
    pub remember_every: usize,
    /// Frames in working memory at which it is consolidated, at least 2.
    pub most_frames: usize,
    /// Frames that then stay, the first among them: at least 1, fewer than `most_frames`.
    pub least_frames: usize,
    /// Elements of long-term memory that a consolidation makes.
    pub prototypes: usize,
    /// Elements of long-term memory at most; those least used are forgotten.
    pub most_prototypes: usize,
    /// Elements of memory that each cell of a picture is matched with.
    pub matches: usize,
}

impl Default for XMemOptions {
    fn default() -> Self {
        Self {
            short_side: Some(480),
            remember_every: 5,
            most_frames: 10,
            least_frames: 5,
            prototypes: 128,
            most_prototypes: 10_000,
            matches: 30,
        }
    }
}

/// Working and long-term memory of the objects that were first seen on one frame.
#[derive(Debug)]
pub(super) struct Group {
    /// Which of all objects.
    pub objects: Range<usize>,
    /// Whole frames; the first stays.
    working: Elements,
    /// Cells of a frame.
    cells: usize,
    long_term: Elements,
}

/// Cells that are looked up together: as many columns as keep their similarities within a core's cache.
const BLOCK: usize = 32;

impl Group {
    /// Nothing is remembered yet of these objects.
    pub fn new(objects: Range<usize>, widths: Widths, cells: usize) -> Self {
        let empty = Elements::new(widths, objects.len());
        Self {
            objects,
            working: empty.clone(),
            cells,
            long_term: empty,
        }
    }

    /// What memory says of every object: `[objects][value][cells]`, for keys and selections `[cells][key]`.
    pub fn read(&mut self, keys: &[f32], selections: &[f32], options: &XMemOptions) -> Vec<f32> {
        let Widths { key, value } = self.working.widths;
        let stores = [&self.long_term, &self.working]
            .map(|of| (of.keys.as_slice(), of.shrinkages.as_slice()));
        let lookup = Lookup::new(key, &stores);
        let blocks = keys
            .par_chunks(BLOCK * key)
            .zip(selections.par_chunks(BLOCK * key));
        let found = blocks.flat_map_iter(|(keys, selections)| {
            let similar = lookup.similarities(keys, selections);
            similar
                .column_iter()
                .map(|column| best(column.as_slice(), options.matches))
                .collect::<Vec<_>>()
        });
        let found: Vec<Vec<Match>> = found.collect();
        self.note(&found);
        let cells = found.len();
        let mut out = vec![0.0; self.objects.len() * value * cells];
        for (object, out) in out.chunks_exact_mut(value * cells).enumerate() {
            let rows: Vec<f32> = found
                .par_iter()
                .flat_map_iter(|matches| self.mean(object, matches))
                .collect();
            transpose(&rows, value, out);
        }
        out
    }

    /// The mean of an object's values.
    fn mean(&self, object: usize, matches: &[Match]) -> Vec<f32> {
        let width = self.working.widths.value;
        let old = self.long_term.len();
        let mut mean = vec![0.0; width];
        for one in matches {
            let value = match one.element.checked_sub(old) {
                Some(element) => row(&self.working.values[object], element, width),
                None => row(&self.long_term.values[object], one.element, width),
            };
            mean.iter_mut()
                .zip(value)
                .for_each(|(mean, value)| *mean += one.share * value);
        }
        mean
    }

    /// Counts what was used.
    fn note(&mut self, found: &[Vec<Match>]) {
        let old = self.long_term.len();
        for one in found.iter().flatten() {
            match one.element.checked_sub(old) {
                Some(element) => self.working.use_of(element, one.share),
                None => self.long_term.use_of(one.element, one.share),
            }
        }
        self.working.live();
        self.long_term.live();
    }

    /// Remembers a frame; consolidates working memory when it is full.
    pub fn remember(&mut self, frame: &Elements, options: &XMemOptions) {
        self.working.add(frame);
        let (most, least) = (
            options.most_frames * self.cells,
            options.least_frames * self.cells,
        );
        if self.working.len() < most || self.working.len() <= least {
            return;
        }
        let room = options.most_prototypes.saturating_sub(options.prototypes);
        if self.long_term.len() >= room {
            self.long_term.forget(room);
        }
        // The first frame and the last ones stay.
        let candidates = self
            .working
            .take(self.cells..self.working.len() - least + self.cells);
        self.long_term
            .add(&prototypes(&candidates, options.prototypes));
    }

    /// Elements of working and of long-term memory.
    #[cfg(test)]
    pub fn sizes(&self) -> (usize, usize) {
        (self.working.len(), self.long_term.len())
    }
}

/// Rows `[count][width]` to columns `[width][count]`.
pub(super) fn transpose(rows: &[f32], width: usize, out: &mut [f32]) {
    let count = rows.len() / width;
    for (at, row) in rows.chunks_exact(width).enumerate() {
        row.iter()
            .enumerate()
            .for_each(|(part, &value)| out[part * count + at] = value);
    }
}
