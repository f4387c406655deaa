//! Context of a click on the wrong side of an answer: distances and regions that may change.

use super::appearance::Palette;
use super::graph::{RegionGraph, Role, distances};
use super::region_stats::{Edge, RegionStats};
use crate::Click;

/// Context of a click.
pub(super) struct ClickContext<'a> {
    pub graph: &'a RegionGraph,
    pub palette: &'a Palette,
    /// All clicks with their regions; the last one is to be answered.
    pub clicks: &'a [(Click, u32)],
    /// Role of each region in the cut; only the clicked one is a seed.
    pub roles: Vec<Role>,
    /// The clicked region.
    pub seed: u32,
    /// Whether the click includes.
    pub include: bool,
    /// Distance of each region to the click, pixels.
    pub apart: Vec<f32>,
    /// Geodesic distance of each region to the clicks of the other side.
    ///
    /// For an include click, the image border counts as well.
    pub far: Vec<f32>,
    /// Distance from the click to regions already on its side, pixels.
    ///
    /// It limits how deep the part to change can be.
    pub reach: f32,
    /// Deviation of each region's depth from the range plausible at the click, 0–1.
    ///
    /// It is 0 without depth.
    pub off_depth: Vec<f32>,
    /// Whether each region is connected in space with the clicked one; `None` without depth.
    pub same_thing: Option<Vec<bool>>,
    /// Number of pixels in the previous answer.
    pub area: f32,
}

/// Extra geodesic distance of the image border compared with clicks of the other side, pixels.
const RIM_LEAD: f32 = 20.0;

impl<'a> ClickContext<'a> {
    /// Creates the context of the last of `clicks`.
    ///
    /// Regions that are `closed` may not change. Returns `None` without clicks.
    pub fn new(
        graph: &'a RegionGraph,
        palette: &'a Palette,
        clicks: &'a [(Click, u32)],
        inside: &[bool],
        closed: &[bool],
    ) -> Option<Self> {
        let &(click, seed) = clicks.last()?;
        let include = click.include;
        let role = |at: usize| match () {
            () if closed[at] => Role::Wall,
            () if inside[at] == include => Role::Joined,
            () => Role::Open,
        };
        let mut roles: Vec<Role> = (0..graph.region_count()).map(role).collect();
        let opposite = || {
            clicks
                .iter()
                .filter(|(other, _)| other.include != include)
                .map(|&(_, region)| region)
        };
        for region in opposite()
            .filter(|&region| roles[region as usize] == Role::Open)
            .collect::<Vec<_>>()
        {
            roles[region as usize] = Role::Wall;
        }
        roles[seed as usize] = Role::Seed;
        let (x, y) = (click.at_px.x as f32, click.at_px.y as f32);
        let apart: Vec<f32> = graph
            .regions
            .iter()
            .map(|region| (region.at[0] - x).hypot(region.at[1] - y))
            .collect();
        let mut sources: Vec<(u32, f32)> = opposite().map(|region| (region, 0.0)).collect();
        if include {
            let at_rim = |at: &usize| graph.regions[*at].rim > 0.0 && roles[*at] == Role::Open;
            sources.extend(
                (0..roles.len())
                    .filter(at_rim)
                    .map(|at| (at as u32, RIM_LEAD)),
            );
        }
        let far = distances(graph, &sources, |edge| step_cost(graph, edge)).to;
        let widest = 0.45 * graph.width.min(graph.height) as f32;
        let joined = roles
            .iter()
            .zip(&apart)
            .filter(|(role, _)| **role == Role::Joined);
        let reach = joined
            .map(|(_, &apart)| apart)
            .fold(widest, f32::min)
            .max(4.0);
        let of_thing = trusted(&graph.regions, click, seed, &apart);
        let off_depth = off_depth(graph, of_thing as usize, &apart);
        let has_depth = !graph.regions[of_thing as usize].ln_depth.is_nan();
        let same_thing = has_depth.then(|| same_thing(graph, of_thing, &roles, &off_depth));
        let area = inside
            .iter()
            .zip(&graph.regions)
            .map(|(&inside, region)| if inside { region.area } else { 0.0 })
            .sum();
        Some(Self {
            graph,
            palette,
            clicks,
            roles,
            seed,
            include,
            apart,
            far,
            reach,
            off_depth,
            same_thing,
            area,
        })
    }

    /// Returns whether a region may change.
    pub fn is_open(&self, region: usize) -> bool {
        matches!(self.roles[region], Role::Open | Role::Seed)
    }

    /// Returns the geodesic distance of each region to the nearest of `sources`.
    ///
    /// Paths run through open regions only.
    pub fn near(&self, sources: &[u32]) -> Vec<f32> {
        let sources: Vec<(u32, f32)> = sources.iter().map(|&region| (region, 0.0)).collect();
        let cost = |edge: &Edge| {
            let open = self.is_open(edge.a as usize) && self.is_open(edge.b as usize);
            if open {
                step_cost(self.graph, edge)
            } else {
                f32::INFINITY
            }
        };
        distances(self.graph, &sources, cost).to
    }

