//! Unlabelled areas that are proposed as new objects.

use crate::graph_cut::depth_surfaces::{DepthEdges, depth_edges, known};
use crate::{Connectivity, LabelId, LabelMask, Region, components};
use ostra_core::statistics::upper_median;
use ostra_frames::DepthMap;

/// An unlabelled area of a frame that may be an object of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct Unexplained {
    /// Pixels of the area, at the frame's size.
    pub region: Region,
    /// Reason for proposing it.
    pub why: Apartness,
    /// Strength of the evidence; comparable only among areas with the same reason.
    pub strength: f32,
}

/// Reason why an area is separate from its surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Apartness {
    /// It moves differently from the background.
    Moves,
    /// It stands in front of its surroundings.
    Stands,
}

/// Minimum area of an object, as a share of the frame.
const LEAST_SHARE: f64 = 0.002;
/// Maximum area of an object, as a share of the frame.
const MOST_SHARE: f64 = 0.3;
/// Distance from labels within which nothing is proposed, pixels: their outlines are not exact.
const NEAR_LABELS_PX: f64 = 6.0;

/// Returns the connected parts of a region that have a plausible size for an object.
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

/// Returns all labelled pixels of a mask and those close to them.
pub fn explained(mask: &LabelMask) -> Region {
    let inside = mask.ids.iter().map(|&id| id != LabelId::NONE).collect();
    Region {
        width: mask.width,
        height: mask.height,
        inside,
    }
    .dilated(NEAR_LABELS_PX)
}

/// Minimum strength of an edge that separates two surfaces.
const PARTS: f32 = 0.5;
/// Width of the ring around an area in which its surroundings are examined, pixels.
const AROUND_PX: f64 = 4.0;
/// Minimum relative step in depth to the surroundings behind.
const LEAST_STEP: f32 = 0.02;
/// Minimum share of the surroundings that lie behind.
const LEAST_BEHIND: f32 = 0.6;

/// Returns unlabelled areas of a depth map that stand in front of their surroundings.
///
/// The areas are separated by steps in depth. Returns nothing if depth map and mask differ in size.
#[must_use]
pub fn areas_in_front(depth: &DepthMap, mask: &LabelMask) -> Vec<Unexplained> {
    if (depth.width, depth.height) != (mask.width, mask.height) {
        return Vec::new();
    }
    let smooth = surfaces(depth, &depth_edges(depth));
    let taken = explained(mask);
    let offered = |part: Region| {
        let free = part
            .inside
            .iter()
            .zip(&taken.inside)
            .filter(|(inside, taken)| **inside && !**taken)
            .count();
        let strength = behind(depth, &part);
        let stands = strength >= LEAST_BEHIND && 2 * free > part.area();
        stands.then_some(Unexplained {
            region: part,
            why: Apartness::Stands,
            strength,
        })
    };
    parts(&smooth).filter_map(offered).collect()
}

/// Returns the pixels with known depth that have no edge next to them.
fn surfaces(depth: &DepthMap, edges: &DepthEdges) -> Region {
    let width = depth.width as usize;
    let cut = |strengths: &[f32], at: Option<usize>| at.is_some_and(|at| strengths[at] >= PARTS);
    let inside = (0..depth.depths.len()).map(|at| {
        let adjacent = cut(&edges.right, Some(at))
            || cut(&edges.right, (at % width).checked_sub(1).map(|_| at - 1));
        let above = cut(&edges.down, Some(at)) || cut(&edges.down, at.checked_sub(width));
        known(depth.depths[at]) && !adjacent && !above
    });
    Region {
        width: depth.width,
        height: depth.height,
        inside: inside.collect(),
    }
}

/// Returns the share of known depths around an area that lie behind its median; 0 if few are known.
fn behind(depth: &DepthMap, part: &Region) -> f32 {
    let mut around = part.dilated(AROUND_PX);
    around.subtract(part);
    let of = |region: &Region| -> Vec<f32> {
        let inside = depth
            .depths
            .iter()
            .zip(&region.inside)
            .filter(|(_, inside)| **inside);
        inside
            .map(|(&depth, _)| depth)
            .filter(|&depth| known(depth))
            .collect()
    };
    let mut own = of(part);
    let Some(middle) = upper_median(&mut own) else {
        return 0.0;
    };
    let others = of(&around);
    let behind = others
        .iter()
        .filter(|&&other| other > middle * (1.0 + LEAST_STEP))
        .count();
    if others.len() * 4 < around.area() {
        0.0
    } else {
        behind as f32 / others.len() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::LabelId;

    #[test]
    fn object_in_front_of_a_wall_is_proposed_and_a_hole_is_not() {
        let depth_at = |at: usize| match (at % 200, at / 200) {
            (40..80, 30..70) => 1.0,
            (120..160, 30..70) => 2.6,
            _ => 2.0,
        };
        let depth = DepthMap {
            width: 200,
            height: 120,
            depths: (0..200 * 120).map(depth_at).collect(),
        };
        let mut mask = LabelMask::empty(200, 120);
        let found = areas_in_front(&depth, &mask);
        assert_eq!(found.len(), 1);
        assert!((1300..=1600).contains(&found[0].region.area()) && found[0].region.at(60, 50));
        mask.ids
            .iter_mut()
            .enumerate()
            .filter(|(at, _)| (40..80).contains(&(at % 200)))
            .for_each(|(_, id)| *id = LabelId(3));
        assert!(areas_in_front(&depth, &mask).is_empty());
    }
}
