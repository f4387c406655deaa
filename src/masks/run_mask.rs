use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{LabelId, LabelMask, LabelTree, MaskError, Region};

/// Maximum number of columns and rows of a mask read from a file.
pub(super) const MAX_SIDE: u32 = 65_535;
/// Maximum number of pixels of a mask read from a file.
///
/// This is 268 megapixels, more than any camera has. A few bytes of run lengths can claim any
/// number of pixels, and decoding takes two bytes for each.
pub(super) const MAX_PIXELS: u64 = 1 << 28;

/// A run-length encoded [`LabelMask`], as projects store it and keep it in their history.
///
/// Runs go row by row and may continue across rows. Masks read from a file are checked like those
/// of [`RunMask::new`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "StoredRuns")]
pub struct RunMask {
    /// Number of columns.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// (id, length) of each run.
    ///
    /// Lengths are above 0 and sum to `width · height`; neighbours differ in id.
    pub runs: Vec<(LabelId, u32)>,
}

/// Area and bounding box of a label in a mask, in whole pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extent {
    /// Number of pixels.
    pub area: u64,
    /// First column and row.
    pub min: [u32; 2],
    /// Last column and row (inclusive).
    pub max: [u32; 2],
}

#[derive(Deserialize)]
struct StoredRuns {
    width: u32,
    height: u32,
    runs: Vec<(LabelId, u32)>,
}

impl TryFrom<StoredRuns> for RunMask {
    type Error = MaskError;

    fn try_from(stored: StoredRuns) -> Result<Self, MaskError> {
        Self::new(stored.width, stored.height, stored.runs)
    }
}

impl RunMask {
    /// Creates a mask from runs; neighbours with equal ids are merged.
    ///
    /// # Errors
    /// [`MaskError::Request`] for a run of length 0, for lengths that do not sum to `width ·
    /// height`, or for a mask of more than 65,535 pixels on a side or 268 megapixels in all.
    pub fn new(width: u32, height: u32, runs: Vec<(LabelId, u32)>) -> Result<Self, MaskError> {
        if runs.iter().any(|&(_, length)| length == 0) {
            return Err(MaskError::Request(
                "a mask holds a run of length 0; it is damaged, make it again".into(),
            ));
        }
        let pixels = u64::from(width) * u64::from(height);
        if width.max(height) > MAX_SIDE || pixels > MAX_PIXELS {
            return Err(MaskError::Request(format!(
                "a mask claims {width}×{height} pixels; at most {MAX_SIDE} on a side and {} megapixels in all are read",
                MAX_PIXELS / 1_000_000
            )));
        }
        let sum: u64 = runs.iter().map(|&(_, length)| u64::from(length)).sum();
        if sum != pixels {
            return Err(MaskError::Request(format!(
                "a mask's runs hold {sum} pixels, {width}×{height} are needed; it is damaged, make it again"
            )));
        }
        Ok(Self {
            width,
            height,
            runs: merged(runs.into_iter()),
        })
    }

    /// Returns a mask without labels.
    #[must_use]
    #[inline]
    pub fn empty(width: u32, height: u32) -> Self {
        let pixels = width.saturating_mul(height);
        Self {
            width,
            height,
            runs: if pixels == 0 {
                Vec::new()
            } else {
                vec![(LabelId::NONE, pixels)]
            },
        }
    }

    /// Run-length encodes a mask.
    #[must_use]
    #[inline]
    pub fn encode(mask: &LabelMask) -> Self {
        let runs = mask
            .ids
            .chunk_by(|a, b| a == b)
            .map(|run| (run[0], run.len() as u32))
            .collect();
        Self {
            width: mask.width,
            height: mask.height,
            runs,
        }
    }

    /// Decodes the mask to pixels.
    #[must_use]
    #[inline]
    pub fn decode(&self) -> LabelMask {
        let mut ids = Vec::with_capacity(self.width as usize * self.height as usize);
        for &(id, length) in &self.runs {
            ids.resize(ids.len() + length as usize, id);
        }
        LabelMask {
            width: self.width,
            height: self.height,
            ids,
        }
    }

