//! Meaning of mask values that are not plain ids.
//!
//! White can stand for a single object or for "void", and intermediate values can be soft edges.

use std::collections::BTreeSet;

use crate::{LabelId, LabelMask, LabelTree, RunMask};

/// Highest values of 8 and 16 bits.
///
/// They mean the single object in black and white images, and "void" in masks of ids.
const WHITES: [LabelId; 2] = [LabelId(255), LabelId(u16::MAX)];
/// Minimum number of values between 0 and the highest in a soft mask.
const MIN_SOFT_VALUES: usize = 3;
/// Minimum highest value of a soft mask, half of the 8-bit range.
const MIN_SOFT_HIGHEST: u16 = 128;

/// Returns all ids in masks, including 0.
pub(crate) fn ids_in<'m>(masks: impl IntoIterator<Item = &'m RunMask>) -> BTreeSet<LabelId> {
    masks
        .into_iter()
        .flat_map(|mask| mask.runs.iter().map(|run| run.0))
        .collect()
}

/// Returns whether masks are black and white images of one object, label 1.
///
/// Their only value besides 0 is 255 (65535 in 16 bits), and no listed label has that id.
pub(crate) fn is_black_and_white(ids: &BTreeSet<LabelId>, listed: Option<&LabelTree>) -> bool {
    let mut values = ids.iter().filter(|&&id| id != LabelId::NONE);
    let white = values.next().filter(|id| WHITES.contains(id));
    white.is_some_and(|white| {
        values.next().is_none() && listed.is_none_or(|tree| tree.get(*white).is_none())
    })
}

/// Sets every labelled pixel to label 1.
pub(crate) fn white_as_one(mask: &RunMask) -> RunMask {
    mask.map_ids(|id| if id == LabelId::NONE { id } else { LabelId(1) })
}

/// Meaning of white in masks that also have other values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum White {
    /// An ordinary id, or the masks have no white.
    Id,
    /// "Void": unknown pixels, as at object borders in VOC, DAVIS and Cityscapes.
    Void(LabelId),
    /// An id, because the values divide the range evenly.
    ///
    /// Ids are spread like this to be visible (85, 170, 255).
    SpreadId,
    /// Part of a trimap or of an edge: the values are 0, 127 or 128, and 255.
    ///
    /// In a trimap they are background, unknown and foreground.
    Trimap,
}

/// Decides what white means; `known` returns whether a label has an id.
pub(crate) fn meaning_of_white(ids: &BTreeSet<LabelId>, known: impl Fn(LabelId) -> bool) -> White {
    let Some(&white) = ids.last().filter(|id| WHITES.contains(id) && !known(**id)) else {
        return White::Id;
    };
    let others: Vec<u16> = ids
        .iter()
        .map(|id| id.0)
        .filter(|&id| id != 0 && id != white.0)
        .collect();
    if let [middle] = others[..]
        && (white.0 / 2..=white.0 / 2 + 1).contains(&middle)
    {
        return White::Trimap;
    }
    // Of 254 instances a few may be missing. With a void value, so many ids would be a coincidence.
    let dense = others.len() >= usize::from(white.0) * 3 / 4;
    let step = others.iter().copied().fold(white.0, common_divisor);
    match others.len() {
        0 => White::Id,
        _ if dense => White::Id,
        _ if step > 1 && others.len() + 1 == usize::from(white.0 / step) => White::SpreadId,
        _ => White::Void(white),
    }
}

/// Returns whether white covers more pixels than all other labels together.
///
/// Only masks that contain white are counted. Void marks rims and gaps, which cover less.
pub(crate) fn covers_most<'m>(
    white: LabelId,
    masks: impl IntoIterator<Item = &'m RunMask>,
) -> bool {
    let (mut white_area, mut other_area) = (0, 0);
    for extents in masks.into_iter().map(RunMask::extents) {
        if let Some(extent) = extents.get(&white) {
            white_area += extent.area;
            other_area += extents.values().map(|extent| extent.area).sum::<u64>() - extent.area;
        }
    }
    white_area > other_area
}

fn common_divisor(a: u16, b: u16) -> u16 {
    if b == 0 { a } else { common_divisor(b, a % b) }
}

/// Counts that distinguish soft masks of one object from masks of ids.
///
/// Soft masks are antialiased, compressed or resized.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct EdgeStatistics {
    /// Pixels with an examined value.
    between: u64,
    /// Examined pixels with a lower and a higher neighbour, as on a step of a soft edge.
    steps: u64,
    /// Examined pixels with mostly equal neighbours, as inside a label.
    inside: u64,
}

impl EdgeStatistics {
    /// Counts the values of a mask between 0 and the mask's own highest.
    ///
    /// An object may be soft all over, so that none of its pixels has the highest value of all
    /// masks. Values close to the highest are excluded too, because networks seldom give the inside
    /// of an object a single value.
    pub(crate) fn of(mask: &LabelMask) -> Self {
        let highest = mask
            .ids
            .iter()
            .map(|id| u32::from(id.0))
            .max()
            .unwrap_or_default();
        Self::of_values(mask, |id| u32::from(id.0) * 16 < highest * 15)
    }

