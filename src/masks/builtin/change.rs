//! What a click changes: a family of cuts at several scales, and the choice among them.

use rayon::prelude::*;

use super::energy::{Role, border_price, cheapest_change};
use super::geodesic::distances;
use super::graph::{Edge, RegionGraph};
use super::query::{ORACLE, Query, mostly};
use crate::masks::Click;

pub(super) struct Change<'a> {
    pub query: &'a Query<'a>,
    pub click: Click,
    pub seed: u32,
    pub roles: Vec<Role>,
}

pub(super) const FEATURES: usize = 12;

struct Candidate {
    change: Vec<bool>,
    features: [f32; FEATURES],
}

impl Change<'_> {
    fn graph(&self) -> &RegionGraph {
        self.query.graph
    }

    fn is_open(&self, at: u32) -> bool {
        matches!(self.roles[at as usize], Role::Open | Role::Seed)
    }

    fn apart(&self, at: usize) -> f32 {
        let region = &self.graph().regions[at];
        (region.at[0] - self.click.at_px.x as f32).hypot(region.at[1] - self.click.at_px.y as f32)
    }

    pub fn best(&self) -> Vec<bool> {
        let scale = self.scale();
        let far = distances(self.graph(), &self.opposite_sources(), |edge| self.step_cost(edge)).to;
        let mut radii = vec![4.0f32];
        while radii[radii.len() - 1] * 1.4 < scale * 1.1 {
            radii.push(radii[radii.len() - 1] * 1.4);
        }
        let mut candidates: Vec<Candidate> = radii.par_iter().flat_map_iter(|&radius| self.family(radius, &far, scale)).collect();
        let mut unique: Vec<Candidate> = Vec::new();
        for candidate in candidates.drain(..) {
            if !unique.iter().any(|other| other.change == candidate.change) {
                unique.push(candidate);
            }
        }
        self.consensus(&mut unique);
        let scores: Vec<f32> = unique.iter().map(|candidate| self.score(&candidate.features)).collect();
        if let Some(truth) = &*ORACLE.lock().unwrap() {
            let t = mostly(self.graph(), truth);
            let gains: Vec<f32> = unique
                .iter()
                .map(|candidate| {
                    let (mut i, mut u) = (0.0, 0.0);
                    for at in 0..t.len() {
                        let x = if candidate.change[at] { self.click.include } else { self.query.inside[at] };
                        let a = self.graph().regions[at].area;
                        if x && t[at] {
                            i += a;
                        }
                        if x || t[at] {
                            u += a;
                        }
                    }
                    i / u
                })
                .collect();
            if std::env::var("DUMP").is_ok() {
                let first = self.query.clicks.len() == 1;
                println!("Q {} {} {}", u8::from(first), u8::from(self.click.include), self.query.clicks.len());
                for (candidate, gain) in unique.iter().zip(&gains) {
                    println!("C {gain} {}", candidate.features.iter().map(|f| format!("{f:.4}")).collect::<Vec<_>>().join(" "));
                }
            }
            if std::env::var("ORACLE").is_ok_and(|value| value == "1") {
                let best = (0..gains.len()).max_by(|&a, &b| gains[a].total_cmp(&gains[b])).unwrap();
                return unique.swap_remove(best).change;
            }
        }
        let best = (0..scores.len()).max_by(|&a, &b| scores[a].total_cmp(&scores[b])).unwrap();
        unique.swap_remove(best).change
    }

    fn score(&self, f: &[f32; FEATURES]) -> f32 {
        -f[0] + 0.02 * f[1] - 0.2 * f[2] + 0.1 * f[11]
    }

    fn consensus(&self, candidates: &mut [Candidate]) {
        let areas: Vec<f32> = self.graph().regions.iter().map(|region| region.area).collect();
        let count = candidates.len();
        let mut sums = vec![0.0; count];
        for a in 0..count {
            for b in a + 1..count {
                let (mut both, mut any) = (0.0, 0.0);
                for (at, area) in areas.iter().enumerate() {
                    let (x, y) = (candidates[a].change[at], candidates[b].change[at]);
                    both += if x && y { *area } else { 0.0 };
                    any += if x || y { *area } else { 0.0 };
                }
                sums[a] += both / any;
                sums[b] += both / any;
            }
        }
        for (candidate, sum) in candidates.iter_mut().zip(sums) {
            candidate.features[11] = sum / (count.max(2) - 1) as f32;
        }
    }

    fn step_cost(&self, edge: &Edge) -> f32 {
        let (a, b) = (&self.graph().regions[edge.a as usize], &self.graph().regions[edge.b as usize]);
        let apart = ((a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2)).sqrt();
        0.3 * apart + 120.0 * (edge.strength - 0.2).max(0.0).powi(2)
    }

    fn opposite_sources(&self) -> Vec<(u32, f32)> {
        let mut sources: Vec<(u32, f32)> = self
            .query
            .clicks
            .iter()
            .filter(|(other, _)| other.include != self.click.include)
            .map(|&(_, region)| (region, 0.0))
            .collect();
        if self.click.include {
            let rim = self.graph().regions.iter().enumerate().filter(|(at, region)| region.rim > 0.0 && self.roles[*at] == Role::Open);
            sources.extend(rim.map(|(at, _)| (at as u32, 20.0)));
        }
        sources
    }

    /// How far the part to change may reach: the distance from the click to what is on the wanted side already.
    fn scale(&self) -> f32 {
        let joined = (0..self.roles.len()).filter(|&at| self.roles[at] == Role::Joined);
        let nearest = joined.map(|at| self.apart(at)).fold(f32::INFINITY, f32::min);
        nearest.min(0.45 * (self.graph().width.min(self.graph().height)) as f32).max(4.0)
    }

    fn family(&self, radius: f32, far: &[f32], scale: f32) -> Vec<Candidate> {
        let graph = self.graph();
        let regions = &graph.regions;
        let mut roles = self.roles.clone();
        let disc: Vec<u32> = (0..roles.len() as u32)
            .filter(|&at| self.roles[at as usize] == Role::Seed || (self.roles[at as usize] == Role::Open && self.apart(at as usize) <= radius))
            .collect();
        disc.iter().for_each(|&at| roles[at as usize] = Role::Seed);
        let sources: Vec<(u32, f32)> = disc.iter().map(|&at| (at, 0.0)).collect();
        let open_cost =
            |edge: &Edge| if self.is_open(edge.a) && self.is_open(edge.b) { self.step_cost(edge) } else { f32::INFINITY };
        let near = distances(graph, &sources, open_cost).to;
        let reach = 8.0 + 0.3 * radius;
        let weight = |at: usize| (-(near[at] / reach).powi(2)).exp();
        let palette = self.query.palette;
        let all = || (0..regions.len()).filter(|&at| roles[at] != Role::Joined);
        let same = palette.model(all().map(|at| (at, regions[at].area * weight(at))));
        let other = palette.model(all().map(|at| (at, regions[at].area * (1.0 - weight(at)))));
        let joined = palette.model((0..regions.len()).filter(|&at| roles[at] == Role::Joined).map(|at| (at, regions[at].area)));
        let has_joined = roles.contains(&Role::Joined);
        let leaning: Vec<f32> = (0..regions.len())
            .map(|at| {
                let entry = palette.of_region[at];
                let mut share = same.share(entry);
                if has_joined {
                    share = 0.75 * share + 0.25 * joined.share(entry);
                }
                let odds = ((share + 1e-3) / (other.share(entry) + 1e-3)).ln().clamp(-2.0, 2.0);
                let geodesic = (far[at] - near[at]) / (far[at] + near[at] + 1.0);
                let geodesic = if geodesic.is_finite() { geodesic } else { -1.0 };
                0.5 * odds + 0.5 * geodesic
            })
            .collect();
        [-0.6, 0.0, 0.6]
            .into_iter()
            .map(|balloon| {
                let gain: Vec<f32> = (0..roles.len())
                    .map(|at| {
                        let beyond = ((self.apart(at) - radius) / (radius + 10.0)).clamp(0.0, 10.0);
                        0.08 * regions[at].area * (leaning[at] - balloon - 0.12 * beyond)
                    })
                    .collect();
                let change = cheapest_change(graph, &roles, &gain, 0.5);
                let change = self.around(&change);
                let features = self.features(&change, &leaning, radius, scale);
                Candidate { change, features }
            })
            .collect()
    }

    /// The connected part of `change` that holds the seed, its holes filled.
    fn around(&self, change: &[bool]) -> Vec<bool> {
        let graph = self.graph();
        let mut kept = self.flood(self.seed, |at| change[at]);
        kept[self.seed as usize] = true;
        let count = change.len();
        let mut seen = vec![false; count];
        for start in 0..count {
            if kept[start] || seen[start] || self.roles[start] != Role::Open {
                continue;
            }
            let part = self.flood(start as u32, |at| !kept[at] && self.roles[at] == Role::Open);
            let mut area = 0.0;
            let mut is_hole = true;
            for at in (0..count).filter(|&at| part[at]) {
                seen[at] = true;
                area += graph.regions[at].area;
                is_hole &= graph.regions[at].rim == 0.0
                    && graph
                        .neighbours(at)
                        .iter()
                        .all(|&(to, _)| self.roles[to as usize] != Role::Wall && self.roles[to as usize] != Role::Joined);
            }
            if is_hole && area < 600.0 {
                (0..count).filter(|&at| part[at]).for_each(|at| kept[at] = true);
            }
        }
        kept
    }

    fn flood(&self, seed: u32, inside: impl Fn(usize) -> bool) -> Vec<bool> {
        let mut reached = vec![false; self.graph().region_count()];
        let mut open = vec![seed];
        reached[seed as usize] = true;
        while let Some(at) = open.pop() {
            for &(to, _) in self.graph().neighbours(at as usize) {
                if !reached[to as usize] && inside(to as usize) {
                    reached[to as usize] = true;
                    open.push(to);
                }
            }
        }
        reached
    }

    fn features(&self, change: &[bool], leaning: &[f32], radius: f32, scale: f32) -> [f32; FEATURES] {
        let graph = self.graph();
        let (mut length, mut price, mut weak, mut joined) = (0.0f32, 0.0, 0.0, 0.0);
        let mut border: Vec<(u32, f32)> = Vec::new();
        for edge in &graph.edges {
            let (a, b) = (edge.a as usize, edge.b as usize);
            if change[a] != change[b] {
                let (inner, outer) = if change[a] { (a, b) } else { (b, a) };
                let region = &graph.regions[inner];
                border.push((inner as u32, 0.5 * region.area.sqrt()));
                if self.roles[outer] == Role::Joined {
                    joined += edge.length;
                } else {
                    length += edge.length;
                    price += edge.length * border_price(edge);
                    weak += if edge.strength < 0.35 { edge.length } else { 0.0 };
                }
            }
        }
        let changed = || (0..change.len()).filter(|&at| change[at]);
        let rim: f32 = changed().map(|at| graph.regions[at].rim).sum();
        let area: f32 = changed().map(|at| graph.regions[at].area).sum::<f32>().max(1.0);
        for at in changed().filter(|&at| graph.regions[at].rim > 0.0) {
            border.push((at as u32, 0.5 * graph.regions[at].area.sqrt()));
        }
        let depth = distances(graph, &border, |edge| {
            if change[edge.a as usize] && change[edge.b as usize] {
                let (a, b) = (&graph.regions[edge.a as usize], &graph.regions[edge.b as usize]);
                (a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1])
            } else {
                f32::INFINITY
            }
        })
        .to;
        let at_click = depth[self.seed as usize].max(2.0);
        let deepest = changed().map(|at| depth[at]).filter(|d| d.is_finite()).fold(at_click, f32::max);
        let whole = length + rim + joined;
        let lean_in = changed().map(|at| leaning[at] * graph.regions[at].area).sum::<f32>() / area;
        let (mut ring, mut ring_area) = (0.0, 0.0);
        for edge in &graph.edges {
            let (a, b) = (edge.a as usize, edge.b as usize);
            if change[a] != change[b] {
                let outer = if change[a] { b } else { a };
                if self.roles[outer] != Role::Joined {
                    ring += leaning[outer] * edge.length;
                    ring_area += edge.length;
                }
            }
        }
        let ring = ring / ring_area.max(1.0);
        let far = changed().map(|at| self.apart(at)).fold(1.0f32, f32::max);
        [
            (price + 0.25 * rim) / (length + rim).max(1.0),
            area.ln(),
            (deepest / at_click).ln(),
            (at_click / scale).ln(),
            weak / (length + rim).max(1.0),
            joined / whole.max(1.0),
            rim / whole.max(1.0),
            lean_in,
            ring,
            whole / area.sqrt(),
            (far / at_click).ln() + 0.0 * radius,
            0.0,
        ]
    }
}
