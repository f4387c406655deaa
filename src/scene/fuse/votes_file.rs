use std::io::{Read, Write};

use rayon::prelude::*;

use super::pairs::{CHUNK, PairReader};
use super::votes::{FramePairs, Votes};
use crate::masks::LabelId;

/// First bytes of a votes file.
const MAGIC: &[u8; 8] = b"OSTRAVOT";
/// Form of the file; a reader refuses a newer one.
const VERSION: u32 = 1;

/// Writes votes in a compact binary form: magic, version, counts, histograms, pairs, and a checksum at the end. All
/// numbers are little-endian.
///
/// # Errors
/// What the writer says.
pub fn write_votes<W: Write>(out: W, votes: &Votes) -> std::io::Result<()> {
    let mut out = Summed { out: std::io::BufWriter::with_capacity(1 << 18, out), sum: Checksum::default() };
    out.write_all(MAGIC)?;
    out.u32(VERSION)?;
    out.u32(CHUNK as u32)?;
    out.u32(votes.min_confidence.to_bits())?;
    out.u32(u32::from(votes.has_pairs))?;
    out.u64(votes.len() as u64)?;
    out.u64(votes.entries.len() as u64)?;
    out.u64(votes.frames.len() as u64)?;
    for range in votes.offsets.windows(2) {
        out.u32(range[1] - range[0])?;
    }
    for (id, count) in &votes.entries {
        out.u32(u32::from(id.0) << 16 | u32::from(*count))?;
    }
    for frame in &votes.frames {
        out.u32(frame.frame)?;
        out.u32(frame.width)?;
        out.u32(frame.height)?;
        for range in frame.starts.windows(2) {
            out.u32(range[1] - range[0])?;
        }
        out.write_all(&frame.bytes)?;
    }
    let sum = out.sum.value();
    out.u64(sum)?;
    out.out.flush()
}

/// Reads what [`write_votes`] wrote; every length and every pair is checked.
///
/// # Errors
/// What the reader says, or `InvalidData` with one line that says what is wrong: cut off, damaged, made by a newer
/// version. Votes can always be made anew by fusing again.
pub fn read_votes<R: Read>(mut reader: R) -> std::io::Result<Votes> {
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes)?;
    parse(&bytes).map_err(|what| {
        std::io::Error::new(
            std::io::ErrorKind::InvalidData,
            format!("the votes are {what}; fuse again to make them anew"),
        )
    })
}

fn parse(bytes: &[u8]) -> Result<Votes, &'static str> {
    let mut input = Input(bytes);
    if input.take(MAGIC.len())? != MAGIC {
        return Err("no votes file of OSTRA");
    }
    if input.u32()? != VERSION {
        return Err("of a newer version");
    }
    let (content, sum) = bytes.split_last_chunk().ok_or("cut off")?;
    let mut checksum = Checksum::default();
    checksum.add(content);
    if checksum.value() != u64::from_le_bytes(*sum) {
        return Err("cut off or damaged");
    }
    if input.u32()? != CHUNK as u32 {
        return Err("cut into parts of another size");
    }
    let min_confidence = f32::from_bits(input.u32()?);
    let has_pairs = input.u32()? != 0;
    let [points, entries, frames] = [input.size()?, input.size()?, input.size()?];
    let votes = Votes {
        offsets: input.offsets(points, entries)?,
        entries: input.entries(entries)?,
        frames: input.frames(points, frames)?,
        has_pairs,
        min_confidence,
    };
    let sound = input.0.len() == 8 && votes.frames.par_iter().all(|frame| pairs_are_sound(frame, points));
    if sound { Ok(votes) } else { Err("damaged") }
}

/// Whether every pair names a point and a pixel that exist.
fn pairs_are_sound(frame: &FramePairs, points: usize) -> bool {
    (0..frame.starts.len() - 1).all(|chunk| {
        let inside = points - chunk * CHUNK;
        let mut reader = PairReader::new(frame.chunk(chunk));
        let fits =
            reader.by_ref().all(|pair| (pair.point as usize) < inside && pair.x < frame.width && pair.y < frame.height);
        fits && !reader.damaged
    })
}

