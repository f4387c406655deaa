//! Over-segmentation: joins pixels to a few thousand small regions that respect edges.
//!
//! First, neighbouring pixels of nearly equal colour are joined to specks of a few pixels (Kruskal
//! with a size cap). Then pairs of regions that are each other's best match are merged repeatedly
//! (reciprocal nearest neighbours). The cost of a merge is the growth of the squared error in
//! colour, position and depth (Ward, "Hierarchical grouping to optimize an objective function",
//! JASA 1963).

use rayon::prelude::*;

use super::depth_surfaces::{DepthSurfaces, known};
use super::edge_map::EdgeMap;
use crate::lab::squared_difference;
use ostra_core::union_find::DisjointSets;
use ostra_frames::DepthMap;

/// Parameters of the over-segmentation.
#[derive(Debug, Clone, Copy)]
pub(super) struct RegionOptions {
    /// Mean area of a region, pixels.
    pub area_px: usize,
    /// ΔE² per squared pixel of distance; higher values give rounder regions.
    pub compactness: f32,
    /// ΔE per unit of relative depth difference.
    pub depth_weight: f32,
}

impl Default for RegionOptions {
    fn default() -> Self {
        Self {
            area_px: 130,
            compactness: 0.12,
            depth_weight: 300.0,
        }
    }
}

/// A border between two regions.
#[derive(Debug, Clone, Copy)]
pub(super) struct RegionBorder {
    pub a: u32,
    pub b: u32,
    /// Pixel sides along the border.
    pub length: f32,
    /// Sum of the edge strengths along the border.
    pub strength_sum: f32,
}

/// Statistics of a region for Ward's criterion.
#[derive(Debug, Clone, Copy, Default)]
struct Node {
    /// Area in pixels. Pixels count more than once where finer regions are needed.
    area: f32,
    lab: [f32; 3],
    at: [f32; 2],
    depth: f32,
    depth_area: f32,
}

/// Region index of every pixel, and the borders between regions (`a < b`, ordered).
pub(super) struct Partition {
    pub of_pixel: Vec<u32>,
    pub count: usize,
    pub borders: Vec<RegionBorder>,
}

/// Splits an image into regions.
pub(super) fn partition(
    lab: &[[f32; 3]],
    depth: Option<(&DepthMap, &DepthSurfaces)>,
    edges: &EdgeMap,
    width: usize,
    options: &RegionOptions,
) -> Partition {
    let fineness = depth.map(|(_, surfaces)| surfaces.fineness());
    let mut of_pixel = specks(edges, depth.map(|(_, surfaces)| surfaces), width);
    let count = compact(&mut of_pixel);
    let pixels = PixelInput {
        lab,
        depth: depth.map(|(depth, _)| depth),
        fineness: fineness.as_deref(),
        width,
    };
    let nodes = pixels.nodes(&of_pixel, count);
    let borders = borders_of(&of_pixel, edges, width);
    let fineness = fineness.map_or(lab.len() as f32, |fineness| fineness.iter().sum());
    let target = (fineness as usize / options.area_px).max(2);
    let merged = merge(nodes, borders, target, options);
    of_pixel
        .par_iter_mut()
        .for_each(|speck| *speck = merged.of_node[*speck as usize]);
    let count = merged
        .of_node
        .iter()
        .max()
        .map_or(0, |&last| last as usize + 1);
    Partition {
        of_pixel,
        count,
        borders: merged.borders,
    }
}

/// Joins similar neighbouring pixels, most similar first, to specks of at most [`SPECK_PX`] pixels.
fn specks(edges: &EdgeMap, surfaces: Option<&DepthSurfaces>, width: usize) -> Vec<u32> {
    const SPECK_PX: u8 = 9;
    const LEVELS_PER_DELTA_E: f32 = 6.0;
    let pixels = edges.right.len();
    let level = |step: &super::edge_map::PixelStep| {
        ((step.fine + 8.0 * step.strength * step.strength) * LEVELS_PER_DELTA_E).min(255.0) as u8
    };
    let levels: Vec<[u8; 2]> = edges
        .right
        .par_iter()
        .zip(&edges.down)
        .map(|(right, down)| [level(right), level(down)])
        .collect();
    let mut first = [0usize; 257];
    levels
        .iter()
        .flatten()
        .for_each(|&level| first[usize::from(level) + 1] += 1);
    (1..first.len()).for_each(|at| first[at] += first[at - 1]);
    let mut order = vec![0u32; pixels * 2];
    for (at, &level) in levels.iter().flatten().enumerate() {
        order[first[usize::from(level)]] = at as u32;
        first[usize::from(level)] += 1;
    }
    let mut sets = DisjointSets::new(pixels);
    let mut size = vec![1u8; pixels];
    for place in order {
        let at = place as usize / 2;
        let neighbour = if place % 2 == 0 { at + 1 } else { at + width };
        let inside = if place % 2 == 0 {
            neighbour % width != 0
        } else {
            neighbour < pixels
        };
        if !inside || surfaces.is_some_and(|surfaces| !surfaces.same(at, neighbour)) {
            continue;
        }
        let (a, b) = (sets.root(at as u32), sets.root(neighbour as u32));
        if a != b && size[a as usize] + size[b as usize] <= SPECK_PX {
            sets.unite(a, b);
            let (low, high) = (a.min(b), a.max(b));
            size[low as usize] += size[high as usize];
        }
    }
    sets.into_roots()
}

