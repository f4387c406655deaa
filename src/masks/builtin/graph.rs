//! The region graph: what is known of each region and how strongly neighbours are kept apart.

use rayon::prelude::*;

use super::bridges::{BridgeOptions, HopOptions, bridges, hops};
use super::depth_edges::known;
use super::filter::box_mean;
use super::regions::Partition;
use super::surface::Surfaces;
use crate::lab::squared_difference;
use ostra_frames::DepthMap;

/// Means over one region.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RegionStats {
    /// Pixels.
    pub area: f32,
    /// Mean Lab.
    pub lab: [f32; 3],
    /// Mean Lab of the surface around its pixels; only with depth.
    pub tone: [f32; 3],
    /// Spread of lightness around its pixels, L units: low on smooth surfaces, high in texture.
    pub texture: f32,
    /// Mean position, pixels.
    pub at: [f32; 2],
    /// Mean of ln depth; NaN where nothing is known.
    pub ln_depth: f32,
    /// Whether the depth of nearly all of its pixels was measured, not filled in.
    pub measured: bool,
    /// Sides on the picture's border.
    pub rim: f32,
}

/// A border between two regions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    pub a: u32,
    pub b: u32,
    /// Pixel sides.
    pub length: f32,
    /// Chance that an object ends here, 0–1.
    pub strength: f32,
}

/// Regions, their neighbours and the pixels they hold.
pub(super) struct RegionGraph {
    pub width: usize,
    pub height: usize,
    pub regions: Vec<RegionStats>,
    pub edges: Vec<Edge>,
    /// With depth, per region the others that may be parts of the same thing without touching it.
    pub hops: Vec<Vec<u32>>,
    first: Vec<u32>,
    /// (neighbour, edge) of each region, from `first[region]`.
    neighbours: Vec<(u32, u32)>,
}

impl RegionGraph {
    /// `measured` is the depth as it came, without what was filled in since.
    pub fn new(
        partition: &Partition,
        lab: &[[f32; 3]],
        depth: Option<(&DepthMap, &Surfaces)>,
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

    /// Number of regions.
    pub fn region_count(&self) -> usize {
        self.first.len() - 1
    }

    /// (neighbour, edge) pairs of a region.
    pub fn neighbours(&self, region: usize) -> &[(u32, u32)] {
        &self.neighbours[self.first[region] as usize..self.first[region + 1] as usize]
    }

    /// Distance between the middles of an edge's regions, pixels.
    pub fn apart(&self, edge: &Edge) -> f32 {
        let (a, b) = (
            &self.regions[edge.a as usize],
            &self.regions[edge.b as usize],
        );
        (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1])
    }

    /// All regions reachable from `start` through `inside`, marked in `seen`.
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

    /// Bytes held.
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

    /// Regions without depth take that of the neighbour they are least kept apart from, growing from the known ones.
    fn fill_depth(&self, regions: &mut [RegionStats]) {
        let sources = regions
            .iter()
            .enumerate()
            .filter(|(_, region)| !region.ln_depth.is_nan());
        let sources: Vec<(u32, f32)> = sources.map(|(at, _)| (at as u32, 0.0)).collect();
        let nearest = super::geodesic::distances(self, &sources, |edge| 1.0 + 40.0 * edge.strength);
        let known: Vec<f32> = regions.iter().map(|region| region.ln_depth).collect();
        for (region, origin) in regions.iter_mut().zip(&nearest.origin) {
            if let Some(&depth) = known.get(*origin as usize) {
                region.ln_depth = depth;
            }
        }
    }

    /// A step between mean depths is an edge too, a weaker one where a depth was filled.
    fn add_depth_steps(&mut self, regions: &[RegionStats], seen: &[bool]) {
        for edge in &mut self.edges {
            let (a, b) = (&regions[edge.a as usize], &regions[edge.b as usize]);
            let apart = ((a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2)).sqrt();
            // A slope of 0.1 % of the depth a pixel is a surface seen at a slant.
            let step = (a.ln_depth - b.ln_depth).abs() - 0.001 * apart - 0.01;
            let sure = if seen[edge.a as usize] && seen[edge.b as usize] {
                0.9
            } else {
                0.5
            };
            let extra = (step / 0.03).clamp(0.0, 1.0) * sure;
            if extra.is_finite() {
                edge.strength = 1.0 - (1.0 - edge.strength) * (1.0 - extra);
            }
        }
    }
}

fn stats(
    partition: &Partition,
    lab: &[[f32; 3]],
    depth: Option<&DepthMap>,
    width: usize,
    height: usize,
) -> Vec<RegionStats> {
    let moments: Vec<[f32; 2]> = lab
        .par_iter()
        .map(|lab| [lab[0], lab[0] * lab[0]])
        .collect();
    let moments = box_mean(&moments, width, height, 3);
    let mut regions = vec![RegionStats::default(); partition.count];
    let mut depth_area = vec![0.0f32; partition.count];
    for (at, &of) in partition.of_pixel.iter().enumerate() {
        let (x, y) = (at % width, at / width);
        let region = &mut regions[of as usize];
        region.area += 1.0;
        (0..3).for_each(|channel| region.lab[channel] += lab[at][channel]);
        region.texture += (moments[at][1] - moments[at][0] * moments[at][0])
            .max(0.0)
            .sqrt();
        region.at[0] += x as f32;
        region.at[1] += y as f32;
        region.rim += f32::from(
            u8::from(x == 0)
                + u8::from(x + 1 == width)
                + u8::from(y == 0)
                + u8::from(y + 1 == height),
        );
        if let Some(depth) = depth
            .map(|depth| depth.depths[at])
            .filter(|&depth| known(depth))
        {
            region.ln_depth += depth.ln();
            depth_area[of as usize] += 1.0;
        }
    }
    for (region, depth_area) in regions.iter_mut().zip(depth_area) {
        region.lab = region.lab.map(|sum| sum / region.area);
        region.texture /= region.area;
        region.at = region.at.map(|sum| sum / region.area + 0.5);
        region.ln_depth = if depth_area > 0.25 * region.area {
            region.ln_depth / depth_area
        } else {
            f32::NAN
        };
    }
    regions
}

/// Reach of the surface mean that gives a region its tone, pixels.
const TONE_RADIUS_PX: usize = 3;

fn set_tones(regions: &mut [RegionStats], partition: &Partition, smooth: &[[f32; 3]]) {
    for (&of, smooth) in partition.of_pixel.iter().zip(smooth) {
        let region = &mut regions[of as usize];
        (0..3).for_each(|channel| region.tone[channel] += smooth[channel] / region.area);
    }
}

fn set_measured(regions: &mut [RegionStats], partition: &Partition, measured: &DepthMap) {
    let mut known_px = vec![0.0; regions.len()];
    for (&of, &depth) in partition.of_pixel.iter().zip(&measured.depths) {
        known_px[of as usize] += f32::from(u8::from(known(depth)));
    }
    for (region, known_px) in regions.iter_mut().zip(known_px) {
        region.measured = known_px > 0.9 * region.area;
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

/// Adds how far the mean colours of both sides are apart, against the typical difference of neighbours.
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
