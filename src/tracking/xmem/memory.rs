use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView};
use rayon::prelude::*;

use super::similarity::{Lookup, Match, best};

/// Options of the XMem tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct XMemOptions {
    /// Shorter side of the network input in pixels; `None` = the image's own.
    ///
    /// More pixels show thinner objects and take longer.
    pub short_side: Option<u32>,
    /// Interval in frames at which one enters memory, at least 1.
    pub remember_every: usize,
    /// Number of frames in working memory at which it is consolidated, at least 2.
    pub most_frames: usize,
    /// Frames that stay after consolidation, at least 1 and fewer than `most_frames`.
    ///
    /// The first frame is always among them.
    pub least_frames: usize,
    /// Elements of long-term memory added per consolidation.
    pub prototypes: usize,
    /// Maximum elements of long-term memory; the least used are forgotten.
    pub most_prototypes: usize,
    /// Number of memory elements that each cell is matched with.
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

/// Working and long-term memory of the objects that first appeared on one frame.
#[derive(Debug)]
pub(super) struct MemoryGroup {
    /// Indices of the objects.
    pub objects: Range<usize>,
    /// Whole frames; the first stays.
    working: Elements,
    /// Number of cells of a frame.
    cells: usize,
    long_term: Elements,
}

/// Cells looked up together.
///
/// The number of columns is chosen so that the similarities stay in a core's cache.
const BLOCK: usize = 32;

impl MemoryGroup {
    /// Creates an empty memory for these objects.
    pub fn new(objects: Range<usize>, widths: Widths, cells: usize) -> Self {
        let empty = Elements::new(widths, objects.len());
        Self {
            objects,
            working: empty.clone(),
            cells,
            long_term: empty,
        }
    }

    /// Reads the memory of every object: `[objects][value][cells]`.
    ///
    /// `keys` and `selections` are `[cells][key]`.
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

    /// Returns the weighted mean of an object's values.
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

    /// Counts the use of memory elements.
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

    /// Adds a frame; consolidates working memory when it is full.
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

    /// Returns the number of elements of working and of long-term memory.
    #[cfg(test)]
    pub fn sizes(&self) -> (usize, usize) {
        (self.working.len(), self.long_term.len())
    }
}

/// Transposes `[count][width]` to `[width][count]`.
pub(super) fn transpose(rows: &[f32], width: usize, out: &mut [f32]) {
    let count = rows.len() / width;
    for (at, row) in rows.chunks_exact(width).enumerate() {
        row.iter()
            .enumerate()
            .for_each(|(part, &value)| out[part * count + at] = value);
    }
}

/// Memory elements: cells of images with a key for matching and a value per object.
#[derive(Debug, Clone)]
pub(super) struct Elements {
    /// Lengths of a key and of a value.
    pub widths: Widths,
    /// Shape `[elements][key]`.
    pub keys: Vec<f32>,
    /// Sharpness of the match of each element, at least 1.
    pub shrinkages: Vec<f32>,
    /// Weights of the key's components, `[elements][key]`; empty if not stored.
    pub selections: Vec<f32>,
    /// Values `[elements][value]` of each object.
    pub values: Vec<Vec<f32>>,
    /// Accumulated use of each element, and the number of frames it was available in.
    uses: Vec<f32>,
    lives: Vec<f32>,
}

/// Lengths of a key and of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Widths {
    pub key: usize,
    pub value: usize,
}

/// Initial lifetime of an element, which avoids a division by 0.
const BORN: f32 = 1e-7;

impl Elements {
    /// Creates an empty memory for this number of objects.
    pub fn new(widths: Widths, objects: usize) -> Self {
        let none = Vec::new;
        let values = vec![Vec::new(); objects];
        Self {
            widths,
            keys: none(),
            shrinkages: none(),
            selections: none(),
            values,
            uses: none(),
            lives: none(),
        }
    }

    pub fn len(&self) -> usize {
        self.shrinkages.len()
    }

    pub fn key(&self, element: usize) -> &[f32] {
        row(&self.keys, element, self.widths.key)
    }

    pub fn selection(&self, element: usize) -> &[f32] {
        row(&self.selections, element, self.widths.key)
    }

