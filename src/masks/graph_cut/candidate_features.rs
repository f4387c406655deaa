//! Features of candidates, used to choose among them.

use super::click_context::ClickContext;
use super::graph::{Role, border_price, distances};
use super::region_stats::Edge;

/// Number of features.
pub(super) const FEATURES: usize = 26;

/// Features of a candidate, in the order given at [`features_of`].
pub(super) type CandidateFeatures = [f32; FEATURES];

/// Index in [`CandidateFeatures`] of the agreement with the other candidates.
///
/// It is set once all candidates are known.
const AGREEMENT: usize = 11;

/// A possible answer to a click.
pub(super) struct Candidate {
    /// Whether each region changes.
    pub change: Vec<bool>,
    pub features: CandidateFeatures,
}

/// Sums along the border of a change.
#[derive(Default)]
struct BorderSums {
    /// Pixel sides along regions that do not change.
    length: f32,
    price: f32,
    weak: f32,
    /// Sum of the appearance log odds of regions just outside.
    ring_odds: f32,
    ring_geodesic: f32,
    /// Pixel sides along regions that are already on the click's side.
    joined: f32,
    /// Pixel sides between regions that both change.
    inner_length: f32,
    inner_price: f32,
    /// Pixel sides on the image border.
    rim: f32,
}

/// Returns the features of a change.
///
/// In order, they are:
///
/// - mean price of the border
/// - ln area
/// - ln(maximum depth / depth at the click), where depth is the distance from the change's border
/// - ln(depth at the click / possible depth)
/// - share of weak edges in the border
/// - share of the border along joined regions
/// - share of the border on the image border
/// - mean appearance log odds inside
/// - mean appearance log odds just outside
/// - perimeter / √area
/// - ln(farthest distance / depth at the click)
/// - agreement with the other candidates, 0 until all are known
/// - ln(area / area of the previous answer)
/// - ln(area / area of the previous answer) times ln of the number of clicks
/// - share of the area nearer to a click of the other side
/// - mean geodesic log odds inside
/// - mean geodesic log odds just outside
/// - mean price of the edges inside
/// - offset of the centroid from the click / √area
/// - filled share of the bounding box
/// - share of the area not connected to the click
/// - `limit` / 10 of a change that includes all similar regions, else 0
/// - `limit` / 10 times ln of the number of clicks on this side
/// - `limit` / 10 times the reach
/// - `limit` / 10 times ln of the depth at the click
/// - area / area of the previous answer, times ln of half the number of clicks, including those of
///   rival labels
pub(super) fn features_of(
    context: &ClickContext<'_>,
    change: &[bool],
    odds: &[f32],
    geodesic: &[f32],
    limit: f32,
) -> CandidateFeatures {
    let graph = context.graph;
    let sums = border_sums(context, change, odds, geodesic);
    let changed = || (0..change.len()).filter(|&at| change[at]);
    let area = changed()
        .map(|at| graph.regions[at].area)
        .sum::<f32>()
        .max(1.0);
    let depth = depths(context, change);
    let at_click = depth[context.seed as usize].max(2.0);
    let deepest = changed()
        .map(|at| depth[at])
        .filter(|depth| depth.is_finite())
        .fold(at_click, f32::max);
    let farthest = changed().map(|at| context.apart[at]).fold(1.0f32, f32::max);
    let mean = |axis: usize| {
        changed()
            .map(|at| graph.regions[at].at[axis] * graph.regions[at].area)
            .sum::<f32>()
            / area
    };
    let click = context.clicks[context.clicks.len() - 1].0.at_px;
    let offset = (mean(0) - click.x as f32).hypot(mean(1) - click.y as f32);
    let mut seen = vec![false; change.len()];
    let seed_part = graph.flood(context.seed, &mut seen, |at| change[at]);
    let seed_part: f32 = seed_part
        .iter()
        .map(|&at| graph.regions[at as usize].area)
        .sum();
    let outer = (sums.length + sums.rim).max(1.0);
    let whole = (outer + sums.joined).max(1.0);
    let inner = |values: &[f32]| {
        changed()
            .map(|at| values[at] * graph.regions[at].area)
            .sum::<f32>()
            / area
    };
    let alike = limit / 10.0;
    let same_side = context
        .clicks
        .iter()
        .filter(|(click, _)| click.include == context.include)
        .count() as f32;
    let against_answer = (area / context.area.max(100.0)).ln();
    [
        (sums.price + 0.25 * sums.rim) / outer,
        area.ln(),
        (deepest / at_click).ln(),
        (at_click / context.reach).ln(),
        sums.weak / outer,
        sums.joined / whole,
        sums.rim / whole,
        inner(odds),
        sums.ring_odds / sums.length.max(1.0),
        whole / area.sqrt(),
        (farthest / at_click).ln(),
        0.0,
        against_answer,
        against_answer * (context.clicks.len() as f32).ln(),
        changed()
            .filter(|&at| is_nearer_opposite(context, at))
            .map(|at| graph.regions[at].area)
            .sum::<f32>()
            / area,
        inner(geodesic),
        sums.ring_geodesic / sums.length.max(1.0),
        sums.inner_price / sums.inner_length.max(1.0),
        offset / area.sqrt(),
        area / box_area(context, change),
        1.0 - seed_part / area,
        alike,
        alike * same_side.ln(),
        alike * (context.reach / 60.0).min(2.0),
        alike * at_click.ln(),
        against_answer.exp() * (0.5 * context.clicks.len() as f32).max(1.0).ln(),
    ]
}