/// Renumbers to 0, 1, … in order of first appearance; returns how many numbers there are.
fn compact(numbers: &mut [u32]) -> usize {
    let mut new = vec![u32::MAX; numbers.len()];
    let mut count = 0u32;
    for number in numbers {
        let slot = &mut new[*number as usize];
        if *slot == u32::MAX {
            *slot = count;
            count += 1;
        }
        *number = *slot;
    }
    count as usize
}

/// Per-pixel input of the over-segmentation.
struct PixelInput<'a> {
    lab: &'a [[f32; 3]],
    depth: Option<&'a DepthMap>,
    /// Weight of each pixel.
    fineness: Option<&'a [f32]>,
    width: usize,
}

impl PixelInput<'_> {
    /// Returns the statistics of each of `count` groups of pixels.
    fn nodes(&self, of_pixel: &[u32], count: usize) -> Vec<Node> {
        let mut nodes = vec![Node::default(); count];
        for (at, &node) in of_pixel.iter().enumerate() {
            let depth = self
                .depth
                .map(|depth| depth.depths[at])
                .filter(|&depth| known(depth));
            let area = self.fineness.map_or(1.0, |fineness| fineness[at]);
            let pixel = Node {
                area,
                lab: self.lab[at],
                at: [(at % self.width) as f32, (at / self.width) as f32],
                depth: depth.map_or(0.0, f32::ln),
                depth_area: if depth.is_some() { area } else { 0.0 },
            };
            let node = &mut nodes[node as usize];
            *node = joined(node, &pixel);
        }
        nodes
    }
}

fn joined(a: &Node, b: &Node) -> Node {
    let area = a.area + b.area;
    let depth_area = a.depth_area + b.depth_area;
    let mean = |a_value: f32, b_value: f32| (a_value * a.area + b_value * b.area) / area;
    Node {
        area,
        lab: std::array::from_fn(|channel| mean(a.lab[channel], b.lab[channel])),
        at: std::array::from_fn(|axis| mean(a.at[axis], b.at[axis])),
        depth: (a.depth * a.depth_area + b.depth * b.depth_area) / depth_area.max(1.0),
        depth_area,
    }
}

/// Returns the borders between the regions in `of_pixel`, one per pair.
fn borders_of(of_pixel: &[u32], edges: &EdgeMap, width: usize) -> Vec<RegionBorder> {
    let rows: Vec<Vec<RegionBorder>> = of_pixel
        .par_chunks_exact(width)
        .enumerate()
        .map(|(y, row)| {
            let mut found = Vec::new();
            let below = of_pixel.get((y + 1) * width..);
            for (x, &here) in row.iter().enumerate() {
                let mut add = |there: u32, strength: f32| {
                    if here != there {
                        let (a, b) = (here.min(there), here.max(there));
                        found.push(RegionBorder {
                            a,
                            b,
                            length: 1.0,
                            strength_sum: strength,
                        });
                    }
                };
                if let Some(&there) = row.get(x + 1) {
                    add(there, edges.right[y * width + x].strength);
                }
                if let Some(&there) = below.and_then(|below| below.get(x)) {
                    add(there, edges.down[y * width + x].strength);
                }
            }
            group(&mut found);
            found
        })
        .collect();
    let mut borders = rows.concat();
    group(&mut borders);
    borders
}

