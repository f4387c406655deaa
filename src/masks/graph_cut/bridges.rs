//! Edges between regions that touch in space but not in the image.
//!
//! Examples are the grains of an ear in front of a wall, or a leaf on both sides of a stem in front
//! of it. Such regions are joined where depth is available.

use rayon::prelude::*;

use super::region_stats::{Edge, RegionStats};
use crate::lab::squared_difference;

/// Options that decide when two regions touch in space.
#[derive(Debug, Clone, Copy)]
pub(super) struct BridgeOptions {
    /// Maximum gap between two regions, pixels.
    pub gap_px: f32,
    /// Maximum difference of ln depth.
    pub depth_step: f32,
    /// Minimum difference of ln depth to a neighbour for a region to be bridged.
    pub jump: f32,
    /// Maximum number of bridges that start from a region.
    pub most: usize,
}

impl Default for BridgeOptions {
    fn default() -> Self {
        Self {
            gap_px: 10.0,
            depth_step: 0.015,
            jump: 0.04,
            most: 3,
        }
    }
}

/// Returns edges between regions at the same depth across a narrow gap of another depth.
///
/// The edges are sorted by their regions.
pub(super) fn bridges(
    regions: &[RegionStats],
    edges: &[Edge],
    width: usize,
    options: &BridgeOptions,
) -> Vec<Edge> {
    let step = |a: usize, b: usize| (regions[a].ln_depth - regions[b].ln_depth).abs();
    let adjacent_to_jump = adjacent_to_jump(regions, edges, options.jump);
    let touching: std::collections::BTreeSet<(u32, u32)> =
        edges.iter().map(|edge| (edge.a, edge.b)).collect();
    let cells = RegionCells::new(regions, &adjacent_to_jump, width, 4.0 * options.gap_px);
    let mut found = std::collections::BTreeMap::new();
    for a in (0..regions.len()).filter(|&at| adjacent_to_jump[at]) {
        let mut near: Vec<(f32, u32)> = cells
            .around(regions[a].at)
            .filter(|&b| b as usize != a && step(a, b as usize) < options.depth_step)
            .filter(|&b| !touching.contains(&((a as u32).min(b), (a as u32).max(b))))
            .map(|b| (gap(&regions[a], &regions[b as usize]), b))
            .filter(|&(gap, _)| gap < options.gap_px)
            .collect();
        near.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        for &(gap, b) in near.iter().take(options.most) {
            found.insert(((a as u32).min(b), (a as u32).max(b)), gap);
        }
    }
    found
        .into_iter()
        .map(|((a, b), _)| bridge(regions, a, b))
        .collect()
}

/// Returns, for each region next to a depth jump, other regions that may belong to its object.
///
/// They are close in the image and in depth, as a plant's leaves and grains are.
pub(super) fn hops(
    regions: &[RegionStats],
    edges: &[Edge],
    width: usize,
    options: &HopOptions,
) -> Vec<Vec<u32>> {
    let adjacent_to_jump = adjacent_to_jump(regions, edges, options.jump);
    let cells = RegionCells::new(regions, &adjacent_to_jump, width, options.gap_px);
    let to = |a: usize| -> Vec<u32> {
        if !adjacent_to_jump[a] {
            return Vec::new();
        }
        let near = |b: &u32| {
            let (here, there) = (&regions[a], &regions[*b as usize]);
            (here.ln_depth - there.ln_depth).abs() < options.depth_step
                && gap(here, there) < options.gap_px
        };
        cells
            .around(regions[a].at)
            .filter(|&b| b as usize != a)
            .filter(near)
            .collect()
    };
    (0..regions.len()).into_par_iter().map(to).collect()
}

/// Options that decide when two regions may be parts of one object.
#[derive(Debug, Clone, Copy)]
pub(super) struct HopOptions {
    /// Maximum gap between two regions, pixels.
    pub gap_px: f32,
    /// Maximum difference of ln depth.
    pub depth_step: f32,
    /// Minimum difference of ln depth to a neighbour for a region to take part.
    pub jump: f32,
}

