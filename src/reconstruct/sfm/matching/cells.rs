//! Descriptors sorted into cells by their nearest centres, compared cell by cell, and the best
//! matches of each.

use std::sync::OnceLock;

use pulp::{Simd, WithSimd};

use super::centres::{NO_CENTRE, Value, k_means, nearest_centres};
use super::tile::{LANES, ROWS};

/// The nearest descriptor so far, and whether another one is nearly as near.
///
/// The second nearest itself is not kept. Once it spoils the ratio, only a nearer descriptor can
/// matter, and that one turns the present nearest into the second. So the bar for further scores is
/// as high as it can be without changing a result.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Record {
    /// Dot product with the nearest, for unit vectors.
    best: f32,
    /// Its index; [`UNASSIGNED`] before the first.
    index: u32,
    /// Whether the second nearest spoils the ratio.
    ambiguous: bool,
}

const UNASSIGNED: u32 = u32::MAX;

/// The conditions under which a nearest neighbour is a match.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule {
    /// 1 / ratio² − 1; 0 = the second nearest does not matter.
    excess: f32,
    /// Dot products of matches are larger than this.
    floor: f32,
}

impl Rule {
    /// Creates the rule: distance < `ratio` · second distance, and dot product > `floor`.
    ///
    /// `ratio` is in 0–1; 1 = any.
    pub fn new(ratio: f32, floor: f32) -> Self {
        Self {
            excess: 1.0 / (ratio * ratio).clamp(1e-6, 1.0) - 1.0,
            floor,
        }
    }

    /// Returns the dot product from which a second neighbour spoils the best: |a − b|² = 2 − 2 a·b for unit vectors.
    #[inline(always)]
    fn rival(self, best: f32) -> f32 {
        best - (1.0 - best).max(0.0) * self.excess
    }

    #[inline(always)]
    fn spoils(self, best: f32, second: f32) -> bool {
        self.excess > 0.0 && second >= self.rival(best)
    }

    /// Returns the record before the first score.
    fn blank(self) -> Record {
        Record {
            best: self.rival(self.floor),
            index: UNASSIGNED,
            ambiguous: true,
        }
    }

    /// Returns the score below which further scores change nothing.
    #[inline(always)]
    fn bar(self, record: Record) -> f32 {
        if record.ambiguous {
            record.best
        } else {
            self.rival(record.best)
        }
    }

    /// Returns the record after one more score; the lower index wins a tie.
    ///
    /// The order of the scores does not matter. The nearest may be given more than once.
    #[inline(always)]
    fn after(self, record: Record, score: f32, index: u32) -> Record {
        if index == record.index {
            return record;
        }
        if score > record.best {
            let ambiguous = record.index != UNASSIGNED && self.spoils(score, record.best);
            return Record {
                best: score,
                index,
                ambiguous,
            };
        }
        let index = if score == record.best {
            index.min(record.index)
        } else {
            record.index
        };
        Record {
            index,
            ambiguous: record.ambiguous || self.spoils(record.best, score),
            ..record
        }
    }

    /// Returns the match, if the record holds one.
    fn accepted(self, record: Record) -> Option<u32> {
        (record.index != UNASSIGNED && !record.ambiguous && record.best > self.floor)
            .then_some(record.index)
    }
}

/// Number of nearest centres per descriptor: cells searched for one of the first image, cells that
/// hold one of the second.
const PROBES: [usize; 2] = [3, 2];
/// Descriptors of the largest image per centre; there are at most [`MAX_CENTRES`] centres.
const PER_CENTRE: usize = 32;
const MAX_CENTRES: usize = 256;
/// Descriptors per centre used to find the centres, and rounds of k-means.
const SAMPLE: usize = 32;
const ROUNDS: usize = 4;
/// Up to this many descriptors per image, all are compared with all.
const EXHAUSTIVE: usize = 512;
/// Number of images whose descriptors determine the centres.
const REFERENCES: usize = 8;

/// Returns which images of a set determine the centres, by their numbers of descriptors.
///
/// These are the first ones with many, so that images that are added later change neither the cells
/// nor the matches of the others.
pub(super) fn references(counts: impl Iterator<Item = usize>) -> Vec<usize> {
    let many = counts.enumerate().filter(|&(_, count)| count > EXHAUSTIVE);
    many.take(REFERENCES).map(|(image, _)| image).collect()
}

