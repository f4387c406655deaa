//! From prompts to an answer: every click changes one connected part of the last answer.

use super::appearance::Palette;
use super::change::Change;
use super::energy::Role;
use super::graph::RegionGraph;
use crate::masks::{Click, PxBox, Region};

/// dbg
pub static ORACLE: std::sync::Mutex<Option<Region>> = std::sync::Mutex::new(None);

/// An answer in the making.
pub(super) struct Query<'a> {
    pub(super) graph: &'a RegionGraph,
    pub(super) palette: &'a Palette,
    previous: Option<&'a Region>,
    taken: Option<&'a Region>,
    /// Regions mostly taken by other labels.
    closed: Vec<bool>,
    /// Which regions are (mostly) in the answer.
    pub(super) inside: Vec<bool>,
    /// Regions that a prompt decided; the others keep their pixels of the previous answer.
    decided: Vec<bool>,
    pub(super) clicks: Vec<(Click, u32)>,
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
        let change = Change { query: self, click: *click, seed, roles };
        change.best()
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
                let centre = glam::DVec2::new((at % self.graph.width) as f64 + 0.5, (at / self.graph.width) as f64 + 0.5);
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
pub(super) fn mostly(graph: &RegionGraph, mask: &Region) -> Vec<bool> {
    let mut inside = vec![0.0f32; graph.region_count()];
    for (&region, &is_inside) in graph.of_pixel.iter().zip(&mask.inside) {
        inside[region as usize] += f32::from(u8::from(is_inside));
    }
    inside.iter().zip(&graph.regions).map(|(inside, region)| *inside > 0.5 * region.area).collect()
}