impl Default for HopOptions {
    fn default() -> Self {
        Self {
            gap_px: 24.0,
            depth_step: 0.025,
            jump: 0.04,
        }
    }
}

/// Returns which regions have a neighbour that is much nearer or farther.
fn adjacent_to_jump(regions: &[RegionStats], edges: &[Edge], jump: f32) -> Vec<bool> {
    let mut adjacent = vec![false; regions.len()];
    for edge in edges {
        let (a, b) = (edge.a as usize, edge.b as usize);
        if (regions[a].ln_depth - regions[b].ln_depth).abs() > jump {
            (adjacent[a], adjacent[b]) = (true, true);
        }
    }
    adjacent
}

fn bridge(regions: &[RegionStats], a: u32, b: u32) -> Edge {
    let (first, second) = (&regions[a as usize], &regions[b as usize]);
    let apart = squared_difference(first.lab, second.lab).sqrt();
    let length = 0.5 * first.area.min(second.area).sqrt();
    Edge {
        a,
        b,
        length,
        strength: apart / (apart + 12.0),
    }
}

/// Returns the distance between two regions approximated as discs, pixels.
fn gap(a: &RegionStats, b: &RegionStats) -> f32 {
    let radius = |region: &RegionStats| (region.area / std::f32::consts::PI).sqrt();
    (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) - radius(a) - radius(b)
}

/// Regions sorted into square cells.
struct RegionCells {
    side: f32,
    columns: usize,
    rows: usize,
    members: Vec<Vec<u32>>,
}

impl RegionCells {
    fn new(regions: &[RegionStats], chosen: &[bool], width: usize, side: f32) -> Self {
        let bottom = regions
            .iter()
            .map(|region| region.at[1])
            .fold(0.0, f32::max);
        let columns = (width as f32 / side) as usize + 1;
        let rows = (bottom / side) as usize + 1;
        let mut cells = Self {
            side,
            columns,
            rows,
            members: vec![Vec::new(); columns * rows],
        };
        for (at, region) in regions.iter().enumerate().filter(|(at, _)| chosen[*at]) {
            let (x, y) = cells.cell(region.at);
            cells.members[y * columns + x].push(at as u32);
        }
        cells
    }

    fn cell(&self, at: [f32; 2]) -> (usize, usize) {
        (
            ((at[0] / self.side) as usize).min(self.columns - 1),
            ((at[1] / self.side) as usize).min(self.rows - 1),
        )
    }

    fn around(&self, at: [f32; 2]) -> impl Iterator<Item = u32> {
        let (x, y) = self.cell(at);
        let columns = x.saturating_sub(1)..(x + 2).min(self.columns);
        let rows = y.saturating_sub(1)..(y + 2).min(self.rows);
        rows.flat_map(move |y| columns.clone().map(move |x| y * self.columns + x))
            .flat_map(|cell| self.members[cell].iter().copied())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(x: f32, ln_depth: f32) -> RegionStats {
        RegionStats {
            area: 50.0,
            at: [x, 10.0],
            ln_depth,
            ..RegionStats::default()
        }
    }

    #[test]
    fn grains_in_front_of_a_wall_are_bridged_but_not_the_wall() {
        let regions = [
            region(10.0, 0.0),
            region(20.0, 0.4),
            region(27.0, 0.005),
            region(80.0, 0.0),
        ];
        let edge = |a, b| Edge {
            a,
            b,
            length: 5.0,
            strength: 1.0,
        };
        let found = bridges(
            &regions,
            &[edge(0, 1), edge(1, 2), edge(1, 3)],
            100,
            &BridgeOptions::default(),
        );
        let pairs: Vec<(u32, u32)> = found.iter().map(|edge| (edge.a, edge.b)).collect();
        assert_eq!(pairs, [(0, 2)]);
    }
}
