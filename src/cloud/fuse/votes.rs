use std::sync::Arc;

use rayon::prelude::*;

use super::majority::{Histograms, Majority, Verdict};
use super::pairs::{CHUNK, Pair, PairReader, PairWriter};
use ostra_masks::LabelId;

/// How every point was voted on: integer votes for each label, and who voted. Kept beside the cloud so that a changed
/// mask needs no new geometry ([`super::relabel`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Votes {
    /// First entry of each point's histogram, then the number of all entries.
    pub(super) offsets: Vec<u32>,
    /// (deepest id or 0, votes), ordered by id within a point.
    pub(super) entries: Vec<(LabelId, u16)>,
    /// Who voted, by frame number; empty when pairs were not kept.
    pub(super) frames: Vec<Arc<FramePairs>>,
    /// Whether the pairs were kept.
    pub(super) has_pairs: bool,
    /// Points below this share of the vote are unlabelled.
    pub(super) min_confidence: f32,
}

/// The points that one frame sees.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct FramePairs {
    /// Frame number.
    pub(super) frame: u32,
    /// Columns of the frame.
    pub(super) width: u32,
    /// Rows of the frame.
    pub(super) height: u32,
    /// First byte of each chunk's pairs, then the number of all bytes.
    pub(super) starts: Vec<u32>,
    /// The pairs, chunk by chunk.
    pub(super) bytes: Vec<u8>,
}

/// One frame's part in the vote on a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Voter {
    /// Frame number.
    pub frame: usize,
    /// Column of the pixel that sees the point.
    pub x: u32,
    /// Row of the pixel that sees the point.
    pub y: u32,
    /// What it voted; 0 = nothing, `None` = the frame sees the point but had no mask.
    pub label: Option<LabelId>,
}