    /// Returns the same keys with other values, `[elements][value]` per object.
    pub fn with_values(&self, values: Vec<Vec<f32>>) -> Self {
        Self {
            values,
            ..self.clone()
        }
    }

    /// Adds the elements of another memory, as new ones.
    pub fn add(&mut self, other: &Self) {
        self.keys.extend_from_slice(&other.keys);
        self.shrinkages.extend_from_slice(&other.shrinkages);
        self.selections.extend_from_slice(&other.selections);
        self.values
            .iter_mut()
            .zip(&other.values)
            .for_each(|(own, other)| own.extend_from_slice(other));
        self.uses.resize(self.len(), 0.0);
        self.lives.resize(self.len(), BORN);
    }

    /// Removes and returns a range of elements with their usage.
    pub fn take(&mut self, range: Range<usize>) -> Self {
        let Widths { key, value } = self.widths;
        let wide = |width: usize| range.start * width..range.end * width;
        Self {
            widths: self.widths,
            keys: self.keys.drain(wide(key)).collect(),
            shrinkages: self.shrinkages.drain(range.clone()).collect(),
            selections: self.selections.drain(wide(key)).collect(),
            values: self
                .values
                .iter_mut()
                .map(|values| values.drain(wide(value)).collect())
                .collect(),
            uses: self.uses.drain(range.clone()).collect(),
            lives: self.lives.drain(range).collect(),
        }
    }

    /// Counts a frame in which the elements were available.
    pub fn live(&mut self) {
        self.lives.iter_mut().for_each(|lives| *lives += 1.0);
    }

    /// Adds to the use of an element.
    pub fn use_of(&mut self, element: usize, share: f32) {
        self.uses[element] += share;
    }

    /// Returns the use per frame of each element.
    pub fn usages(&self) -> Vec<f32> {
        self.uses
            .iter()
            .zip(&self.lives)
            .map(|(uses, lives)| uses / lives)
            .collect()
    }

    /// Removes the least used elements so that at most `most` stay.
    ///
    /// Elements with the same usage as the last removed one are removed as well.
    pub fn forget(&mut self, most: usize) {
        let Some(surplus) = self.len().checked_sub(most).filter(|&surplus| surplus > 0) else {
            return;
        };
        let usages = self.usages();
        let mut sorted = usages.clone();
        sorted.sort_unstable_by(f32::total_cmp);
        let stays: Vec<bool> = usages
            .iter()
            .map(|&usage| usage > sorted[surplus - 1])
            .collect();
        let Widths { key, value } = self.widths;
        keep(&mut self.keys, &stays, key);
        keep(&mut self.selections, &stays, key);
        self.values
            .iter_mut()
            .for_each(|values| keep(values, &stays, value));
        [&mut self.shrinkages, &mut self.uses, &mut self.lives]
            .into_iter()
            .for_each(|list| keep(list, &stays, 1));
    }
}

/// Returns one element's part of a list.
pub(super) fn row(list: &[f32], element: usize, width: usize) -> &[f32] {
    &list[element * width..][..width]
}

fn keep(list: &mut Vec<f32>, stays: &[bool], width: usize) {
    let mut at = 0;
    list.retain(|_| {
        at += 1;
        stays[(at - 1) / width]
    });
}

/// Creates long-term elements from the most used candidates.
///
/// Each gets the mean value and shrinkage of all candidates, weighted by similarity.
fn prototypes(candidates: &Elements, count: usize) -> Elements {
    let chosen = most_used(&candidates.usages(), count);
    let widths = candidates.widths;
    let of = |part: fn(&Elements, usize) -> &[f32]| -> Vec<f32> {
        chosen
            .iter()
            .flat_map(|&element| part(candidates, element))
            .copied()
            .collect()
    };
    let (keys, selections) = (of(Elements::key), of(Elements::selection));
    let lookup = Lookup::new(widths.key, &[(&candidates.keys, &candidates.shrinkages)]);
    let mut shares = lookup.similarities(&keys, &selections);
    for mut column in shares.column_iter_mut() {
        let most = column.max();
        column.apply(|value| *value = (*value - most).exp());
        column /= column.sum();
    }
    let mut made = Elements::new(widths, candidates.values.len());
    made.keys = keys;
    made.shrinkages = mean_rows(&candidates.shrinkages, 1, &shares);
    made.values = candidates
        .values
        .iter()
        .map(|values| mean_rows(values, widths.value, &shares))
        .collect();
    made
}

