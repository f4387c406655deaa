//! Region graph, with shortest paths and minimum cuts over it.
//!
//! Nodes are regions with their statistics. Edges hold how strongly neighbours are separated. The
//! cut minimises the energy of changing the sides of regions.

use std::collections::BinaryHeap;

use super::bridges::{BridgeOptions, HopOptions, bridges, hops};
use super::depth_surfaces::DepthSurfaces;
use super::over_segmentation::Partition;
use super::region_stats::{Edge, RegionStats, TONE_RADIUS_PX, set_measured, set_tones, stats};
use crate::frontier::Reached;
use crate::lab::squared_difference;
use crate::maxflow::{FlowGraph, FlowLink};
use ostra_frames::DepthMap;

/// Regions and their neighbours.
pub(super) struct RegionGraph {
    pub width: usize,
    pub height: usize,
    pub regions: Vec<RegionStats>,
    pub edges: Vec<Edge>,
    /// Regions that may belong to the same object without touching, by region; only with depth.
    pub hops: Vec<Vec<u32>>,
    first: Vec<u32>,
    /// (neighbour, edge) pairs of all regions; those of a region start at `first[region]`.
    neighbours: Vec<(u32, u32)>,
}

impl RegionGraph {
    /// Builds the graph of a partition.
    ///
    /// `measured` is the original depth, without values that were filled in.
    pub fn new(
        partition: &Partition,
        lab: &[[f32; 3]],
        depth: Option<(&DepthMap, &DepthSurfaces)>,
        measured: Option<&DepthMap>,
        width: usize,
    ) -> Self {
        let height = lab.len() / width;
        let mut regions = stats(partition, lab, depth.map(|(depth, _)| depth), width, height);
        if let Some(measured) = measured {
            set_measured(&mut regions, partition, measured);
        }
        if let Some((_, surfaces)) = depth {
            set_tones(&mut regions, partition, &surfaces.mean(lab, TONE_RADIUS_PX));
        }
        let mut edges: Vec<Edge> = partition
            .borders
            .iter()
            .map(|border| Edge {
                a: border.a,
                b: border.b,
                length: border.length,
                strength: border.strength_sum / border.length,
            })
            .collect();
        let (first, neighbours) = adjacency(&edges, regions.len());
        strengthen(&mut edges, &regions);
        let mut graph = Self {
            width,
            height,
            regions: Vec::new(),
            edges,
            hops: Vec::new(),
            first,
            neighbours,
        };
        if depth.is_some() {
            let seen: Vec<bool> = regions
                .iter()
                .map(|region| !region.ln_depth.is_nan())
                .collect();
            graph.fill_depth(&mut regions);
            graph.add_depth_steps(&regions, &seen);
            graph.hops = hops(&regions, &graph.edges, width, &HopOptions::default());
            let bridges = bridges(&regions, &graph.edges, width, &BridgeOptions::default());
            graph.edges.extend(bridges);
            (graph.first, graph.neighbours) = adjacency(&graph.edges, regions.len());
        }
        graph.regions = regions;
        graph
    }

    /// Returns the number of regions.
    pub fn region_count(&self) -> usize {
        self.first.len() - 1
    }

    /// Returns the (neighbour, edge) pairs of a region.
    pub fn neighbours(&self, region: usize) -> &[(u32, u32)] {
        &self.neighbours[self.first[region] as usize..self.first[region + 1] as usize]
    }

    /// Returns the distance between the centroids of an edge's regions, pixels.
    pub fn apart(&self, edge: &Edge) -> f32 {
        let (a, b) = (
            &self.regions[edge.a as usize],
            &self.regions[edge.b as usize],
        );
        (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1])
    }

    /// Returns the regions reachable from `start` through `inside` and marks them in `seen`.
    pub fn flood(&self, start: u32, seen: &mut [bool], inside: impl Fn(usize) -> bool) -> Vec<u32> {
        let mut reached = vec![start];
        seen[start as usize] = true;
        let mut next = 0;
        while let Some(&at) = reached.get(next) {
            next += 1;
            for &(to, _) in self.neighbours(at as usize) {
                if !seen[to as usize] && inside(to as usize) {
                    seen[to as usize] = true;
                    reached.push(to);
                }
            }
        }
        reached
    }

    /// Returns the memory used in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.regions)
            + size_of_val(&*self.edges)
            + size_of_val(&*self.first)
            + size_of_val(&*self.neighbours)
            + self
                .hops
                .iter()
                .map(|hops| size_of_val(&**hops))
                .sum::<usize>()
    }

    /// Fills missing depths of regions from the nearest region with depth.
    ///
    /// Distances grow with the strength of the edges crossed.
    fn fill_depth(&self, regions: &mut [RegionStats]) {
        let sources = regions
            .iter()
            .enumerate()
            .filter(|(_, region)| !region.ln_depth.is_nan());
        let sources: Vec<(u32, f32)> = sources.map(|(at, _)| (at as u32, 0.0)).collect();
        let nearest = distances(self, &sources, |edge| 1.0 + 40.0 * edge.strength);
        let known: Vec<f32> = regions.iter().map(|region| region.ln_depth).collect();
        for (region, origin) in regions.iter_mut().zip(&nearest.origin) {
            if let Some(&depth) = known.get(*origin as usize) {
                region.ln_depth = depth;
            }
        }
    }

    /// Strengthens edges where mean depths differ, less where a depth was filled in.
    fn add_depth_steps(&mut self, regions: &[RegionStats], seen: &[bool]) {
        for edge in &mut self.edges {
            let (a, b) = (&regions[edge.a as usize], &regions[edge.b as usize]);
            let apart = ((a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2)).sqrt();
            // A slope of 0.1 % of the depth per pixel is a slanted surface.
            let step = (a.ln_depth - b.ln_depth).abs() - 0.001 * apart - 0.01;
            let confidence = if seen[edge.a as usize] && seen[edge.b as usize] {
                0.9
            } else {
                0.5
            };
            let extra = (step / 0.03).clamp(0.0, 1.0) * confidence;
            if extra.is_finite() {
                edge.strength = 1.0 - (1.0 - edge.strength) * (1.0 - extra);
            }
        }
    }
}

