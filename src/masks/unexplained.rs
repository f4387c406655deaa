//! Areas that no label explains, offered as new objects.

use super::{Connectivity, LabelId, LabelMask, Region, components};

/// An area of a frame that no label explains and that may be a thing of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Unexplained {
    /// Where it is, at the frame's size.
    pub region: Region,
    /// Why it is offered.
    pub why: Apartness,
    /// How much speaks for it; only for comparison with others of the same kind.
    pub strength: f32,
}

/// What sets an area apart from what is around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Apartness {
    /// It moves unlike the background.
    Moves,
    /// It stands before what is around it.
    Stands,
}

/// Smallest area of a thing, as a share of the frame.
const LEAST_SHARE: f64 = 0.002;
/// Largest.
const MOST_SHARE: f64 = 0.3;
/// How far beside labels nothing is offered: their outlines are not exact.
const BESIDE_LABELS_PX: f64 = 6.0;

/// The connected parts of a region that are large enough, and not too large, for a thing.
pub fn parts(region: &Region) -> impl Iterator<Item = Region> + '_ {
    let pieces = components(region, Connectivity::Eight);
    let pixels = region.inside.len() as f64;
    let fits =
        move |area: usize| (LEAST_SHARE * pixels..=MOST_SHARE * pixels).contains(&(area as f64));
    let numbers: Vec<u32> = (1..)
        .zip(&pieces.areas)
        .filter(|(_, area)| fits(**area))
        .map(|(number, _)| number)
        .collect();
    numbers.into_iter().map(move |number| {
        let inside = pieces.labels.iter().map(|&piece| piece == number).collect();
        let mut part = Region {
            width: region.width,
            height: region.height,
            inside,
        };
        part.fill_holes(usize::MAX);
        part
    })
}

/// All labelled pixels of a mask, and those close beside them.
pub fn explained(mask: &LabelMask) -> Region {
    let inside = mask.ids.iter().map(|&id| id != LabelId::NONE).collect();
    Region {
        width: mask.width,
        height: mask.height,
        inside,
    }
    .dilated(BESIDE_LABELS_PX)
}