/// The descriptors of a set of images by cell, each sorted when it is first compared.
///
/// Nothing here starts parallel jobs: images are compared in such jobs, and a job that waits for
/// another one can end up waiting for itself.
#[derive(Debug)]
pub(super) struct SetCells<'a, T> {
    images: Vec<&'a [T]>,
    dim: usize,
    /// Centres that all images share; `None` if no image has many descriptors.
    centres: OnceLock<Option<Vec<f32>>>,
    cells: Vec<OnceLock<DescriptorCells>>,
}

impl<'a, T: Value> SetCells<'a, T> {
    /// Creates the cells of images with `dim` values per descriptor.
    pub fn new(images: Vec<&'a [T]>, dim: usize) -> Self {
        let cells = images.iter().map(|_| OnceLock::new()).collect();
        Self {
            images,
            dim,
            centres: OnceLock::new(),
            cells,
        }
    }

    /// Returns the descriptors of an image.
    pub fn values(&self, image: usize) -> &'a [T] {
        self.images[image]
    }

    /// Returns the descriptors of an image by cell; there is a single cell without centres.
    pub fn of(&self, image: usize) -> &DescriptorCells {
        let values = self.images[image];
        self.cells[image].get_or_init(|| {
            let centres = self.centres.get_or_init(|| self.find_centres());
            match centres {
                Some(centres) => DescriptorCells::around(centres, values, self.dim),
                None => DescriptorCells::one((values.len() / self.dim) as u32),
            }
        })
    }

    fn find_centres(&self) -> Option<Vec<f32>> {
        let counts = self.images.iter().map(|values| values.len() / self.dim);
        let chosen: Vec<&[T]> = references(counts)
            .into_iter()
            .map(|image| self.images[image])
            .collect();
        let most = chosen.iter().map(|values| values.len() / self.dim).max()?;
        let count = (most / PER_CENTRE).min(MAX_CENTRES);
        let sample = sample(&chosen, self.dim, count * SAMPLE);
        Some(k_means(&sample, self.dim, count, ROUNDS))
    }
}

/// The descriptors of one image by cell.
#[derive(Debug)]
pub(super) struct DescriptorCells {
    /// Members by cell, as a first and as a second image.
    members: [Vec<Vec<u32>>; 2],
}

impl DescriptorCells {
    fn one(count: u32) -> Self {
        Self {
            members: [0; 2].map(|_| vec![(0..count).collect()]),
        }
    }

    fn around<T: Value>(centres: &[f32], values: &[T], dim: usize) -> Self {
        let mut members = [0; 2].map(|_| vec![Vec::new(); centres.len() / dim]);
        for (index, near) in nearest_centres::<T, { PROBES[0] }>(values, centres, dim)
            .into_iter()
            .enumerate()
        {
            for (members, probes) in members.iter_mut().zip(PROBES) {
                for cell in near
                    .into_iter()
                    .take(probes)
                    .filter(|&cell| cell != NO_CENTRE)
                {
                    members[cell as usize].push(index as u32);
                }
            }
        }
        Self { members }
    }
}

/// Returns about `count` descriptors as vectors of length 1, spread evenly over all images, which take turns.
fn sample<T: Value>(images: &[&[T]], dim: usize, count: usize) -> Vec<f32> {
    let all: usize = images.iter().map(|values| values.len() / dim).sum();
    let step = (all / count).max(1);
    let mut rows: Vec<_> = images
        .iter()
        .map(|values| values.chunks_exact(dim).step_by(step))
        .collect();
    let mut mixed = Vec::with_capacity(2 * count * dim);
    loop {
        let before = mixed.len();
        mixed.extend(
            rows.iter_mut()
                .filter_map(Iterator::next)
                .flatten()
                .map(|value| value.unit()),
        );
        if mixed.len() == before {
            return mixed;
        }
    }
}

/// Records of one image's descriptors, with their bars next to them.
struct Ranking {
    rule: Rule,
    records: Vec<Record>,
    bars: Vec<f32>,
}

impl Ranking {
    fn new(rule: Rule, count: usize) -> Self {
        let blank = rule.blank();
        Self {
            rule,
            records: vec![blank; count],
            bars: vec![rule.bar(blank); count],
        }
    }

    #[inline(always)]
    fn enter(&mut self, at: u32, score: f32, index: u32) {
        let at = at as usize;
        // Most scores change nothing; their records are not even read.
        if score >= self.bars[at] {
            let record = self.rule.after(self.records[at], score, index);
            self.records[at] = record;
            self.bars[at] = self.rule.bar(record);
        }
    }

    fn accepted(&self) -> Vec<Option<u32>> {
        self.records
            .iter()
            .map(|&record| self.rule.accepted(record))
            .collect()
    }
}

