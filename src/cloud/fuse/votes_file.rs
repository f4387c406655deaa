use std::io::{Read, Write};
use std::sync::Arc;

use rayon::prelude::*;

use super::pairs::{CHUNK, PairReader};
use super::votes::{FramePairs, Votes};
use ostra_masks::LabelId;

/// First bytes of a votes file.
const MAGIC: &[u8; 8] = b"OSTRAVOT";
/// File version; a reader rejects newer ones.
const VERSION: u32 = 1;

/// Writes votes in a compact binary format.
///
/// The file holds a magic number, the version, counts, histograms, pairs and a final checksum. All
/// numbers are little-endian.
///
/// # Errors
///
/// Returns any error of the writer.
pub fn write_votes<W: Write>(mut out: W, votes: &Votes) -> std::io::Result<()> {
    let mut sum = Checksum::default();
    let mut put = |bytes: &[u8]| {
        sum.add(bytes);
        out.write_all(bytes)
    };
    put(MAGIC)?;
    put(&words([
        VERSION,
        CHUNK as u32,
        votes.min_confidence.to_bits(),
        u32::from(votes.has_pairs),
    ]))?;
    let counts = [votes.len(), votes.entries.len(), votes.frames.len()];
    put(&counts.map(|count| (count as u64).to_le_bytes()).concat())?;
    put(&words(lengths(&votes.offsets)))?;
    put(&words(votes.entries.iter().map(|(id, count)| {
        u32::from(id.0) << 16 | u32::from(*count)
    })))?;
    for frame in &votes.frames {
        put(&words(
            [frame.frame, frame.width, frame.height]
                .into_iter()
                .chain(lengths(&frame.starts)),
        ))?;
        put(&frame.bytes)?;
    }
    let sum = sum.value();
    out.write_all(&sum.to_le_bytes())?;
    out.flush()
}

fn words(values: impl IntoIterator<Item = u32>) -> Vec<u8> {
    values.into_iter().flat_map(u32::to_le_bytes).collect()
}

fn lengths(running: &[u32]) -> impl Iterator<Item = u32> {
    running.windows(2).map(|range| range[1] - range[0])
}

/// Reads the output of [`write_votes`], validating every length and every pair.
///
/// # Errors
///
/// Returns any error of the reader, and `InvalidData` with a one-line reason if the file is
/// truncated, damaged or from a newer version. Lost votes can be restored by fusing again.
pub fn read_votes<R: Read>(mut reader: R) -> std::io::Result<Votes> {
    let mut bytes = Vec::new();
    reader.read_to_end(&mut bytes)?;
    parse(&bytes).map_err(|what| {
        std::io::Error::new(
            std::io::ErrorKind::InvalidData,
            format!("the votes are {what}; fuse again"),
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
    let sound = input.0.len() == 8
        && votes
            .frames
            .par_iter()
            .all(|frame| pairs_are_sound(frame, points));
    if sound { Ok(votes) } else { Err("damaged") }
}

/// Returns whether every pair refers to an existing point and pixel.
fn pairs_are_sound(frame: &FramePairs, points: usize) -> bool {
    (0..frame.starts.len() - 1).all(|chunk| {
        let inside = points - chunk * CHUNK;
        let mut reader = PairReader::new(frame.chunk(chunk));
        let fits = reader.by_ref().all(|pair| {
            (pair.point as usize) < inside && pair.x < frame.width && pair.y < frame.height
        });
        fits && !reader.damaged
    })
}

/// The unread rest of a file.
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

    /// Reads a count, which is never above the number of bytes left.
    fn size(&mut self) -> Result<usize, &'static str> {
        let bytes = self.take(8)?;
        let size = bytes.try_into().map_or(0, u64::from_le_bytes);
        usize::try_from(size)
            .ok()
            .filter(|&size| size <= self.0.len())
            .ok_or("cut off")
    }

    /// Reads `count` lengths that sum to `total`, as running sums from 0.
    fn offsets(&mut self, count: usize, total: usize) -> Result<Vec<u32>, &'static str> {
        let mut offsets = Vec::with_capacity(count + 1);
        offsets.push(0u32);
        let mut sum = 0u32;
        for _ in 0..count {
            sum = sum.checked_add(self.u32()?).ok_or("damaged")?;
            offsets.push(sum);
        }
        if sum as usize == total {
            Ok(offsets)
        } else {
            Err("damaged")
        }
    }

    fn entries(&mut self, count: usize) -> Result<Vec<(LabelId, u16)>, &'static str> {
        let entry = |packed: u32| (LabelId((packed >> 16) as u16), packed as u16);
        (0..count).map(|_| Ok(entry(self.u32()?))).collect()
    }

    fn frames(
        &mut self,
        points: usize,
        count: usize,
    ) -> Result<Vec<Arc<FramePairs>>, &'static str> {
        let mut frames: Vec<Arc<FramePairs>> = Vec::new();
        for _ in 0..count {
            let [frame, width, height] = [self.u32()?, self.u32()?, self.u32()?];
            let mut starts = vec![0u32];
            for _ in 0..points.div_ceil(CHUNK) {
                starts.push(
                    starts[starts.len() - 1]
                        .checked_add(self.u32()?)
                        .ok_or("damaged")?,
                );
            }
            let bytes = self.take(starts[starts.len() - 1] as usize)?.to_vec();
            if frames.last().is_some_and(|last| last.frame >= frame) {
                return Err("damaged");
            }
            frames.push(Arc::new(FramePairs {
                frame,
                width,
                height,
                starts,
                bytes,
            }));
        }
        Ok(frames)
    }
}

/// FNV-1a over 8-byte words.
///
/// The result does not depend on how the bytes are split into calls.
#[derive(Debug, Clone)]
struct Checksum {
    hash: u64,
    rest: Vec<u8>,
}

impl Default for Checksum {
    fn default() -> Self {
        Self {
            hash: 0xCBF2_9CE4_8422_2325,
            rest: Vec::new(),
        }
    }
}

impl Checksum {
    fn add(&mut self, bytes: &[u8]) {
        let (fill, bytes) = bytes.split_at(bytes.len().min((8 - self.rest.len()) % 8));
        self.rest.extend_from_slice(fill);
        let (words, rest) = bytes.as_chunks::<8>();
        if let Ok(word) = <[u8; 8]>::try_from(&self.rest[..]) {
            self.mix(word);
            self.rest.clear();
        }
        words.iter().for_each(|&word| self.mix(word));
        self.rest.extend_from_slice(rest);
    }

    fn mix(&mut self, word: [u8; 8]) {
        let word = u64::from_le_bytes(word);
        self.hash = (self.hash ^ word)
            .wrapping_mul(0x0000_0100_0000_01B3)
            .rotate_left(29);
    }

    fn value(mut self) -> u64 {
        let length = self.rest.len();
        self.add(&[length as u8; 8][length..]);
        self.hash
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn checksum_does_not_depend_on_how_bytes_are_split(bytes in prop::collection::vec(any::<u8>(), 0..100), cuts in prop::collection::vec(0usize..30, 0..20)) {
            let mut whole = Checksum::default();
            whole.add(&bytes);
            let (mut parts, mut rest) = (Checksum::default(), &bytes[..]);
            for cut in cuts {
                let (part, after) = rest.split_at(cut.min(rest.len()));
                parts.add(part);
                rest = after;
            }
            parts.add(rest);
            prop_assert_eq!(whole.value(), parts.value());
        }
    }
}
