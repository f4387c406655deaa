//! Shortest paths over the region graph.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::graph::{Edge, RegionGraph};

/// Distances to the nearest source.
pub(super) struct Distances {
    /// Per region; infinite where no source can be reached.
    pub to: Vec<f32>,
    /// Per region, the source it is nearest to; `u32::MAX` where none can be reached.
    pub origin: Vec<u32>,
}

/// Dijkstra's shortest paths from `sources` (region, distance at the start); `cost` of crossing an edge, not negative.
pub(super) fn distances(graph: &RegionGraph, sources: &[(u32, f32)], cost: impl Fn(&Edge) -> f32) -> Distances {
    let count = graph.region_count();
    let mut found = Distances { to: vec![f32::INFINITY; count], origin: vec![u32::MAX; count] };
    let mut open = BinaryHeap::with_capacity(count);
    for &(region, start) in sources {
        if start < found.to[region as usize] {
            found.to[region as usize] = start;
            found.origin[region as usize] = region;
            open.push(Reached { distance: start, region });
        }
    }
    while let Some(Reached { distance, region }) = open.pop() {
        if distance > found.to[region as usize] {
            continue;
        }
        for &(neighbour, edge) in graph.neighbours(region as usize) {
            let there = distance + cost(&graph.edges[edge as usize]);
            if there < found.to[neighbour as usize] {
                found.to[neighbour as usize] = there;
                found.origin[neighbour as usize] = found.origin[region as usize];
                open.push(Reached { distance: there, region: neighbour });
            }
        }
    }
    found
}

struct Reached {
    distance: f32,
    region: u32,
}

impl Ord for Reached {
    /// The nearest comes first out of a heap; of equally near ones the lowest number.
    fn cmp(&self, other: &Self) -> Ordering {
        other.distance.total_cmp(&self.distance).then(other.region.cmp(&self.region))
    }
}

impl PartialOrd for Reached {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Reached {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Reached {}
