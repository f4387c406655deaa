use std::ops::Range;

use glam::{DVec2, DVec3};

use crate::blocks::{BLOCK, Column6};

/// Assignment of blocks of unknowns to poses and cameras.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    /// Block of each image's pose; `None` if the pose is fixed.
    pub poses: Vec<Option<usize>>,
    /// Blocks of each camera's refined intrinsics, after those of the poses.
    pub intrinsics: Vec<Range<usize>>,
    /// Lowest block with which each block shares a point.
    pub first: Vec<usize>,
    /// Whether points are fixed, so that only poses and intrinsics move.
    pub fixed_points: bool,
}

impl Layout {
    /// Returns the number of blocks.
    pub fn len(&self) -> usize {
        self.first.len()
    }
}

/// One observation, grouped by point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub image: u32,
    pub at_px: DVec2,
}

/// A few hundred points with all their observations: the unit of work of one thread.
#[derive(Debug, Clone, Default)]
pub(super) struct PointBlock {
    /// Indices of the points in the bundle.
    pub ids: Vec<u32>,
    /// Positions of the points.
    pub points: Vec<DVec3>,
    /// Positions of the points after the candidate step.
    pub tried: Vec<DVec3>,
    /// Observations of point `p` are `starts[p]..starts[p + 1]`, by the block of their image.
    pub starts: Vec<u32>,
    pub observations: Vec<Observation>,
    /// One group per observation.
    pub by_observation: Groups,
    /// One group per point: its poses in the order of its observations, then intrinsics.
    ///
    /// Empty if points are fixed.
    pub by_point: Groups,
}

impl PointBlock {
    /// Returns the range of observations of one point.
    #[inline(always)]
    pub fn observations_of(&self, point: usize) -> Range<usize> {
        self.starts[point] as usize..self.starts[point + 1] as usize
    }
}

/// Products to be added to the reduced matrix, as groups of entries.
///
/// Each entry belongs to one block of unknowns, and every two entries of a group contribute to one
/// block of the matrix. An observation is a group (its pose and its camera's intrinsics), and so is
/// a point (all images that see it).
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    /// Entries of group `g` are `starts[g]..starts[g + 1]`, by ascending block.
    starts: Vec<u32>,
    /// Block of each entry.
    pub blocks: Vec<u32>,
    /// Entries by block: those of block `b` are `sorted[row_starts[b]..row_starts[b + 1]]`.
    sorted: Vec<LayoutEntry>,
    row_starts: Vec<u32>,
}

/// An entry and its partners.
#[derive(Debug, Clone, Copy)]
struct LayoutEntry {
    at: u32,
    group: u32,
    /// Entries of the group whose block is not above that of this entry.
    first: u32,
    end: u32,
}

/// Factors of [`Groups`]: `K` columns per entry, `K` right-hand side values per group.
#[derive(Debug, Clone, Default)]
pub(super) struct Factors<const K: usize> {
    pub columns: Vec<[Column6; K]>,
    pub values: Vec<[f64; K]>,
}

impl<const K: usize> Factors<K> {
    /// Resizes to the factors of `groups`; old values are partly kept.
    pub fn resize(&mut self, groups: &Groups) {
        self.columns.resize(groups.blocks.len(), [[0.0; BLOCK]; K]);
        self.values.resize(groups.len(), [0.0; K]);
    }

    /// Sets all factors of a group to zero.
    #[inline(always)]
    pub fn leave_out(&mut self, groups: &Groups, group: usize) {
        self.columns[groups.entries(group)].fill([[0.0; BLOCK]; K]);
        self.values[group] = [0.0; K];
    }
}

impl Groups {
    /// Appends a group; `blocks` must be ascending.
    pub fn push(&mut self, blocks: impl IntoIterator<Item = usize>) {
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        self.blocks
            .extend(blocks.into_iter().map(|block| block as u32));
        self.starts.push(self.blocks.len() as u32);
    }

    /// Sorts the entries by block; `count` is the number of blocks.
    pub fn finish(&mut self, count: usize) {
        self.starts.shrink_to_fit();
        self.blocks.shrink_to_fit();
        self.sorted.reserve_exact(self.blocks.len());
        let blocks = &self.blocks;
        for group in 0..self.len() {
            let entries = self.entries(group);
            for at in entries.clone() {
                let beyond = (at..entries.end).find(|&other| blocks[other] > blocks[at]);
                let (first, end) = (entries.start as u32, beyond.unwrap_or(entries.end) as u32);
                self.sorted.push(LayoutEntry {
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

    /// Returns the number of groups.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Returns the range of entries of a group.
    #[inline(always)]
    pub fn entries(&self, group: usize) -> Range<usize> {
        self.starts[group] as usize..self.starts[group + 1] as usize
    }

    /// Returns each entry of a block: the entry, its group, and its partners (including itself).
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