    /// Decodes the mask at a smaller size, with at most `max_side` pixels on its longer side.
    ///
    /// A cell has the label of the last labelled pixel in it, so that a stem thinner than a cell
    /// stays visible. A mask that is small enough keeps its size.
    #[must_use]
    pub fn decode_small(&self, max_side: u32) -> LabelMask {
        let longest = self.width.max(self.height);
        if longest <= max_side {
            return self.decode();
        }
        let scaled = |length: u32| {
            ((u64::from(length) * u64::from(max_side)) / u64::from(longest)).max(1) as u32
        };
        let mut small = LabelMask::empty(scaled(self.width), scaled(self.height));
        let cell = |at: u64, from: u32, to: u32| (at * u64::from(to) / u64::from(from)) as usize;
        let (columns, width) = (small.width as usize, u64::from(self.width));
        let mut begin = 0_u64;
        for &(id, length) in &self.runs {
            let end = begin + u64::from(length);
            while begin < end {
                let (row, left) = (begin / width, begin % width);
                let right = (left + end - begin).min(width);
                if id != LabelId::NONE {
                    let first = cell(left, self.width, small.width);
                    let last = cell(right - 1, self.width, small.width);
                    let line = cell(row, self.height, small.height) * columns;
                    small.ids[line + first..=line + last].fill(id);
                }
                begin += right - left;
            }
        }
        small
    }

    /// Returns the pixels of one label.
    #[must_use]
    #[inline]
    pub fn region(&self, id: LabelId) -> Region {
        let mut inside = Vec::with_capacity(self.width as usize * self.height as usize);
        for &(at, length) in &self.runs {
            inside.resize(inside.len() + length as usize, at == id);
        }
        Region {
            width: self.width,
            height: self.height,
            inside,
        }
    }

    /// Returns area and bounding box of every label in the mask, except [`LabelId::NONE`].
    ///
    /// They are computed from the runs without decoding.
    #[must_use]
    #[inline]
    pub fn extents(&self) -> BTreeMap<LabelId, Extent> {
        let mut extents: BTreeMap<LabelId, Extent> = BTreeMap::new();
        let mut start = 0u32;
        for &(id, length) in &self.runs {
            if id != LabelId::NONE {
                let run = self.run_extent(start, length);
                extents
                    .entry(id)
                    .and_modify(|extent| extent.join(&run))
                    .or_insert(run);
            }
            start += length;
        }
        extents
    }

    /// Replaces every id by `map(id)`, [`LabelId::NONE`] included.
    #[must_use]
    #[inline]
    pub fn map_ids(&self, mut map: impl FnMut(LabelId) -> LabelId) -> Self {
        let runs = merged(self.runs.iter().map(|&(id, length)| (map(id), length)));
        Self {
            width: self.width,
            height: self.height,
            runs,
        }
    }

    /// Replaces every label by its ancestor at `level` (1 = top); labels that are not deeper stay.
    #[must_use]
    #[inline]
    pub fn at_level(&self, tree: &LabelTree, level: usize) -> Self {
        let mut known: BTreeMap<LabelId, LabelId> = BTreeMap::new();
        self.map_ids(|id| *known.entry(id).or_insert_with(|| tree.at_level(id, level)))
    }

