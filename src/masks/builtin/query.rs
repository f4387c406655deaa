//! From prompts to an answer: every click changes one connected part of the last answer.

use super::appearance::{Model, Palette};
use super::energy::{Role, border_price, cheapest_change};
use super::geodesic::distances;
use super::graph::RegionGraph;
use crate::masks::{Click, PxBox, Region};

/// An answer in the making.
pub(super) struct Query<'a> {
    graph: &'a RegionGraph,
    palette: &'a Palette,
    previous: Option<&'a Region>,
    taken: Option<&'a Region>,
    /// Regions mostly taken by other labels.
    closed: Vec<bool>,
    /// Which regions are (mostly) in the answer.
    inside: Vec<bool>,
    /// Regions that a prompt decided; the others keep their pixels of the previous answer.
    decided: Vec<bool>,
    clicks: Vec<(Click, u32)>,
}

impl<'a> Query<'a> {
    pub fn new(graph: &'a RegionGraph, palette: &'a Palette, taken: Option<&'a Region>) -> Self {
        let count = graph.region_count();
        let closed = taken.map_or_else(|| vec![false; count], |taken| mostly(graph, taken));
        Self {
            graph,
            palette,
            previous: None,
            taken,
            closed,
            inside: vec![false; count],
            decided: vec![false; count],
            clicks: Vec::new(),
        }
    }

    /// Takes an earlier answer as it is.
    pub fn start_from(&mut self, previous: &'a Region) {
        self.previous = Some(previous);
        self.inside = mostly(self.graph, previous);
    }

    pub fn add_boxes(&mut self, boxes: &[PxBox]) {
        let _ = boxes;
    }

    /// Notes a click; a new one changes the answer around it.
    pub fn add_click(&mut self, click: &Click, is_new: bool) {
        let (x, y) = (click.at_px.x as usize, click.at_px.y as usize);
        let region = self.graph.of_pixel[y * self.graph.width + x];
        self.clicks.push((*click, region));
        let at = region as usize;
        if !is_new || self.closed[at] {
            return;
        }
        if self.inside[at] == click.include {
            self.decided[at] = true;
            return;
        }
        for (at, changes) in self.change(click, region).into_iter().enumerate() {
            if changes {
                self.inside[at] = click.include;
                self.decided[at] = true;
            }
        }
    }

    /// The regions that a click on the wrong side changes.
    fn change(&self, click: &Click, seed: u32) -> Vec<bool> {
        let graph = self.graph;
        let mut roles: Vec<Role> = (0..graph.region_count())
            .map(|at| match () {
                () if self.closed[at] => Role::Wall,
                () if self.inside[at] == click.include => Role::Joined,
                () => Role::Open,
            })
            .collect();
        for (other, region) in &self.clicks {
            if other.include != click.include && roles[*region as usize] == Role::Open {
                roles[*region as usize] = Role::Wall;
            }
        }
        roles[seed as usize] = Role::Seed;
        let open_cost = |edge: &super::graph::Edge| {
            let is_open = |at: u32| matches!(roles[at as usize], Role::Open | Role::Seed);
            if is_open(edge.a) && is_open(edge.b) { self.step_cost(edge) } else { f32::INFINITY }
        };
        let near = distances(graph, &[(seed, 0.0)], open_cost).to;
        let opposite = self.opposite_sources(click, &roles);
        let far = distances(graph, &opposite, |edge| self.step_cost(edge)).to;
        let scale = self.scale(click, &roles);
        let leaning = self.leaning(click, &roles, &near, &far);
        let mut best: Option<(f32, Vec<bool>)> = None;
        for step in 0..8 {
            let balloon = -0.9 + 0.25 * step as f32;
            let gain: Vec<f32> = (0..roles.len())
                .map(|at| {
                    let region = &graph.regions[at];
                    let apart = ((f64::from(region.at[0]) - click.at_px.x).powi(2)
                        + (f64::from(region.at[1]) - click.at_px.y).powi(2))
                    .sqrt() as f32;
                    0.08 * region.area * (leaning[at] - balloon - 0.15 * (apart / scale).min(10.0))
                })
                .collect();
            let change = cheapest_change(graph, &roles, &gain, 0.5);
            let change = self.around(seed, &change, &roles);
            let score = self.score(&change, &roles);
            if std::env::var("SEGDBG").is_ok() {
                let area: f32 = (0..roles.len()).filter(|&at| change[at]).map(|at| graph.regions[at].area).sum();
                eprintln!("   balloon {balloon:.2} area {area} score {score:.3} scale {scale:.0}");
            }
            if best.as_ref().is_none_or(|(most, _)| score > *most) {
                best = Some((score, change));
            }
        }
        best.map(|(_, change)| change).unwrap_or_default()
    }

