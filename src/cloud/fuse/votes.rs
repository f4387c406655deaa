use std::sync::Arc;

use rayon::prelude::*;

use super::majority::{Histograms, Majority, MajorityLabel};
use super::pairs::{CHUNK, Pair, PairReader, PairWriter};
use ostra_masks::LabelId;

/// The votes on every point: integer counts per label, and the pixels that voted.
///
/// They are stored with the cloud so that a changed mask needs no new geometry
/// ([`super::relabel`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Votes {
    /// Index of the first entry of each point's histogram, then the total number of entries.
    pub(super) offsets: Vec<u32>,
    /// (deepest id or 0, votes), ordered by id within a point.
    pub(super) entries: Vec<(LabelId, u16)>,
    /// The pairs that voted, by frame number; empty if they were not kept.
    pub(super) frames: Vec<Arc<FramePairs>>,
    /// Whether the pairs were kept.
    pub(super) has_pairs: bool,
    /// Minimum share of the votes; points below it are unlabelled.
    pub(super) min_confidence: f32,
}

/// The points that one frame sees.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct FramePairs {
    /// Frame number.
    pub(super) frame: u32,
    /// Width of the frame in pixels.
    pub(super) width: u32,
    /// Height of the frame in pixels.
    pub(super) height: u32,
    /// Start of each chunk's pairs in `bytes`, then the total number of bytes.
    pub(super) starts: Vec<u32>,
    /// Encoded pairs, chunk by chunk.
    pub(super) bytes: Vec<u8>,
}

/// The vote of one frame on a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Voter {
    /// Frame number.
    pub frame: usize,
    /// Column of the pixel that sees the point.
    pub x: u32,
    /// Row of the pixel that sees the point.
    pub y: u32,
    /// The label voted for; 0 is no label, and `None` means that the frame has no mask.
    pub label: Option<LabelId>,
}

impl Votes {
    /// Returns the number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Returns whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the votes on a point as (deepest id or 0, votes above 0), ordered by id.
    #[must_use]
    pub fn histogram(&self, point: usize) -> &[(LabelId, u16)] {
        &self.entries[self.offsets[point] as usize..self.offsets[point + 1] as usize]
    }

    /// Returns the share of the votes of the runner-up, 0–0.5.
    ///
    /// It is 0 if all votes agree or there are none.
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

    /// Returns the number of views that voted on a point, for a label or for none.
    #[must_use]
    pub fn voted(&self, point: usize) -> u32 {
        self.histogram(point)
            .iter()
            .map(|&(_, votes)| u32::from(votes))
            .sum()
    }

    /// Returns whether the voting frames and pixels are known.
    ///
    /// They are discarded beyond a memory budget.
    #[must_use]
    pub fn has_voters(&self) -> bool {
        self.has_pairs
    }

    /// Returns the numbers of the frames that took part and can vote again, in ascending order.
    ///
    /// There are none if the pairs were not kept or no frame had a mask.
    pub fn frames(&self) -> impl Iterator<Item = usize> {
        self.frames.iter().map(|frame| frame.frame as usize)
    }

    /// Returns the points that a frame sees, with the column and row of the pixel that sees each.
    ///
    /// Points are in ascending order. There are none if the pairs were not kept.
    pub fn observations(&self, frame: usize) -> impl Iterator<Item = (usize, u32, u32)> {
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

    /// Returns the frames that see a point, by frame number; empty if pairs were not kept.
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

    /// Returns the outcome per point; points below the minimum confidence are unlabelled.
    #[must_use]
    pub fn decide(&self, majority: &Majority) -> Vec<MajorityLabel> {
        let decide = |point: usize| {
            let verdict = majority.decide(self.histogram(point));
            let confidence = verdict.confidence >= self.min_confidence;
            MajorityLabel {
                label: if confidence {
                    verdict.label
                } else {
                    LabelId::NONE
                },
                ..verdict
            }
        };
        (0..self.len()).into_par_iter().map(decide).collect()
    }

    /// Returns the histograms of consecutive points.
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

    /// Returns the ids that received a vote.
    pub(super) fn ids(&self) -> std::collections::BTreeSet<LabelId> {
        self.entries.iter().map(|&(id, _)| id).collect()
    }

    /// Returns the votes on the given points, whose indices must be in ascending order.
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
    /// Returns the encoded pairs of a chunk.
    pub(super) fn chunk(&self, chunk: usize) -> &[u8] {
        let bytes = self.starts.get(chunk).zip(self.starts.get(chunk + 1));
        bytes
            .and_then(|(&start, &end)| self.bytes.get(start as usize..end as usize))
            .unwrap_or_default()
    }

    /// Concatenates the pairs of all chunks.
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

    /// Returns the pairs of the selected points under their new indices.
    ///
    /// `place` maps old to new indices, with `u32::MAX` for points that are left out. `points` is
    /// the number of points that remain.
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

/// Concatenates the histograms of consecutive chunks.
///
/// The returned lengths are running sums that start at 0.
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