/// The comparison of two images cell by cell, compiled for the present processor.
///
/// For every descriptor of both images it finds the match in the other one.
pub(super) struct Comparison<'a, T> {
    pub cells: [&'a DescriptorCells; 2],
    pub values: [&'a [T]; 2],
    pub dim: usize,
    pub rule: Rule,
}

impl<T: Value> Comparison<'_, T> {
    #[inline(always)]
    fn run<const FUSED: bool>(&self) -> [Vec<Option<u32>>; 2] {
        let mut rankings = self
            .values
            .map(|values| Ranking::new(self.rule, values.len() / self.dim));
        let (mut rows, mut panels) = (Vec::new(), Vec::new());
        let [firsts, seconds] = [&self.cells[0].members[0], &self.cells[1].members[1]];
        for (firsts, seconds) in firsts
            .iter()
            .zip(seconds)
            .filter(|(a, b)| !a.is_empty() && !b.is_empty())
        {
            self.gather_rows(firsts, &mut rows);
            self.gather_panels(seconds, &mut panels);
            self.compare::<FUSED>([firsts, seconds], &rows, &panels, &mut rankings);
        }
        rankings.map(|ranking| ranking.accepted())
    }

    /// Copies the members' descriptors one after the other, padded to whole groups of rows.
    #[inline(always)]
    fn gather_rows(&self, members: &[u32], rows: &mut Vec<T::Packed>) {
        let steps = self.dim.div_ceil(T::STEP);
        rows.clear();
        rows.resize(
            members.len().next_multiple_of(ROWS) * steps,
            T::Packed::default(),
        );
        for (row, &index) in rows.chunks_exact_mut(steps).zip(members) {
            let values = &self.values[0][index as usize * self.dim..][..self.dim];
            T::pack(values, |k, packed| row[k] = packed);
        }
    }

    /// Copies the members' descriptors as columns, in panels of [`LANES`].
    #[inline(always)]
    fn gather_panels(&self, members: &[u32], panels: &mut Vec<[T::Packed; LANES]>) {
        let steps = self.dim.div_ceil(T::STEP);
        panels.clear();
        let blank = [T::Packed::default(); LANES];
        panels.resize(members.len().div_ceil(LANES) * steps, blank);
        for (panel, members) in panels.chunks_exact_mut(steps).zip(members.chunks(LANES)) {
            for (lane, &index) in members.iter().enumerate() {
                let values = &self.values[1][index as usize * self.dim..][..self.dim];
                T::pack(values, |k, packed| panel[k][lane] = packed);
            }
        }
    }

    #[inline(always)]
    fn compare<const FUSED: bool>(
        &self,
        [firsts, seconds]: [&[u32]; 2],
        rows: &[T::Packed],
        panels: &[[T::Packed; LANES]],
        [forth, back]: &mut [Ranking; 2],
    ) {
        let steps = self.dim.div_ceil(T::STEP);
        for (panel, seconds) in panels.chunks_exact(steps).zip(seconds.chunks(LANES)) {
            for (rows, firsts) in rows.chunks_exact(ROWS * steps).zip(firsts.chunks(ROWS)) {
                let parts: [&[T::Packed]; ROWS] =
                    std::array::from_fn(|row| &rows[row * steps..(row + 1) * steps]);
                let scores = T::tile::<FUSED>(parts, panel);
                let mut bars = [f32::INFINITY; LANES];
                for (bar, &second) in bars.iter_mut().zip(seconds) {
                    *bar = back.bars[second as usize];
                }
                for (&first, scores) in firsts.iter().zip(&scores) {
                    if reaches(scores, forth.bars[first as usize], &bars) {
                        for (&second, &score) in seconds.iter().zip(scores) {
                            forth.enter(first, score, second);
                            back.enter(second, score, first);
                        }
                    }
                }
            }
        }
    }
}

/// Returns whether any of a row's scores reaches its bar or that of its column.
#[inline(always)]
fn reaches(scores: &[f32; LANES], row_bar: f32, column_bars: &[f32; LANES]) -> bool {
    let mut any = false;
    for lane in 0..LANES {
        any |= (scores[lane] >= row_bar) | (scores[lane] >= column_bars[lane]);
    }
    any
}

impl<T: Value> WithSimd for Comparison<'_, T> {
    type Output = [Vec<Option<u32>>; 2];

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) -> Self::Output {
        if S::IS_SCALAR {
            self.run::<false>()
        } else {
            self.run::<true>()
        }
    }
}