    fn step_cost(&self, edge: &super::graph::Edge) -> f32 {
        let (a, b) = (&self.graph.regions[edge.a as usize], &self.graph.regions[edge.b as usize]);
        let apart = ((a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2)).sqrt();
        0.3 * apart + 120.0 * (edge.strength - 0.2).max(0.0).powi(2)
    }

    fn opposite_sources(&self, click: &Click, roles: &[Role]) -> Vec<(u32, f32)> {
        let mut sources: Vec<(u32, f32)> = self
            .clicks
            .iter()
            .filter(|(other, _)| other.include != click.include)
            .map(|&(_, region)| (region, 0.0))
            .collect();
        if click.include {
            let rim = self
                .graph
                .regions
                .iter()
                .enumerate()
                .filter(|(at, region)| region.rim > 0.0 && roles[*at] == Role::Open);
            sources.extend(rim.map(|(at, _)| (at as u32, 20.0)));
        }
        sources
    }

    /// How far the part to change may reach: the distance from the click to what is on the wanted side already.
    fn scale(&self, click: &Click, roles: &[Role]) -> f32 {
        let (x, y) = (click.at_px.x as f32, click.at_px.y as f32);
        let joined = (0..roles.len()).filter(|&at| roles[at] == Role::Joined);
        let nearest = joined
            .map(|at| (self.graph.regions[at].at[0] - x).hypot(self.graph.regions[at].at[1] - y))
            .fold(f32::INFINITY, f32::min);
        nearest.min(0.25 * (self.graph.width.min(self.graph.height)) as f32).max(8.0)
    }

    /// Log odds per region that it changes with the click, from appearance and from geodesic distances.
    fn leaning(&self, click: &Click, roles: &[Role], near: &[f32], far: &[f32]) -> Vec<f32> {
        let regions = &self.graph.regions;
        let _ = click;
        const REACH: f32 = 30.0;
        let weight = |at: usize| (-(near[at] / REACH).powi(2)).exp();
        let open = |at: &usize| matches!(roles[*at], Role::Open | Role::Seed | Role::Wall);
        let all = || (0..regions.len()).filter(open);
        let same: Model = self.palette.model(all().map(|at| (at, regions[at].area * weight(at))));
        let other: Model = self.palette.model(all().map(|at| (at, regions[at].area * (1.0 - weight(at)))));
        (0..regions.len())
            .map(|at| {
                let entry = self.palette.of_region[at];
                let odds = ((same.share(entry) + 1e-3) / (other.share(entry) + 1e-3)).ln().clamp(-2.0, 2.0);
                let geodesic = (far[at] - near[at]) / (far[at] + near[at] + 1.0);
                let geodesic = if geodesic.is_finite() { geodesic } else { -1.0 };
                0.5 * odds + 0.5 * geodesic
            })
            .collect()
    }

    /// The connected part of `change` that holds the seed, its holes filled.
    fn around(&self, seed: u32, change: &[bool], roles: &[Role]) -> Vec<bool> {
        let mut kept = self.flood(seed, |at| change[at]);
        kept[seed as usize] = true;
        // A hole: open regions that cannot reach the picture's rim or a region that stays otherwise.
        let count = change.len();
        let mut seen = vec![false; count];
        for start in 0..count {
            if kept[start] || seen[start] || roles[start] != Role::Open {
                continue;
            }
            let part = self.flood(start as u32, |at| !kept[at] && roles[at] == Role::Open);
            let mut area = 0.0;
            let mut is_hole = true;
            for at in (0..count).filter(|&at| part[at]) {
                seen[at] = true;
                area += self.graph.regions[at].area;
                is_hole &= self.graph.regions[at].rim == 0.0
                    && self
                        .graph
                        .neighbours(at)
                        .iter()
                        .all(|&(to, _)| roles[to as usize] != Role::Wall && roles[to as usize] != Role::Joined);
            }
            if is_hole && area < 600.0 {
                (0..count).filter(|&at| part[at]).for_each(|at| kept[at] = true);
            }
        }
        kept
    }