/// The rest of a file being read.
struct Input<'a>(&'a [u8]);

impl<'a> Input<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], &'static str> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or("cut off")?;
        self.0 = rest;
        Ok(taken)
    }

    fn u32(&mut self) -> Result<u32, &'static str> {
        let bytes = self.take(4)?;
        Ok(bytes.try_into().map_or(0, u32::from_le_bytes))
    }

    /// A count, which is never above the number of bytes left.
    fn size(&mut self) -> Result<usize, &'static str> {
        let bytes = self.take(8)?;
        let size = bytes.try_into().map_or(0, u64::from_le_bytes);
        usize::try_from(size).ok().filter(|&size| size <= self.0.len()).ok_or("cut off")
    }

    /// `count` lengths that sum to `total`, as running sums from 0.
    fn offsets(&mut self, count: usize, total: usize) -> Result<Vec<u32>, &'static str> {
        let mut offsets = Vec::with_capacity(count + 1);
        offsets.push(0u32);
        let mut sum = 0u32;
        for _ in 0..count {
            sum = sum.checked_add(self.u32()?).ok_or("damaged")?;
            offsets.push(sum);
        }
        if sum as usize == total { Ok(offsets) } else { Err("damaged") }
    }

    fn entries(&mut self, count: usize) -> Result<Vec<(LabelId, u16)>, &'static str> {
        let entry = |packed: u32| (LabelId((packed >> 16) as u16), packed as u16);
        (0..count).map(|_| Ok(entry(self.u32()?))).collect()
    }

    fn frames(&mut self, points: usize, count: usize) -> Result<Vec<FramePairs>, &'static str> {
        let mut frames: Vec<FramePairs> = Vec::new();
        for _ in 0..count {
            let [frame, width, height] = [self.u32()?, self.u32()?, self.u32()?];
            let mut starts = vec![0u32];
            for _ in 0..points.div_ceil(CHUNK) {
                starts.push(starts[starts.len() - 1].checked_add(self.u32()?).ok_or("damaged")?);
            }
            let bytes = self.take(starts[starts.len() - 1] as usize)?.to_vec();
            if frames.last().is_some_and(|last| last.frame >= frame) {
                return Err("damaged");
            }
            frames.push(FramePairs { frame, width, height, starts, bytes });
        }
        Ok(frames)
    }
}

/// A writer that sums what goes through it.
struct Summed<W: Write> {
    out: W,
    sum: Checksum,
}

impl<W: Write> Summed<W> {
    fn write_all(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.sum.add(bytes);
        self.out.write_all(bytes)
    }

    fn u32(&mut self, value: u32) -> std::io::Result<()> {
        self.write_all(&value.to_le_bytes())
    }

    fn u64(&mut self, value: u64) -> std::io::Result<()> {
        self.write_all(&value.to_le_bytes())
    }
}

/// FNV-1a over words of 8 bytes; how the bytes are cut into calls does not matter.
#[derive(Debug, Clone, Copy)]
struct Checksum {
    hash: u64,
    word: u64,
    filled: u32,
}

impl Default for Checksum {
    fn default() -> Self {
        Self { hash: 0xCBF2_9CE4_8422_2325, word: 0, filled: 0 }
    }
}

impl Checksum {
    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.word |= u64::from(byte) << (8 * self.filled);
            self.filled += 1;
            if self.filled == 8 {
                *self = Self { hash: self.mixed(), word: 0, filled: 0 };
            }
        }
    }

    fn mixed(&self) -> u64 {
        (self.hash ^ self.word).wrapping_mul(0x0000_0100_0000_01B3).rotate_left(29)
    }

    fn value(&self) -> u64 {
        self.mixed() ^ u64::from(self.filled)
    }
}