    /// Returns the connected part of `change` with the clicked region, with small holes filled.
    pub fn around_seed(&self, change: &[bool]) -> Vec<bool> {
        const LARGEST_HOLE_PX: f32 = 600.0;
        let mut kept = vec![false; change.len()];
        self.graph.flood(self.seed, &mut kept, |at| change[at]);
        let mut seen = kept.clone();
        for start in 0..change.len() {
            if seen[start] || self.roles[start] != Role::Open {
                continue;
            }
            let part = self.graph.flood(start as u32, &mut seen, |at| {
                !kept[at] && self.roles[at] == Role::Open
            });
            let area: f32 = part
                .iter()
                .map(|&at| self.graph.regions[at as usize].area)
                .sum();
            if area < LARGEST_HOLE_PX && part.iter().all(|&at| self.is_enclosed(at as usize, &kept))
            {
                part.iter().for_each(|&at| kept[at as usize] = true);
            }
        }
        kept
    }

    /// Returns whether a region touches neither the image border nor a region that cannot change.
    fn is_enclosed(&self, region: usize, kept: &[bool]) -> bool {
        let neighbours = self.graph.neighbours(region);
        self.graph.regions[region].rim == 0.0
            && neighbours
                .iter()
                .all(|&(to, _)| kept[to as usize] || self.is_open(to as usize))
    }
}

/// Returns the geodesic length of crossing an edge.
///
/// It is the distance itself plus, with much more weight, the chance that an object ends there.
fn step_cost(graph: &RegionGraph, edge: &Edge) -> f32 {
    0.3 * graph.apart(edge) + 120.0 * (edge.strength - 0.2).max(0.0).powi(2)
}

/// Returns the region whose depth shows where the clicked object is.
///
/// This is the clicked region, unless its depth was not measured and a region with measured depth
/// is in front of it nearby. A click into a hole of the depth map is meant for the object in front,
/// not for the background.
fn trusted(regions: &[RegionStats], click: Click, seed: u32, apart: &[f32]) -> u32 {
    const NEAR_PX: f32 = 14.0;
    const BEFORE: f32 = 0.06;
    let clicked = &regions[seed as usize];
    if !click.include || clicked.measured {
        return seed;
    }
    let before = |at: &usize| {
        let region = &regions[*at];
        let stands_before =
            clicked.ln_depth.is_nan() || region.ln_depth < clicked.ln_depth - BEFORE;
        region.measured && apart[*at] < NEAR_PX && stands_before
    };
    let nearest = (0..apart.len())
        .filter(before)
        .min_by(|&a, &b| apart[a].total_cmp(&apart[b]));
    nearest.map_or(seed, |at| at as u32)
}

/// Returns how far regions are off the depth of the clicked one, 0–1.
///
/// A surface that runs towards or away from the camera is allowed for.
fn off_depth(graph: &RegionGraph, seed: usize, apart: &[f32]) -> Vec<f32> {
    const ALLOWED: f32 = 0.03;
    const SLANT_PER_PX: f32 = 0.0015;
    const CONFIDENT: f32 = 0.05;
    let clicked = graph.regions[seed].ln_depth;
    let off = |(region, apart): (&RegionStats, &f32)| {
        let step = (region.ln_depth - clicked).abs() - ALLOWED - SLANT_PER_PX * apart;
        // Unknown depths give NaN, which fails the comparison and counts as 0.
        if step > 0.0 {
            (step / CONFIDENT).min(1.0)
        } else {
            0.0
        }
    };
    graph.regions.iter().zip(apart).map(off).collect()
}

/// Returns the open regions that can be reached from the clicked one without a depth jump.
fn same_thing(graph: &RegionGraph, seed: u32, roles: &[Role], off_depth: &[f32]) -> Vec<bool> {
    const JUMP: f32 = 0.03;
    let mut reached = vec![false; roles.len()];
    let mut open = vec![seed];
    reached[seed as usize] = true;
    while let Some(at) = open.pop() {
        for &(to, _) in graph.neighbours(at as usize) {
            let (from, to) = (at as usize, to as usize);
            let jump = (graph.regions[from].ln_depth - graph.regions[to].ln_depth).abs();
            if !reached[to] && off_depth[to] < 0.5 && jump < JUMP {
                reached[to] = true;
                open.push(to as u32);
            }
        }
        for &to in &graph.hops[at as usize] {
            if !reached[to as usize] && off_depth[to as usize] < 0.5 {
                reached[to as usize] = true;
                open.push(to);
            }
        }
    }
    reached
        .iter()
        .zip(roles)
        .map(|(&reached, role)| reached && matches!(role, Role::Open | Role::Seed))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn click_into_a_depth_hole_means_the_object_in_front() {
        let region = |ln_depth: f32, measured: bool| RegionStats {
            ln_depth,
            measured,
            ..RegionStats::default()
        };
        // A hole filled with the wall's depth, the wall, two leaves and a nearer, unmeasured depth.
        let regions = [
            region(0.7, false),
            region(0.7, true),
            region(0.1, true),
            region(0.0, true),
            region(-0.2, false),
        ];
        let apart = [0.0, 4.0, 9.0, 12.0, 2.0];
        let at = |include: bool| Click {
            at_px: glam::DVec2::ZERO,
            include,
        };
        assert_eq!(
            trusted(&regions, at(true), 0, &apart),
            2,
            "the nearest that was measured before it"
        );
        assert_eq!(
            trusted(&regions, at(false), 0, &apart),
            0,
            "an excluded wall is the wall"
        );
        assert_eq!(
            trusted(&regions, at(true), 1, &apart),
            1,
            "what was measured counts as it is"
        );
        assert_eq!(
            trusted(&regions, at(true), 0, &[0.0, 4.0, 40.0, 40.0, 2.0]),
            0,
            "nothing near stands before it"
        );
        let unknown = [region(f32::NAN, false), region(0.7, true)];
        assert_eq!(trusted(&unknown, at(true), 0, &[0.0, 4.0]), 1);
    }
}