fn adjacency(edges: &[Edge], count: usize) -> (Vec<u32>, Vec<(u32, u32)>) {
    let mut first = vec![0u32; count + 1];
    for edge in edges {
        first[edge.a as usize + 1] += 1;
        first[edge.b as usize + 1] += 1;
    }
    (1..first.len()).for_each(|at| first[at] += first[at - 1]);
    let mut next = first.clone();
    let mut neighbours = vec![(0, 0); edges.len() * 2];
    for (at, edge) in edges.iter().enumerate() {
        for (from, to) in [(edge.a, edge.b), (edge.b, edge.a)] {
            neighbours[next[from as usize] as usize] = (to, at as u32);
            next[from as usize] += 1;
        }
    }
    (first, neighbours)
}

/// Adds the difference of the mean colours of both sides, relative to that of typical neighbours.
fn strengthen(edges: &mut [Edge], regions: &[RegionStats]) {
    let difference = |edge: &Edge| {
        squared_difference(regions[edge.a as usize].lab, regions[edge.b as usize].lab).sqrt()
    };
    let typical = edges
        .iter()
        .map(|edge| difference(edge) * edge.length)
        .sum::<f32>()
        / edges.iter().map(|edge| edge.length).sum::<f32>().max(1.0);
    for edge in edges {
        let apart = difference(edge);
        edge.strength = 0.65 * edge.strength + 0.35 * apart / (apart + 2.0 + typical);
    }
}

/// Distances to the nearest source.
pub(super) struct Distances {
    /// Distance of each region; infinite where no source can be reached.
    pub to: Vec<f32>,
    /// Nearest source of each region; `u32::MAX` where none can be reached.
    pub origin: Vec<u32>,
}

/// Computes shortest paths from `sources` with Dijkstra's algorithm.
///
/// `sources` are pairs of region and initial distance. `cost` is the cost of crossing an edge, not
/// negative.
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

/// Capacity units per pixel side of a border without an edge.
const UNIT: f32 = 1000.0;
const CERTAIN: i32 = 100_000_000;

/// Role of a region in a cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    /// The cut decides.
    Open,
    /// Certainly changes.
    Seed,
    /// Certainly stays; a border with it has a price.
    Wall,
    /// Is already on the wanted side.
    ///
    /// A border with it has no price, but leaving a gap to it does.
    Joined,
}

/// Returns the price of an object ending at an edge, per pixel side.
pub(super) fn border_price(edge: &Edge) -> f32 {
    (-5.0 * edge.strength).exp() + 0.01
}

/// Returns which regions change at minimum energy.
///
/// `gain` is what the change of each region is worth, in pixel sides of a border without an edge.
/// `pull` scales the price of a gap to joined regions.
pub(super) fn cheapest_change(
    graph: &RegionGraph,
    roles: &[Role],
    gain: &[f32],
    pull: f32,
) -> Vec<bool> {
    let mut node_of = vec![u32::MAX; roles.len()];
    let mut terminal: Vec<i32> = Vec::new();
    for (region, role) in roles.iter().enumerate() {
        if matches!(role, Role::Open | Role::Seed) {
            node_of[region] = terminal.len() as u32;
            let worth = (gain[region] * UNIT).clamp(-1e8, 1e8) as i32;
            terminal.push(if *role == Role::Seed { CERTAIN } else { worth });
        }
    }
    let mut links = Vec::with_capacity(graph.edges.len());
    for edge in &graph.edges {
        let price = (edge.length * border_price(edge) * UNIT) as i32;
        let (a, b) = (edge.a as usize, edge.b as usize);
        match (node_of[a], node_of[b]) {
            (u32::MAX, u32::MAX) => {}
            (u32::MAX, node) => rest(&mut terminal[node as usize], roles[a], price, pull),
            (node, u32::MAX) => rest(&mut terminal[node as usize], roles[b], price, pull),
            (from, to) => links.push(FlowLink {
                from,
                to,
                forward: price,
                backward: price,
            }),
        }
    }
    let side = FlowGraph::new(terminal, &links).source_side();
    node_of
        .iter()
        .map(|&node| side.get(node as usize).copied().unwrap_or(false))
        .collect()
}

/// Adds the price of a border with a region that the cut does not decide.
fn rest(terminal: &mut i32, role: Role, price: i32, pull: f32) {
    match role {
        Role::Wall => *terminal -= price,
        Role::Joined => *terminal += (price as f32 * pull) as i32,
        Role::Open | Role::Seed => {}
    }
}