    /// Returns the runs over which both masks are constant, in order.
    ///
    /// Each item is this mask's id, the other's id, and the length.
    ///
    /// The masks must have the same size.
    pub fn joint_runs<'a>(
        &'a self,
        other: &'a Self,
    ) -> impl Iterator<Item = (LabelId, LabelId, u32)> + 'a {
        debug_assert_eq!(
            (self.width, self.height),
            (other.width, other.height),
            "masks of one frame"
        );
        let (mut ours, mut theirs) = (self.runs.iter().copied(), other.runs.iter().copied());
        let (mut our_run, mut their_run) = (ours.next(), theirs.next());
        std::iter::from_fn(move || {
            let ((our_id, our_length), (their_id, their_length)) = (our_run?, their_run?);
            let length = our_length.min(their_length);
            let left = |id, of: u32| (of > length).then_some((id, of - length));
            our_run = left(our_id, our_length).or_else(|| ours.next());
            their_run = left(their_id, their_length).or_else(|| theirs.next());
            Some((our_id, their_id, length))
        })
    }

    /// Returns an error if the other mask has another size.
    pub(super) fn check_same_size(&self, other: &Self) -> Result<(), MaskError> {
        if (self.width, self.height) == (other.width, other.height) {
            return Ok(());
        }
        Err(MaskError::Request(format!(
            "labels of a mask of {}×{} pixels do not fit a frame of {}×{}; make the mask again",
            other.width, other.height, self.width, self.height
        )))
    }

    /// Returns the intersection over union of every label in either mask, except [`LabelId::NONE`].
    #[must_use]
    pub fn ious(&self, other: &Self) -> BTreeMap<LabelId, f64> {
        let mut counts: BTreeMap<LabelId, (u64, u64)> = BTreeMap::new();
        for (ours, theirs, length) in self.joint_runs(other) {
            let length = u64::from(length);
            counts.entry(ours).or_default().1 += length;
            if ours == theirs {
                counts.entry(ours).or_default().0 += length;
            } else {
                counts.entry(theirs).or_default().1 += length;
            }
        }
        counts.remove(&LabelId::NONE);
        counts
            .into_iter()
            .map(|(id, (common, either))| (id, common as f64 / either as f64))
            .collect()
    }

    fn run_extent(&self, start: u32, length: u32) -> Extent {
        let last = start + length - 1;
        let (first_row, last_row) = (start / self.width, last / self.width);
        let columns = if first_row == last_row {
            (start % self.width, last % self.width)
        } else {
            (0, self.width - 1)
        };
        Extent {
            area: u64::from(length),
            min: [columns.0, first_row],
            max: [columns.1, last_row],
        }
    }
}

impl Extent {
    fn join(&mut self, other: &Self) {
        self.area += other.area;
        for axis in 0..2 {
            self.min[axis] = self.min[axis].min(other.min[axis]);
            self.max[axis] = self.max[axis].max(other.max[axis]);
        }
    }
}

