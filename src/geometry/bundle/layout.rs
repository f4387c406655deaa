use std::ops::Range;

use glam::{DVec2, DVec3};

use crate::blocks::{BLOCK, Column};

/// Which block of unknowns belongs to what.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    /// The block of each image's pose; `None` where it stays.
    pub poses: Vec<Option<usize>>,
    /// The blocks of each camera's refined intrinsics, behind those of the poses.
    pub intrinsics: Vec<Range<usize>>,
    /// Of each block: the lowest block it shares a point with.
    pub first: Vec<usize>,
    /// Whether only poses and intrinsics move.
    pub fixed_points: bool,
}

impl Layout {
    /// How many blocks there are.
    pub fn len(&self) -> usize {
        self.first.len()
    }
}

/// One observation, sorted to its point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sighting {
    pub image: u32,
    pub at_px: DVec2,
}

/// A few hundred points with all that see them: the unit of work for one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct Piece {
    /// Which points of the bundle these are.
    pub ids: Vec<u32>,
    /// Where they are.
    pub points: Vec<DVec3>,
    /// Where they would be after the step that is tried.
    pub tried: Vec<DVec3>,
    /// Observations of point `p` are `starts[p]..starts[p + 1]`, by the block of their image.
    pub starts: Vec<u32>,
    pub sightings: Vec<Sighting>,
    /// One group per observation.
    pub by_sighting: Groups,
    /// One group per point: its poses in the order of its observations, then intrinsics; none when points are fixed.
    pub by_point: Groups,
}

impl Piece {
    /// The observations of one point.
    #[inline(always)]
    pub fn sightings_of(&self, point: usize) -> Range<usize> {
        self.starts[point] as usize..self.starts[point + 1] as usize
    }
}

/// Products to be added to the reduced matrix, as groups of entries: each entry belongs to one block of unknowns, and
/// every two entries of a group meet in one block of the matrix. An observation is a group (its pose, its camera's
/// intrinsics), and so is a point (all that see it).
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    /// Entries of group `g` are `starts[g]..starts[g + 1]`, by rising block.
    starts: Vec<u32>,
    /// Block of each entry.
    pub blocks: Vec<u32>,
    /// Entries by block: those of block `b` are `sorted[row_starts[b]..row_starts[b + 1]]`.
    sorted: Vec<Entry>,
    row_starts: Vec<u32>,
}

/// An entry and whom it meets.
#[derive(Debug, Clone, Copy)]
struct Entry {
    at: u32,
    group: u32,
    /// The group's entries whose block is not above its own.
    first: u32,
    end: u32,
}

/// The factors of [`Groups`]: each entry has `K` columns, each group `K` values on the right-hand side.
#[derive(Debug, Clone, Default)]
pub(super) struct Factors<const K: usize> {
    pub columns: Vec<[Column; K]>,
    pub values: Vec<[f64; K]>,
}

impl<const K: usize> Factors<K> {
    /// Makes room for the factors of `groups`; what was there before stays in part.
    pub fn resize(&mut self, groups: &Groups) {
        self.columns.resize(groups.blocks.len(), [[0.0; BLOCK]; K]);
        self.values.resize(groups.len(), [0.0; K]);
    }

    /// Makes all of a group zero.
    #[inline(always)]
    pub fn leave_out(&mut self, groups: &Groups, group: usize) {
        self.columns[groups.entries(group)].fill([[0.0; BLOCK]; K]);
        self.values[group] = [0.0; K];
    }
}

impl Groups {
    /// Appends a group; `blocks` must rise.
    pub fn push(&mut self, blocks: impl IntoIterator<Item = usize>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        self.blocks
            .extend(blocks.into_iter().map(|block| block as u32));
        self.starts.push(self.blocks.len() as u32);
    }

    /// Sorts what was pushed by block, of which there are `count`.
    pub fn finish(&mut self, count: usize) {
        let blocks = &self.blocks;
        for group in 0..self.len() {
            let entries = self.entries(group);
            for at in entries.clone() {
                let beyond = (at..entries.end).find(|&other| blocks[other] > blocks[at]);
                let (first, end) = (entries.start as u32, beyond.unwrap_or(entries.end) as u32);
                self.sorted.push(Entry {
                    at: at as u32,
                    group: group as u32,
                    first,
                    end,
                });
            }
        }
        self.sorted.sort_by_key(|entry| blocks[entry.at as usize]);
        let begin = |block: usize| {
            self.sorted
                .partition_point(|e| (blocks[e.at as usize] as usize) < block) as u32
        };
        self.row_starts = (0..=count).map(begin).collect();
    }

    /// How many groups there are.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// The entries of a group.
    #[inline(always)]
    pub fn entries(&self, group: usize) -> Range<usize> {
        self.starts[group] as usize..self.starts[group + 1] as usize
    }

    /// Each entry of a block: the entry, its group, and its partners in that group (itself among them).
    #[inline(always)]
    pub fn of_block(
        &self,
        block: usize,
    ) -> impl Iterator<Item = (usize, usize, std::ops::Range<usize>)> {
        let entries =
            &self.sorted[self.row_starts[block] as usize..self.row_starts[block + 1] as usize];
        entries.iter().map(|entry| {
            (
                entry.at as usize,
                entry.group as usize,
                entry.first as usize..entry.end as usize,
            )
        })
    }
}
