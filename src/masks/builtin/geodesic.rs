//! Shortest paths over the region graph.

use std::collections::BinaryHeap;

use super::graph::{Edge, RegionGraph};
use crate::frontier::Reached;

/// Distances to the nearest source.
pub(super) struct Distances {
    /// Per region; infinite where no source can be reached.
    pub to: Vec<f32>,
    /// Per region, the source it is nearest to; `u32::MAX` where none can be reached.
    pub origin: Vec<u32>,
}

/// Dijkstra's shortest paths from `sources` (region, distance at the start); `cost` of crossing an edge, not negative.
pub(super) fn distances(
    graph: &RegionGraph,
    sources: &[(u32, f32)],
    cost: impl Fn(&Edge) -> f32,
) -> Distances {
    let count = graph.region_count();
    let mut found = Distances {
        to: vec![f32::INFINITY; count],
        origin: vec![u32::MAX; count],
    };
    let mut open = BinaryHeap::with_capacity(count);
    for &(region, start) in sources {
        if start < found.to[region as usize] {
            found.to[region as usize] = start;
            found.origin[region as usize] = region;
            open.push(Reached {
                cost: start,
                at: region,
            });
        }
    }
    while let Some(Reached {
        cost: distance,
        at: region,
    }) = open.pop()
    {
        if distance > found.to[region as usize] {
            continue;
        }
        for &(neighbour, edge) in graph.neighbours(region as usize) {
            let there = distance + cost(&graph.edges[edge as usize]);
            if there < found.to[neighbour as usize] {
                found.to[neighbour as usize] = there;
                found.origin[neighbour as usize] = found.origin[region as usize];
                open.push(Reached {
                    cost: there,
                    at: neighbour,
                });
            }
        }
    }
    found
}