/// Returns the area of the axis-parallel box around the changed regions, px².
///
/// Regions are approximated as squares around their centroids.
fn box_area(context: &ClickContext<'_>, change: &[bool]) -> f32 {
    let (mut min, mut max) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
    for (region, _) in context
        .graph
        .regions
        .iter()
        .zip(change)
        .filter(|(_, change)| **change)
    {
        let half = 0.5 * region.area.sqrt();
        for axis in 0..2 {
            min[axis] = min[axis].min(region.at[axis] - half);
            max[axis] = max[axis].max(region.at[axis] + half);
        }
    }
    ((max[0] - min[0]) * (max[1] - min[1])).max(1.0)
}

fn border_sums(
    context: &ClickContext<'_>,
    change: &[bool],
    odds: &[f32],
    geodesic: &[f32],
) -> BorderSums {
    const WEAK: f32 = 0.35;
    let graph = context.graph;
    let mut sums = BorderSums::default();
    for edge in &graph.edges {
        let (a, b) = (edge.a as usize, edge.b as usize);
        if change[a] == change[b] {
            if change[a] {
                sums.inner_length += edge.length;
                sums.inner_price += edge.length * border_price(edge);
            }
            continue;
        }
        let outside = if change[a] { b } else { a };
        if context.roles[outside] == Role::Joined {
            sums.joined += edge.length;
        } else {
            sums.length += edge.length;
            sums.price += edge.length * border_price(edge);
            sums.weak += if edge.strength < WEAK {
                edge.length
            } else {
                0.0
            };
            sums.ring_odds += edge.length * odds[outside];
            sums.ring_geodesic += edge.length * geodesic[outside];
        }
    }
    sums.rim = graph
        .regions
        .iter()
        .zip(change)
        .map(|(region, &change)| if change { region.rim } else { 0.0 })
        .sum();
    sums
}

/// Returns the approximate depth of each changed region inside the change, pixels.
fn depths(context: &ClickContext<'_>, change: &[bool]) -> Vec<f32> {
    let graph = context.graph;
    let half_width = |at: u32| (at, 0.5 * graph.regions[at as usize].area.sqrt());
    let at_border = graph
        .edges
        .iter()
        .filter(|edge| change[edge.a as usize] != change[edge.b as usize]);
    let mut border: Vec<(u32, f32)> = at_border
        .map(|edge| {
            half_width(if change[edge.a as usize] {
                edge.a
            } else {
                edge.b
            })
        })
        .collect();
    let at_rim = (0..change.len()).filter(|&at| change[at] && graph.regions[at].rim > 0.0);
    border.extend(at_rim.map(|at| half_width(at as u32)));
    let cost = |edge: &Edge| {
        if change[edge.a as usize] && change[edge.b as usize] {
            graph.apart(edge)
        } else {
            f32::INFINITY
        }
    };
    distances(graph, &border, cost).to
}

fn is_nearer_opposite(context: &ClickContext<'_>, region: usize) -> bool {
    let [x, y] = context.graph.regions[region].at;
    let nearest = |include: bool| {
        let of_side = context
            .clicks
            .iter()
            .filter(move |(click, _)| click.include == include);
        of_side
            .map(|(click, _)| (click.at_px.x as f32 - x).hypot(click.at_px.y as f32 - y))
            .fold(f32::INFINITY, f32::min)
    };
    nearest(!context.include) < nearest(context.include)
}

/// Sets each candidate's mean IoU with the others and returns the IoU of every pair.
pub(super) fn agreement(context: &ClickContext<'_>, candidates: &mut [Candidate]) -> Vec<Vec<f32>> {
    let areas: Vec<f32> = context
        .graph
        .regions
        .iter()
        .map(|region| region.area)
        .collect();
    let mut shared = vec![vec![1.0; candidates.len()]; candidates.len()];
    for a in 0..candidates.len() {
        for b in a + 1..candidates.len() {
            shared[a][b] = iou(&candidates[a].change, &candidates[b].change, &areas);
            shared[b][a] = shared[a][b];
        }
    }
    let others = (candidates.len().max(2) - 1) as f32;
    for (candidate, shared) in candidates.iter_mut().zip(&shared) {
        candidate.features[AGREEMENT] = (shared.iter().sum::<f32>() - 1.0) / others;
    }
    shared
}

fn iou(a: &[bool], b: &[bool], areas: &[f32]) -> f32 {
    let (mut both, mut any) = (0.0, 0.0);
    for ((&a, &b), &area) in a.iter().zip(b).zip(areas) {
        both += if a && b { area } else { 0.0 };
        any += if a || b { area } else { 0.0 };
    }
    both / f32::max(any, 1.0)
}