impl Votes {
    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The votes on a point: (deepest id or 0, votes above 0), ordered by id.
    #[must_use]
    pub fn histogram(&self, point: usize) -> &[(LabelId, u16)] {
        &self.entries[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Share of the votes that the strongest loser got, 0–0.5: 0 where all agree or nobody voted.
    #[must_use]
    pub fn conflict(&self, point: usize) -> f32 {
        let (mut first, mut second, mut total) = (0, 0, 0);
        for &(_, votes) in self.histogram(point) {
            second = second.max(votes.min(first));
            first = first.max(votes);
            total += u32::from(votes);
        }
        if total == 0 {
            0.0
        } else {
            f32::from(second) / total as f32
        }
    }

    /// How many views voted on a point, for a label or for none.
    #[must_use]
    pub fn voted(&self, point: usize) -> u32 {
        self.histogram(point)
            .iter()
            .map(|&(_, votes)| u32::from(votes))
            .sum()
    }

    /// Whether it is known who voted; not kept beyond a budget of memory.
    #[must_use]
    pub fn has_voters(&self) -> bool {
        self.has_pairs
    }

    /// The frames that took part, by rising number: those that can vote again. None where pairs were not kept, and none
    /// where no frame had a mask.
    pub fn frames(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(|frame| frame.frame as usize)
    }

    /// The points that a frame sees, with the column and row of the pixel that sees each; by rising point, nothing where
    /// pairs were not kept.
    pub fn sightings(&self, frame: usize) -> impl Iterator<Item = (usize, u32, u32)> {
        let found = self
            .frames
            .binary_search_by_key(&frame, |pairs| pairs.frame as usize)
            .ok();
        let pairs = found.map(|at| &self.frames[at]);
        pairs.into_iter().flat_map(|pairs| {
            let chunks = 0..pairs.starts.len().saturating_sub(1);
            chunks.flat_map(|chunk| {
                let first = chunk * CHUNK;
                PairReader::new(pairs.chunk(chunk))
                    .map(move |pair| (first + pair.point as usize, pair.x, pair.y))
            })
        })
    }

    /// The frames that see a point, by frame number; empty when pairs were not kept.
    #[must_use]
    pub fn voters(&self, point: usize) -> Vec<Voter> {
        let inside = (point % CHUNK) as u32;
        let voter = |frame: &Arc<FramePairs>| {
            let pair =
                PairReader::new(frame.chunk(point / CHUNK)).find(|pair| pair.point >= inside)?;
            let found = pair.point == inside;
            found.then_some(Voter {
                frame: frame.frame as usize,
                x: pair.x,
                y: pair.y,
                label: pair.vote,
            })
        };
        self.frames.iter().filter_map(voter).collect()
    }

    /// The outcome for each point, with those below the smallest confidence unlabelled.
    #[must_use]
    pub fn decide(&self, majority: &Majority) -> Vec<Verdict> {
        let decide = |point: usize| {
            let verdict = majority.decide(self.histogram(point));
            let sure = verdict.confidence >= self.min_confidence;
            Verdict {
                label: if sure { verdict.label } else { LabelId::NONE },
                ..verdict
            }
        };
        (0..self.len()).into_par_iter().map(decide).collect()
    }

    /// The histograms of consecutive points as they stand.
    pub(super) fn histograms(&self, points: std::ops::Range<usize>) -> Histograms {
        let offsets = &self.offsets[points.start..=points.end];
        let counts = offsets
            .windows(2)
            .map(|range| range[1] - range[0])
            .collect();
        (
            counts,
            self.entries[offsets[0] as usize..offsets[offsets.len() - 1] as usize].to_vec(),
        )
    }

    /// The ids that got a vote.
    pub(super) fn ids(&self) -> std::collections::BTreeSet<LabelId> {
        self.entries.iter().map(|&(id, _)| id).collect()
    }

    /// The votes on some points, given by rising index.
    #[must_use]
    pub fn select(&self, points: &[u32]) -> Self {
        let mut offsets = vec![0];
        let mut entries = Vec::new();
        for &point in points {
            entries.extend_from_slice(self.histogram(point as usize));
            offsets.push(entries.len() as u32);
        }
        let mut place = vec![u32::MAX; self.len()];
        points
            .iter()
            .enumerate()
            .for_each(|(new, &old)| place[old as usize] = new as u32);
        let frames = self
            .frames
            .par_iter()
            .map(|frame| Arc::new(frame.moved(&place, points.len())))
            .collect();
        Self {
            offsets,
            entries,
            frames,
            ..*self
        }
    }
}

impl FramePairs {
    /// The bytes of a chunk's pairs.
    pub(super) fn chunk(&self, chunk: usize) -> &[u8] {
        let bytes = self.starts.get(chunk).zip(self.starts.get(chunk + 1));
        bytes
            .and_then(|(&start, &end)| self.bytes.get(start as usize..end as usize))
            .unwrap_or_default()
    }

    /// Puts together the pairs of all chunks.
    pub(super) fn from_chunks<'a>(template: &Self, chunks: impl Iterator<Item = &'a [u8]>) -> Self {
        let mut frame = Self {
            starts: vec![0],
            bytes: Vec::new(),
            ..*template
        };
        for chunk in chunks {
            frame.bytes.extend_from_slice(chunk);
            frame.starts.push(frame.bytes.len() as u32);
        }
        frame.bytes.shrink_to_fit();
        frame
    }

    /// The pairs of the points that have a new place (`u32::MAX` = none) among `points`.
    fn moved(&self, place: &[u32], points: usize) -> Self {
        let mut writers: Vec<PairWriter> = Vec::new();
        writers.resize_with(points.div_ceil(CHUNK), PairWriter::default);
        for (chunk, first) in (0..place.len()).step_by(CHUNK).enumerate() {
            for pair in PairReader::new(self.chunk(chunk)) {
                let Some(&new) = place
                    .get(first + pair.point as usize)
                    .filter(|&&new| new != u32::MAX)
                else {
                    continue;
                };
                writers[new as usize / CHUNK].push(Pair {
                    point: new % CHUNK as u32,
                    ..pair
                });
            }
        }
        Self::from_chunks(self, writers.iter().map(|writer| &writer.bytes[..]))
    }
}

/// Puts the histograms of consecutive chunks together; the lengths as running sums from 0.
pub(super) fn joined(chunks: &[Histograms]) -> Histograms {
    let mut offsets = vec![0];
    let mut all = Vec::with_capacity(chunks.iter().map(|(_, entries)| entries.len()).sum());
    for (counts, entries) in chunks {
        for count in counts {
            offsets.push(offsets[offsets.len() - 1] + count);
        }
        all.extend_from_slice(entries);
    }
    (offsets, all)
}