    /// Counts the non-zero values of a mask for which `counts` is true.
    pub(crate) fn of_values(mask: &LabelMask, counts: impl Fn(LabelId) -> bool) -> Self {
        let (width, height) = (mask.width as usize, mask.height as usize);
        let mut counted = Self::default();
        for (at, &id) in mask.ids.iter().enumerate() {
            if id == LabelId::NONE || !counts(id) {
                continue;
            }
            let (x, y) = (at % width, at / width);
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
            let around = rows.flat_map(|row| &mask.ids[row * width + left..=row * width + right]);
            let (mut lower, mut higher, mut equal) = (false, false, 0);
            for &other in around {
                lower |= other < id;
                higher |= other > id;
                equal += usize::from(other == id);
            }
            counted.between += 1;
            counted.steps += u64::from(lower && higher);
            counted.inside += u64::from(equal >= 6 && !(lower && higher));
        }
        counted
    }

    /// Returns whether most examined pixels are steps between a lower and a higher value.
    ///
    /// Masks of ids have interiors, and their borders form such steps only where labels touch.
    pub(crate) fn are_soft(self) -> bool {
        self.between > 0 && self.steps * 2 >= self.between && self.inside * 4 <= self.between
    }

    /// Returns the sum of both counts.
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            between: self.between + other.between,
            steps: self.steps + other.steps,
            inside: self.inside + other.inside,
        }
    }
}

/// Returns whether masks with these values may be soft masks of one object.
///
/// Such masks have several values up to a high one.
pub(crate) fn may_be_soft(ids: &BTreeSet<LabelId>) -> bool {
    let highest = ids.last().copied().unwrap_or_default();
    let between = ids
        .iter()
        .filter(|&&id| id != LabelId::NONE && id != highest)
        .count();
    between >= MIN_SOFT_VALUES && highest.0 >= MIN_SOFT_HIGHEST
}

/// Returns whether values without a listed label may be soft edges of listed labels.
pub(crate) fn may_be_soft_edges(unlisted: &[LabelId]) -> bool {
    unlisted.len() >= MIN_SOFT_VALUES
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ids(values: impl IntoIterator<Item = u16>) -> BTreeSet<LabelId> {
        values.into_iter().map(LabelId).collect()
    }

    #[test]
    fn white_is_classified_as_void_id_or_object() {
        let meaning = |values: &[u16]| meaning_of_white(&ids(values.iter().copied()), |_| false);
        assert_eq!(meaning(&[0, 1, 2, 255]), White::Void(LabelId(255)));
        assert_eq!(meaning(&[0, 1, 65535]), White::Void(LabelId(65535)));
        assert_eq!(
            meaning(&[0, 1, 255, 300]),
            White::Id,
            "16-bit ids go on above 255"
        );
        assert_eq!(meaning(&[0, 85, 170, 255]), White::SpreadId);
        assert_eq!(meaning(&[0, 51, 102, 255]), White::Void(LabelId(255)));
        assert_eq!(meaning(&[0, 128, 255]), White::Trimap);
        assert_eq!(meaning(&[0, 127, 255]), White::Trimap);
        assert_eq!(meaning(&[0, 255]), White::Id);
        assert_eq!(meaning_of_white(&ids(0..=255), |_| false), White::Id);
        assert_eq!(
            meaning_of_white(&ids([0, 1, 255]), |id| id.0 == 255),
            White::Id
        );
        assert!(
            is_black_and_white(&ids([0, 255]), None) && is_black_and_white(&ids([65535]), None)
        );
        assert!(!is_black_and_white(&ids([0, 1]), None) && !is_black_and_white(&ids([0]), None));
    }

    #[test]
    fn soft_edges_are_distinguished_from_ids() {
        let disc = |value: &dyn Fn(f64) -> u16| {
            let at = |x: u32, y: u32| (f64::from(x) - 20.3).hypot(f64::from(y) - 17.6);
            let values = (0..36)
                .flat_map(|y| (0..40).map(move |x| (x, y)))
                .map(|(x, y)| LabelId(value(at(x, y))));
            LabelMask {
                width: 40,
                height: 36,
                ids: values.collect(),
            }
        };
        let soft = |mask: &LabelMask| {
            let ids: BTreeSet<LabelId> = mask.ids.iter().copied().collect();
            may_be_soft(&ids) && EdgeStatistics::of(mask).are_soft()
        };
        for width in [1.0, 3.0, 8.0] {
            assert!(
                soft(&disc(
                    &|r| (((10.0 - r) / width + 0.5).clamp(0.0, 1.0) * 255.0) as u16
                )),
                "{width}"
            );
        }
        assert!(!soft(&disc(&|r| if r < 4.0 {
            200
        } else if r < 8.0 {
            7
        } else if r < 12.0 {
            30
        } else if r < 15.0 {
            9
        } else {
            0
        })));
        let grid = |step: u32| LabelMask {
            width: 64,
            height: 64,
            ids: (0..64 * 64)
                .map(|at: u32| LabelId((at % 64 / step + at / 64 / step * (64 / step)) as u16))
                .collect(),
        };
        assert!(!soft(&grid(4)), "256 instances side by side");
    }

    #[test]
    fn white_covering_most_labelled_pixels_is_detected() {
        let mask = |runs: &[(u16, u32)]| {
            RunMask::new(
                10,
                1,
                runs.iter()
                    .map(|&(id, length)| (LabelId(id), length))
                    .collect(),
            )
            .unwrap()
        };
        let (rim, object) = (
            mask(&[(0, 3), (1, 5), (255, 2)]),
            mask(&[(0, 3), (254, 2), (255, 5)]),
        );
        let other = mask(&[(2, 10)]);
        assert!(!covers_most(LabelId(255), [&rim, &other]));
        assert!(covers_most(LabelId(255), [&object, &other]));
    }
}
