//! Run lengths of regions as stored by the COCO data set.
//!
//! Runs go column by column and alternate between outside and inside; the first one, which may be
//! 0, is outside. They are stored as plain numbers or packed into text.

use std::ops::Range;

use crate::{LabelId, LabelMask, RunMask};

/// Returns the run lengths of each of `ids` in a mask.
pub(super) fn column_counts(mask: &LabelMask, ids: &[LabelId]) -> Vec<Vec<u32>> {
    let columns = RunMask::encode(&transposed(mask));
    ids.iter().map(|&id| counts_of(&columns, id)).collect()
}

/// Emits the pixels that run lengths describe, as indices row by row.
///
/// # Errors
/// A description of the fault when the run lengths do not add up to the image size.
pub(super) fn spans(
    counts: &[u32],
    width: u32,
    height: u32,
    emit: &mut dyn FnMut(Range<usize>),
) -> Result<(), String> {
    let sum: u64 = counts.iter().map(|&count| u64::from(count)).sum();
    if sum != u64::from(width) * u64::from(height) {
        return Err(format!(
            "run lengths add up to {sum} pixels, {width}×{height} are needed"
        ));
    }
    let mut start = 0usize;
    for (turn, &count) in counts.iter().enumerate() {
        let end = start + count as usize;
        if turn % 2 == 1 {
            for place in start..end {
                let (column, row) = (place / height as usize, place % height as usize);
                let at = row * width as usize + column;
                emit(at..at + 1);
            }
        }
        start = end;
    }
    Ok(())
}

/// Packs run lengths into text.
///
/// From the fourth on, each length is stored as the difference to the one two before. Values are
/// split into groups of five bits from the lowest. A sixth bit marks that more groups follow, and
/// characters start at `0`.
pub(super) fn packed(counts: &[u32]) -> String {
    let mut text = String::new();
    for (at, &count) in counts.iter().enumerate() {
        let before = if at > 2 { i64::from(counts[at - 2]) } else { 0 };
        let mut rest = i64::from(count) - before;
        loop {
            let group = (rest & 31) as u8;
            rest >>= 5;
            // The highest bit of the last group is the sign.
            let done = rest == if group & 16 == 0 { 0 } else { -1 };
            text.push(char::from(b'0' + group + if done { 0 } else { 32 }));
            if done {
                break;
            }
        }
    }
    text
}

/// Unpacks the output of [`packed`].
///
/// # Errors
/// A description of the fault in damaged text.
pub(super) fn unpacked(text: &str) -> Result<Vec<u32>, String> {
    let broken = || "the packed run lengths are damaged".to_owned();
    let mut counts: Vec<u32> = Vec::new();
    let (mut value, mut shift) = (0i64, 0u32);
    for byte in text.bytes() {
        let group = byte
            .checked_sub(b'0')
            .filter(|&group| group < 64 && shift <= 35)
            .ok_or_else(broken)?;
        value |= i64::from(group & 31) << shift;
        shift += 5;
        if group & 32 != 0 {
            continue;
        }
        if group & 16 != 0 {
            value |= -1 << shift;
        }
        let before = if counts.len() > 2 {
            i64::from(counts[counts.len() - 2])
        } else {
            0
        };
        counts.push(u32::try_from(value + before).map_err(|_| broken())?);
        (value, shift) = (0, 0);
    }
    if shift == 0 {
        Ok(counts)
    } else {
        Err(broken())
    }
}

fn transposed(mask: &LabelMask) -> LabelMask {
    let (width, height) = (mask.width as usize, mask.height as usize);
    let mut ids = vec![LabelId::NONE; mask.ids.len()];
    // Blocks of rows keep both source and target in the cache.
    for block in (0..height).step_by(32) {
        for x in 0..width {
            for y in block..height.min(block + 32) {
                ids[x * height + y] = mask.ids[y * width + x];
            }
        }
    }
    LabelMask {
        width: mask.height,
        height: mask.width,
        ids,
    }
}

fn counts_of(columns: &RunMask, id: LabelId) -> Vec<u32> {
    let mut counts = vec![0u32];
    for &(at, length) in &columns.runs {
        let inside = at == id;
        if inside == (counts.len() % 2 == 0) {
            let last = counts.len() - 1;
            counts[last] += length;
        } else {
            counts.push(length);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Region;

    #[test]
    fn packing_matches_pycocotools() {
        // Packed by pycocotools 2.0 from the same regions.
        for (counts, text) in REFERENCE {
            assert_eq!(packed(counts), *text);
            assert_eq!(unpacked(text).unwrap(), *counts);
        }
    }

    const REFERENCE: &[(&[u32], &str)] = &[
        (&[11, 3, 2, 1, 1, 1, 2, 3, 2, 3, 6], ";32NO012004"),
        (
            &[0, 5, 475, 5, 475, 5, 23135, 200, 280, 200, 385_140],
            "05k>000TTf0S6ieYO0ljg;",
        ),
        (
            &[100_000, 1, 2, 300_000, 9917, 1, 1],
            "PeQ312onT9ke9QQkFTZF",
        ),
        (&[409_920], "PZ`<"),
    ];

    #[test]
    fn damaged_run_lengths_are_errors() {
        for text in ["!", "P", "oooooooooooooooo0", "0000000@", "\u{e9}"] {
            assert!(unpacked(text).is_err(), "{text}");
        }
        assert!(spans(&[3, 2], 2, 2, &mut |_| ()).is_err());
        assert!(spans(&[u32::MAX, u32::MAX], 2, 2, &mut |_| ()).is_err());
    }

    proptest! {
        #[test]
        fn regions_round_trip((width, ids) in (1u32..12).prop_flat_map(|width| (Just(width), prop::collection::vec(0u16..3, (width * 7) as usize)))) {
            let mask = LabelMask { width, height: 7, ids: ids.into_iter().map(LabelId).collect() };
            let all = [LabelId(1), LabelId(2)];
            for (id, counts) in all.into_iter().zip(column_counts(&mask, &all)) {
                let mut read = Region::empty(width, 7);
                spans(&unpacked(&packed(&counts)).unwrap(), width, 7, &mut |pixels| read.inside[pixels].fill(true)).unwrap();
                prop_assert_eq!(read, mask.region(id));
            }
        }

        #[test]
        fn arbitrary_lengths_round_trip(counts in prop::collection::vec(any::<u32>(), 0..20)) {
            prop_assert_eq!(unpacked(&packed(&counts)).unwrap(), counts);
        }
    }
}
