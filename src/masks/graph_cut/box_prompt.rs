//! Segmentation of the object in a box.
//!
//! Colour models of inside and outside are refined in alternation with a cut over regions (Rother,
//! Kolmogorov and Blake, "GrabCut: interactive foreground extraction using iterated graph cuts",
//! SIGGRAPH 2004).

use super::appearance::{Palette, PaletteHistogram};
use super::graph::{RegionGraph, Role, cheapest_change, distances};
use crate::PxBox;

/// Options for finding the object in a box.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoxOptions {
    /// Number of alternations between model and cut.
    pub rounds: usize,
    /// Margin around the box in which the surroundings are learned, as a share of its half sides.
    pub margin: f32,
    /// Gain of one unit of log odds on one pixel, in pixel sides of a border without an edge.
    pub data_weight: f32,
    /// Parts smaller than this share of the largest are removed.
    pub least_part: f32,
}

impl Default for BoxOptions {
    fn default() -> Self {
        Self {
            rounds: 4,
            margin: 0.6,
            data_weight: 0.08,
            least_part: 0.05,
        }
    }
}

/// A box in region coordinates.
struct RegionBox {
    middle: [f32; 2],
    half: [f32; 2],
}

impl RegionBox {
    /// Returns how far out a point is: 0 in the middle, 1 on the border, above 1 outside.
    fn outness(&self, at: [f32; 2]) -> f32 {
        let along = |axis: usize| (at[axis] - self.middle[axis]).abs() / self.half[axis].max(0.5);
        along(0).max(along(1))
    }
}

/// Returns the regions of the object in a box.
///
/// `closed` regions are never included. The result has at least the open region nearest to the
/// middle.
pub(super) fn object_in_box(
    graph: &RegionGraph,
    palette: &Palette,
    closed: &[bool],
    within: &PxBox,
    options: &BoxOptions,
) -> Vec<bool> {
    let (min, max) = (within.min_px.as_vec2(), within.max_px.as_vec2());
    let (middle, half) = ((min + max) / 2.0, (max - min) / 2.0);
    let region_box = RegionBox {
        middle: middle.to_array(),
        half: half.to_array(),
    };
    let outness: Vec<f32> = graph
        .regions
        .iter()
        .map(|region| region_box.outness(region.at))
        .collect();
    let role = |at: usize| {
        if outness[at] >= 1.0 || closed[at] {
            Role::Wall
        } else {
            Role::Open
        }
    };
    let roles: Vec<Role> = (0..outness.len()).map(role).collect();
    let enclosed = enclosure(graph, &roles);
    // Initially, regions near the middle belong to the object.
    let mut belongs: Vec<f32> = outness
        .iter()
        .map(|out| (1.2 - out).clamp(0.0, 1.0))
        .collect();
    let mut inside = vec![false; roles.len()];
    for _ in 0..options.rounds {
        let weighted = |share: &dyn Fn(usize) -> f32| -> PaletteHistogram {
            let near = (0..roles.len()).filter(|&at| outness[at] < 1.0 + options.margin);
            palette.model(near.map(|at| (at, graph.regions[at].area * share(at))))
        };
        let object = weighted(&|at| {
            if roles[at] == Role::Open {
                belongs[at]
            } else {
                0.0
            }
        });
        let around = weighted(&|at| {
            if roles[at] == Role::Open {
                1.0 - belongs[at]
            } else {
                1.0
            }
        });
        let gain = |at: usize| {
            let entry = palette.of_region[at];
            let odds = ((object.share(entry) + 1e-3) / (around.share(entry) + 1e-3))
                .ln()
                .clamp(-2.5, 2.5);
            options.data_weight
                * graph.regions[at].area
                * (0.3 * odds + 2.0 * (enclosed[at] - 0.17))
        };
        let gains: Vec<f32> = (0..roles.len()).map(gain).collect();
        inside = cheapest_change(graph, &roles, &gains, 0.0);
        belongs
            .iter_mut()
            .zip(&inside)
            .for_each(|(belongs, &inside)| *belongs = if inside { 0.95 } else { 0.05 });
    }
    drop_small_parts(graph, &mut inside, options.least_part);
    if !inside.contains(&true) {
        let innermost = (0..roles.len())
            .filter(|&at| !closed[at])
            .min_by(|&a, &b| outness[a].total_cmp(&outness[b]));
        innermost.into_iter().for_each(|at| inside[at] = true);
    }
    inside
}

/// Returns how well edges separate each open region from the outside of the box, 0–1.
fn enclosure(graph: &RegionGraph, roles: &[Role]) -> Vec<f32> {
    let outside = |at: &usize| roles[*at] == Role::Wall;
    let sources: Vec<(u32, f32)> = (0..roles.len())
        .filter(outside)
        .map(|at| (at as u32, 0.0))
        .collect();
    let from_outside = distances(graph, &sources, |edge| {
        (edge.strength - 0.2).max(0.0).powi(2)
    })
    .to;
    let farthest = from_outside
        .iter()
        .copied()
        .filter(|to| to.is_finite())
        .fold(1e-3, f32::max);
    from_outside
        .iter()
        .map(|to| (to / farthest).min(1.0))
        .collect()
}

fn drop_small_parts(graph: &RegionGraph, inside: &mut [bool], least_share: f32) {
    let mut parts: Vec<(f32, Vec<u32>)> = Vec::new();
    let mut seen: Vec<bool> = inside.iter().map(|inside| !inside).collect();
    for start in 0..seen.len() {
        if !seen[start] {
            let part = graph.flood(start as u32, &mut seen, |at| inside[at]);
            parts.push((
                part.iter().map(|&at| graph.regions[at as usize].area).sum(),
                part,
            ));
        }
    }
    let largest = parts.iter().map(|(area, _)| *area).fold(0.0, f32::max);
    for (_, part) in parts
        .iter()
        .filter(|(area, _)| *area < least_share * largest)
    {
        part.iter().for_each(|&at| inside[at as usize] = false);
    }
}