/// Returns the mean of rows `[elements][width]` for each column of weights in `shares`.
fn mean_rows(rows: &[f32], width: usize, shares: &DMatrix<f32>) -> Vec<f32> {
    let mut out = DMatrix::zeros(width, shares.ncols());
    out.gemm(
        1.0,
        &DMatrixView::from_slice(rows, width, shares.nrows()),
        shares,
        0.0,
    );
    out.data.into()
}

/// Returns the `count` most used elements, the most used first; of equals the first.
fn most_used(usages: &[f32], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..usages.len()).collect();
    order.sort_by(|&a, &b| usages[b].total_cmp(&usages[a]));
    order.truncate(count);
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Creates elements whose key, shrinkage and values are their number.
    fn numbered(numbers: Range<usize>) -> Elements {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        let all = |width: usize| {
            numbers
                .clone()
                .flat_map(|at| vec![at as f32; width])
                .collect::<Vec<_>>()
        };
        (elements.keys, elements.shrinkages, elements.values) =
            (all(2), all(1), vec![all(3), all(3)]);
        elements.selections = all(2);
        elements
    }

    #[test]
    fn least_used_elements_are_removed_from_all_lists() {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        elements.add(&numbered(0..4));
        elements.live();
        elements.add(&numbered(4..6));
        elements.live();
        for (element, share) in [(0, 0.8), (1, 0.2), (2, 0.8), (3, 0.1), (4, 0.3), (5, 0.5)] {
            elements.use_of(element, share);
        }
        // Per frame: 0.4, 0.1, 0.4, 0.05, 0.3, 0.5.
        elements.forget(3);
        assert_eq!(elements.shrinkages, [0.0, 2.0, 5.0]);
        assert_eq!(elements.keys, [0.0, 0.0, 2.0, 2.0, 5.0, 5.0]);
        assert_eq!(
            elements.values[1],
            [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0]
        );
        assert_eq!(elements.usages().len(), 3);
        elements.forget(3);
        assert_eq!(elements.len(), 3, "as many as may stay do");
        elements.forget(2);
        assert_eq!(elements.shrinkages, [5.0], "equals go together");
    }

    #[test]
    fn range_is_removed_from_all_lists() {
        let mut elements = Elements::new(Widths { key: 2, value: 3 }, 2);
        elements.add(&numbered(0..5));
        elements.use_of(2, 0.7);
        elements.live();
        let taken = elements.take(1..3);
        assert_eq!(
            (taken.shrinkages.clone(), taken.usages()),
            (vec![1.0, 2.0], vec![0.0, 0.7 / (1.0 + BORN)])
        );
        assert_eq!(elements.keys, [0.0, 0.0, 3.0, 3.0, 4.0, 4.0]);
        assert_eq!(
            elements.values[0],
            [0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0]
        );
    }

    #[test]
    fn prototype_has_the_mean_of_similar_elements() {
        // Two similar elements, and one far from them.
        let mut candidates = Elements::new(Widths { key: 1, value: 2 }, 1);
        let mut all = candidates.clone();
        (all.keys, all.shrinkages, all.selections) =
            (vec![0.0, 0.0, 9.0], vec![1.0, 3.0, 2.0], vec![1.0; 3]);
        all.values = vec![vec![1.0, 0.0, 3.0, 4.0, 50.0, 60.0]];
        candidates.add(&all);
        candidates.live();
        candidates.use_of(1, 0.6);
        candidates.use_of(2, 0.5);
        let made = prototypes(&candidates, 2);
        assert_eq!(made.keys, [0.0, 9.0], "the most used first");
        let expected = [2.0, 2.0, 50.0, 60.0];
        assert!(
            made.values[0]
                .iter()
                .zip(expected)
                .all(|(value, expected)| (value - expected).abs() < 1e-4)
        );
        assert!((made.shrinkages[0] - 2.0).abs() < 1e-4 && made.selections.is_empty());
        assert_eq!(prototypes(&candidates, 9).len(), 3);
    }
}