    fn flood(&self, seed: u32, inside: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut reached = vec![false; self.graph.region_count()];
        let mut open = vec![seed];
        reached[seed as usize] = true;
        while let Some(at) = open.pop() {
            for &(to, _) in self.graph.neighbours(at as usize) {
                if !reached[to as usize] && inside(to as usize) {
                    reached[to as usize] = true;
                    open.push(to);
                }
            }
        }
        reached
    }

    /// How well a change ends on edges, with a little favour for larger ones.
    fn score(&self, change: &[bool], roles: &[Role]) -> f32 {
        let graph = self.graph;
        let (mut length, mut price) = (0.0, 0.0);
        for edge in &graph.edges {
            let (a, b) = (edge.a as usize, edge.b as usize);
            if change[a] != change[b] {
                let outer = if change[a] { b } else { a };
                if roles[outer] != Role::Joined {
                    length += edge.length;
                    price += edge.length * border_price(edge);
                }
            }
        }
        let changed = || (0..change.len()).filter(|&at| change[at]);
        let rim: f32 = changed().map(|at| graph.regions[at].rim).sum();
        let area: f32 = changed().map(|at| graph.regions[at].area).sum();
        -(price + 0.25 * rim) / (length + rim).max(1.0) + 0.02 * area.max(1.0).ln()
    }

    /// The answer as pixels.
    pub fn answer(self) -> Region {
        let graph = self.graph;
        let (width, height) = (graph.width, graph.height);
        let mut answer = Region::empty(width as u32, height as u32);
        for (at, (out, &region)) in answer.inside.iter_mut().zip(&graph.of_pixel).enumerate() {
            let region = region as usize;
            *out = match self.previous {
                Some(previous) if !self.decided[region] => previous.inside[at],
                _ => self.inside[region],
            } && !self.taken.is_some_and(|taken| taken.inside[at]);
        }
        self.split_contested(&mut answer);
        answer
    }

    /// A region clicked for both sides is shared out: every pixel goes with the nearest click.
    fn split_contested(&self, answer: &mut Region) {
        let contested = |region: u32| {
            let here = || self.clicks.iter().filter(|(_, other)| *other == region);
            here().any(|(click, _)| click.include) && here().any(|(click, _)| !click.include)
        };
        let mut regions: Vec<u32> = self.clicks.iter().map(|&(_, region)| region).filter(|&at| contested(at)).collect();
        regions.sort_unstable();
        regions.dedup();
        if regions.is_empty() {
            return;
        }
        for (at, region) in self.graph.of_pixel.iter().enumerate() {
            if regions.contains(region) && !self.taken.is_some_and(|taken| taken.inside[at]) {
                let centre =
                    glam::DVec2::new((at % self.graph.width) as f64 + 0.5, (at / self.graph.width) as f64 + 0.5);
                let here = self.clicks.iter().filter(|(_, other)| other == region);
                let nearest = here.min_by(|(a, _), (b, _)| {
                    a.at_px.distance_squared(centre).total_cmp(&b.at_px.distance_squared(centre))
                });
                answer.inside[at] = nearest.is_some_and(|(click, _)| click.include);
            }
        }
    }
}

/// Which regions lie mostly inside `mask`.
fn mostly(graph: &RegionGraph, mask: &Region) -> Vec<bool> {
    let mut inside = vec![0.0f32; graph.region_count()];
    for (&region, &is_inside) in graph.of_pixel.iter().zip(&mask.inside) {
        inside[region as usize] += f32::from(u8::from(is_inside));
    }
    inside.iter().zip(&graph.regions).map(|(inside, region)| *inside > 0.5 * region.area).collect()
}
