use std::ops::Range;

use super::lanes::{LANES, ROWS, tile};
use super::record::{Record, Rule};
use super::sketch::Side;
use super::value::Value;

/// Panels gone through by all rows before the next ones: together 48 KB, so that they stay in the nearest cache.
const BLOCK: usize = 16;

/// Records of one picture's descriptors, with their bars beside them.
struct Ranking {
    rule: Rule,
    records: Vec<Record>,
    bars: Vec<f32>,
}

impl Ranking {
    fn new(rule: Rule, count: usize) -> Self {
        let blank = rule.blank();
        Self { rule, records: vec![blank; count], bars: vec![rule.bar(blank); count.next_multiple_of(ROWS * LANES)] }
    }

    #[inline(always)]
    fn enter(&mut self, at: usize, score: f32, index: u32) {
        // Most scores are of no consequence; the records of those are not even looked up.
        if score >= self.bars[at] {
            let record = self.rule.after(self.records[at], score, index);
            self.records[at] = record;
            self.bars[at] = self.rule.bar(record);
        }
    }

    /// The matches, in the order that the picture has its descriptors in.
    fn accepted(&self, order: &[u32]) -> Vec<Option<u32>> {
        let mut found = vec![None; order.len()];
        for (record, &at) in self.records.iter().zip(order) {
            found[at as usize] = self.rule.accepted(*record);
        }
        found
    }
}

/// Both pictures, and what is known of their descriptors so far.
struct Pass<'a, T> {
    sides: [&'a Side<T>; 2],
    dim: usize,
    rows: Ranking,
    columns: Ranking,
}

/// For every descriptor of both pictures its match in the other one, in one pass: where a bound reaches the bar of
/// neither, the descriptors themselves are not compared. Those with the same key come first, since the nearest is often
/// among them and its score raises the bars for all others.
#[inline(always)]
pub(super) fn nearest<const FUSED: bool, T: Value>(
    sides: [&Side<T>; 2],
    dim: usize,
    rule: Rule,
) -> [Vec<Option<u32>>; 2] {
    let (rows, columns) = (Ranking::new(rule, sides[0].order.len()), Ranking::new(rule, sides[1].order.len()));
    let mut pass = Pass { sides, dim, rows, columns };
    let groups = sides[0].keys.chunks(ROWS);
    let own: Vec<Range<usize>> = groups.map(|keys| panels_of_keys(keys, &sides[1].keys)).collect();
    for (group, own) in own.iter().enumerate() {
        for panel in own.clone() {
            pass.compare_tile::<FUSED>(group, panel);
        }
    }
    for block in (0..sides[1].panels.len()).step_by(BLOCK) {
        for (group, own) in own.iter().enumerate() {
            for panel in block..sides[1].panels.len().min(block + BLOCK) {
                if !own.contains(&panel) {
                    pass.compare_tile::<FUSED>(group, panel);
                }
            }
        }
    }
    [pass.rows.accepted(&sides[0].order), pass.columns.accepted(&sides[1].order)]
}

/// The panels that hold all columns with a group of rows' keys.
fn panels_of_keys(rows: &[u32], columns: &[u32]) -> Range<usize> {
    let (low, high) = (rows[0], rows[rows.len() - 1]);
    let first = columns.partition_point(|&key| key < low);
    let end = columns.partition_point(|&key| key <= high);
    first / LANES..if first < end { end.div_ceil(LANES) } else { first / LANES }
}

impl<T: Value> Pass<'_, T> {
    #[inline(always)]
    fn compare_tile<const FUSED: bool>(&mut self, group: usize, panel: usize) {
        let sketches = &self.sides[0].rows[group * ROWS..(group + 1) * ROWS];
        let parts: [&[f32]; ROWS] = std::array::from_fn(|row| &sketches[row][..]);
        let bounds = tile::<FUSED>(parts, &self.sides[1].panels[panel]);
        let row_bars = &self.rows.bars[group * ROWS..(group + 1) * ROWS];
        let mut reached = [false; ROWS];
        for ((reached, bounds), bar) in reached.iter_mut().zip(&bounds).zip(row_bars) {
            *reached = reaches(bounds, *bar, &self.columns.bars[panel * LANES..]);
        }
        for row in 0..ROWS {
            if reached[row] {
                self.compare_row(group * ROWS + row, panel * LANES, &bounds[row]);
            }
        }
    }

    /// Compares the descriptor of a row with those of the columns whose bounds allow a change.
    #[inline(always)]
    fn compare_row(&mut self, row: usize, first_column: usize, bounds: &[f32; LANES]) {
        let [a, b] = self.sides;
        let descriptor = &a.values[row * self.dim..(row + 1) * self.dim];
        for (column, bound) in (first_column..).zip(bounds) {
            if (*bound > self.rows.bars[row]) | (*bound > self.columns.bars[column]) {
                let score = T::dot(descriptor, &b.values[column * self.dim..(column + 1) * self.dim]);
                self.rows.enter(row, score, b.order[column]);
                self.columns.enter(column, score, a.order[row]);
            }
        }
    }
}

/// Whether any of a row's bounds is above its bar or that of its column.
#[inline(always)]
fn reaches(bounds: &[f32; LANES], row_bar: f32, column_bars: &[f32]) -> bool {
    let column_bars = &column_bars[..LANES];
    let mut any = false;
    for lane in 0..LANES {
        any |= (bounds[lane] > row_bar) | (bounds[lane] > column_bars[lane]);
    }
    any
}
