use ostra_masks::LabelId;

/// Number of points in a chunk. Votes are counted, and pairs stored, chunk by chunk.
pub(super) const CHUNK: usize = 4096;

/// A frame's observation of a point: the pixel that sees it and the vote of that pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    /// Index of the point in its chunk.
    pub(super) point: u32,
    /// Column of the pixel.
    pub(super) x: u32,
    /// Row of the pixel.
    pub(super) y: u32,
    /// The vote, or `None` if the frame has no mask.
    pub(super) vote: Option<LabelId>,
}

/// Encodes the pairs of one frame and one chunk as bytes.
///
/// Differences in point index, column and row are variable-length integers. The vote is written
/// only where it changes. A pair takes about 3 bytes if neighbours in the list are neighbours in
/// space.
#[derive(Debug, Default)]
pub(super) struct PairWriter {
    pub(super) bytes: Vec<u8>,
    pub(super) count: u32,
    next: u32,
    x: u32,
    y: u32,
    vote: u32,
}

impl PairWriter {
    /// Appends a pair. Its point must come after all previous ones.
    pub(super) fn push(&mut self, pair: Pair) {
        let vote = pair.vote.map_or(0, |id| u32::from(id.0) + 1);
        let changed = vote != self.vote;
        put(
            &mut self.bytes,
            (pair.point - self.next) << 1 | u32::from(changed),
        );
        if changed {
            put(&mut self.bytes, vote);
        }
        put(&mut self.bytes, zigzag(pair.x, self.x));
        put(&mut self.bytes, zigzag(pair.y, self.y));
        (self.next, self.x, self.y, self.vote) = (pair.point + 1, pair.x, pair.y, vote);
        self.count += 1;
    }
}

/// Decodes the output of [`PairWriter`].
///
/// Stops at the end of the bytes or at the first bytes that are not a valid pair.
#[derive(Debug, Clone)]
pub(super) struct PairReader<'a> {
    bytes: &'a [u8],
    next: u32,
    x: u32,
    y: u32,
    vote: u32,
    /// Whether invalid bytes were found.
    pub(super) damaged: bool,
}

impl<'a> PairReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self {
            bytes,
            next: 0,
            x: 0,
            y: 0,
            vote: 0,
            damaged: false,
        }
    }

    fn read(&mut self) -> Option<Pair> {
        let step = take(&mut self.bytes)?;
        if step & 1 == 1 {
            self.vote = take(&mut self.bytes).filter(|&vote| vote <= 1 << 16)?;
        }
        self.x = unzigzag(take(&mut self.bytes)?, self.x);
        self.y = unzigzag(take(&mut self.bytes)?, self.y);
        let point = self
            .next
            .checked_add(step >> 1)
            .filter(|&point| (point as usize) < CHUNK)?;
        self.next = point + 1;
        let vote = self.vote.checked_sub(1).map(|id| LabelId(id as u16));
        Some(Pair {
            point,
            x: self.x,
            y: self.y,
            vote,
        })
    }
}

impl Iterator for PairReader<'_> {
    type Item = Pair;

    fn next(&mut self) -> Option<Pair> {
        if self.bytes.is_empty() || self.damaged {
            return None;
        }
        let pair = self.read();
        self.damaged = pair.is_none();
        pair
    }
}

fn put(bytes: &mut Vec<u8>, mut value: u32) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

fn take(bytes: &mut &[u8]) -> Option<u32> {
    let mut value = 0;
    for shift in (0..35).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u32::from(byte & 0x7F) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

/// Encodes the signed difference with the sign in the lowest bit.
///
/// Small steps in either direction thus become small numbers.
fn zigzag(value: u32, from: u32) -> u32 {
    let step = value.wrapping_sub(from) as i32;
    (step << 1 ^ step >> 31) as u32
}

fn unzigzag(step: u32, from: u32) -> u32 {
    from.wrapping_add((step >> 1) ^ (step & 1).wrapping_neg())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pairs_survive_a_round_trip(raw in prop::collection::btree_map(0u32..CHUNK as u32, (any::<u32>(), 0u32..5000, any::<Option<u16>>()), 0..50)) {
            let pairs: Vec<Pair> = raw.iter().map(|(&point, &(x, y, vote))| Pair { point, x, y, vote: vote.map(LabelId) }).collect();
            let mut writer = PairWriter::default();
            pairs.iter().for_each(|&pair| writer.push(pair));
            prop_assert_eq!(writer.count as usize, pairs.len());
            let mut reader = PairReader::new(&writer.bytes);
            prop_assert_eq!(reader.by_ref().collect::<Vec<_>>(), pairs);
            prop_assert!(!reader.damaged);
        }

        #[test]
        fn reader_ends_on_arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            prop_assert!(PairReader::new(&bytes).all(|pair| (pair.point as usize) < CHUNK));
        }
    }

    #[test]
    fn pairs_of_adjacent_pixels_take_about_three_bytes() {
        let mut writer = PairWriter::default();
        for point in 0..1000 {
            writer.push(Pair {
                point,
                x: 300 + point % 40,
                y: 200 + point / 40,
                vote: Some(LabelId(3)),
            });
        }
        assert!(writer.bytes.len() < 3100, "{}", writer.bytes.len());
    }
}