/// Sorts borders and joins those between the same two regions.
fn group(borders: &mut Vec<RegionBorder>) {
    borders.par_sort_by_key(|border| (border.a, border.b));
    borders.dedup_by(|next, kept| {
        let same = (next.a, next.b) == (kept.a, kept.b);
        if same {
            kept.length += next.length;
            kept.strength_sum += next.strength_sum;
        }
        same
    });
}

/// Result of merging.
struct MergedRegions {
    /// Region of each node.
    of_node: Vec<u32>,
    borders: Vec<RegionBorder>,
}

/// Merges nodes until `target` regions are left; returns the region of every node and the borders.
fn merge(
    mut nodes: Vec<Node>,
    mut borders: Vec<RegionBorder>,
    target: usize,
    options: &RegionOptions,
) -> MergedRegions {
    let mut of_node: Vec<u32> = (0..nodes.len() as u32).collect();
    while nodes.len() > target && !borders.is_empty() {
        let costs: Vec<f32> = borders
            .par_iter()
            .map(|border| cost(&nodes, border, options))
            .collect();
        let mut pairs = mutual_best(&borders, &costs, nodes.len());
        let surplus = nodes.len() - target;
        if pairs.len() > surplus {
            pairs.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]).then(a.cmp(&b)));
            pairs.truncate(surplus);
        }
        let mut new: Vec<u32> = (0..nodes.len() as u32).collect();
        for pair in pairs {
            let RegionBorder { a, b, .. } = borders[pair];
            nodes[a as usize] = joined(&nodes[a as usize], &nodes[b as usize]);
            new[b as usize] = a;
        }
        let count = compact(&mut new);
        let mut kept = vec![Node::default(); count];
        // In reverse order, the lower number of a pair, which holds the joined node, is written
        // last.
        (0..nodes.len())
            .rev()
            .for_each(|node| kept[new[node] as usize] = nodes[node]);
        nodes = kept;
        of_node
            .par_iter_mut()
            .for_each(|node| *node = new[*node as usize]);
        for border in &mut borders {
            let (a, b) = (new[border.a as usize], new[border.b as usize]);
            (border.a, border.b) = (a.min(b), a.max(b));
        }
        borders.retain(|border| border.a != border.b);
        group(&mut borders);
    }
    MergedRegions { of_node, borders }
}

fn cost(nodes: &[Node], border: &RegionBorder, options: &RegionOptions) -> f32 {
    let (a, b) = (&nodes[border.a as usize], &nodes[border.b as usize]);
    let apart = (a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2);
    let both_deep = a.depth_area > 0.0 && b.depth_area > 0.0;
    let depth = if both_deep {
        (options.depth_weight * (a.depth - b.depth)).powi(2)
    } else {
        0.0
    };
    let error = squared_difference(a.lab, b.lab) + options.compactness * apart + depth;
    let strength = border.strength_sum / border.length;
    a.area * b.area / (a.area + b.area) * error * (0.3 + strength)
}

/// Returns the borders whose two regions are each other's cheapest partner.
fn mutual_best(borders: &[RegionBorder], costs: &[f32], nodes: usize) -> Vec<usize> {
    let mut best = vec![u32::MAX; nodes];
    for (at, border) in borders.iter().enumerate() {
        for node in [border.a, border.b] {
            let slot = &mut best[node as usize];
            if *slot == u32::MAX || costs[at] < costs[*slot as usize] {
                *slot = at as u32;
            }
        }
    }
    let is_mutual = |&at: &usize| {
        let border = &borders[at];
        best[border.a as usize] == at as u32 && best[border.b as usize] == at as u32
    };
    (0..borders.len()).filter(is_mutual).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph_cut::edge_map::edge_map;

    #[test]
    fn regions_do_not_cross_the_border_of_a_thin_stripe() {
        let (width, height) = (90usize, 60usize);
        let is_stripe = |at: usize| (40..43).contains(&(at % width));
        let lab: Vec<[f32; 3]> = (0..width * height)
            .map(|at| {
                if is_stripe(at) {
                    [60.0, -30.0, 30.0]
                } else {
                    [60.0, 5.0, 10.0]
                }
            })
            .collect();
        let edges = edge_map(&lab, width, height, None);
        let partition = partition(&lab, None, &edges, width, &RegionOptions::default());
        let mut stripe = vec![None; partition.count];
        for (at, &region) in partition.of_pixel.iter().enumerate() {
            let seen = stripe[region as usize].get_or_insert(is_stripe(at));
            assert_eq!(*seen, is_stripe(at), "region {region} lies on both sides");
        }
        assert_eq!(partition.count, width * height / 130);
    }
}