pub(super) fn merged(runs: impl Iterator<Item = (LabelId, u32)>) -> Vec<(LabelId, u32)> {
    let mut kept: Vec<(LabelId, u32)> = Vec::with_capacity(runs.size_hint().0);
    for (id, length) in runs {
        match kept.last_mut() {
            Some(last) if last.0 == id => last.1 += length,
            _ => kept.push((id, length)),
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Small masks with long and short runs.
    fn masks() -> impl Strategy<Value = LabelMask> {
        (1u32..20, 1u32..20).prop_flat_map(|(width, height)| {
            let pixels = (width * height) as usize;
            prop::collection::vec(
                (
                    prop::sample::select(vec![0u16, 1, 2, 255, 256, u16::MAX]),
                    1usize..9,
                ),
                pixels,
            )
            .prop_map(move |runs| {
                let ids = runs
                    .into_iter()
                    .flat_map(|(id, n)| std::iter::repeat_n(LabelId(id), n))
                    .take(pixels);
                LabelMask {
                    width,
                    height,
                    ids: ids.collect(),
                }
            })
        })
    }

    proptest! {
        #[test]
        fn small_mask_shows_every_labelled_cell_and_no_other(mask in masks(), side in 1_u32..24) {
            let small = RunMask::encode(&mask).decode_small(side);
            let longest = mask.width.max(mask.height);
            prop_assert!(small.width.max(small.height) <= side.max(1) || longest <= side);
            prop_assert_eq!(longest <= side, small == mask);
            let cell_of = |x: u32, y: u32| {
                (x * small.width / mask.width, y * small.height / mask.height)
            };
            let mut seen: BTreeMap<(u32, u32), Vec<LabelId>> = BTreeMap::new();
            for y in 0..mask.height {
                for x in (0..mask.width).filter(|&x| mask.at(x, y) != LabelId::NONE) {
                    seen.entry(cell_of(x, y)).or_default().push(mask.at(x, y));
                }
            }
            for y in 0..small.height {
                for x in 0..small.width {
                    match seen.get(&(x, y)) {
                        Some(ids) => prop_assert!(ids.contains(&small.at(x, y))),
                        None => prop_assert_eq!(small.at(x, y), LabelId::NONE),
                    }
                }
            }
        }
    }

    /// Two masks of one size.
    fn pairs() -> impl Strategy<Value = (LabelMask, LabelMask)> {
        (masks(), any::<prop::sample::Index>()).prop_map(|(mask, shift)| {
            let mut other = mask.clone();
            other.ids.rotate_left(shift.index(mask.ids.len()));
            (mask, other)
        })
    }

    proptest! {
        #[test]
        fn encoding_is_lossless(mask in masks()) {
            let runs = RunMask::encode(&mask);
            prop_assert_eq!(runs.decode(), mask.clone());
            prop_assert!(runs.runs.windows(2).all(|pair| pair[0].0 != pair[1].0));
            let read: RunMask = serde_json::from_str(&serde_json::to_string(&runs).unwrap()).unwrap();
            prop_assert_eq!(&read, &runs);
            let pieces = runs.runs.iter().flat_map(|&(id, n)| std::iter::repeat_n((id, 1), n as usize)).collect();
            prop_assert_eq!(RunMask::new(mask.width, mask.height, pieces).unwrap(), runs);
        }

        #[test]
        fn joint_runs_match_the_pixels((a, b) in pairs()) {
            let (runs, others) = (RunMask::encode(&a), RunMask::encode(&b));
            let joint = runs.joint_runs(&others);
            let pixels: Vec<_> = joint.flat_map(|(a, b, n)| std::iter::repeat_n((a, b), n as usize)).collect();
            prop_assert_eq!(pixels, a.ids.iter().copied().zip(b.ids.iter().copied()).collect::<Vec<_>>());
            for (id, iou) in runs.ious(&others) {
                prop_assert!(id != LabelId::NONE && (iou - a.region(id).iou(&b.region(id))).abs() < 1e-12);
            }
        }

        #[test]
        fn extents_match_the_pixels(mask in masks()) {
            let runs = RunMask::encode(&mask);
            let mut expected: BTreeMap<LabelId, Extent> = BTreeMap::new();
            for y in 0..mask.height {
                for x in 0..mask.width {
                    let pixel = Extent { area: 1, min: [x, y], max: [x, y] };
                    expected.entry(mask.at(x, y)).and_modify(|extent| extent.join(&pixel)).or_insert(pixel);
                }
            }
            expected.remove(&LabelId::NONE);
            for &id in expected.keys() {
                prop_assert_eq!(runs.region(id), mask.region(id));
            }
            prop_assert_eq!(runs.extents(), expected);
        }
    }

    #[test]
    fn damaged_runs_are_rejected() {
        for (text, fine) in [
            (r#"{"width":2,"height":2,"runs":[[0,1],[0,1],[3,2]]}"#, true),
            (r#"{"width":2,"height":2,"runs":[[0,1],[3,2]]}"#, false),
            (r#"{"width":2,"height":2,"runs":[[0,4],[3,0]]}"#, false),
            (
                r#"{"width":2,"height":2,"runs":[[0,4294967295],[3,4294967295]]}"#,
                false,
            ),
            (
                r#"{"width":4294967295,"height":4294967295,"runs":[]}"#,
                false,
            ),
        ] {
            assert_eq!(
                serde_json::from_str::<RunMask>(text).is_ok(),
                fine,
                "{text}"
            );
        }
        let merged: RunMask =
            serde_json::from_str(r#"{"width":2,"height":2,"runs":[[0,1],[0,1],[3,2]]}"#).unwrap();
        assert_eq!(merged.runs, [(LabelId(0), 2), (LabelId(3), 2)]);
    }

    #[test]
    fn mapping_merges_neighbours() {
        let mask = RunMask::new(
            4,
            1,
            vec![(LabelId(1), 1), (LabelId(2), 2), (LabelId(0), 1)],
        )
        .unwrap();
        let mapped = mask.map_ids(|id| if id == LabelId(2) { LabelId(1) } else { id });
        assert_eq!(mapped.runs, [(LabelId(1), 3), (LabelId(0), 1)]);
    }
}
