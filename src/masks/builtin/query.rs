//! From prompts to an answer: every click changes one connected part of the last answer.

use super::appearance::Palette;
use super::candidates::{CandidateOptions, candidates};
use super::choice::{WEIGHTS, best, kind_of};
use super::graph::RegionGraph;
use super::situation::Situation;
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
        if !is_new {
            return;
        }
        self.decide_clicked();
        if let Some(change) = self.situation().and_then(|situation| chosen(&situation)) {
            self.apply(&change, click.include);
        }
    }

    /// The clicked region is on one side as a whole from now on.
    pub fn decide_clicked(&mut self) {
        if let Some(&(_, region)) = self.clicks.last() {
            self.decided[region as usize] |= !self.closed[region as usize];
        }
    }

    /// Marks regions as changed to the side of a click.
    pub fn apply(&mut self, change: &[bool], include: bool) {
        for (at, _) in change.iter().enumerate().filter(|(_, changes)| **changes) {
            self.inside[at] = include;
            self.decided[at] = true;
        }
    }

    /// What the last click finds; `None` where it changes nothing.
    pub fn situation(&self) -> Option<Situation<'_>> {
        let (click, region) = self.clicks.last()?;
        let at = *region as usize;
        let changes = !self.closed[at] && self.inside[at] != click.include;
        changes.then(|| Situation::new(self.graph, self.palette, &self.clicks, &self.inside, &self.closed)).flatten()
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

/// The change that the click of a situation most likely means.
fn chosen(situation: &Situation<'_>) -> Option<Vec<bool>> {
    let mut found = candidates(situation, &CandidateOptions::default());
    let best = best(&WEIGHTS, kind_of(situation), &found)?;
    Some(found.swap_remove(best).change)
}

/// Which regions lie mostly inside `mask`.
fn mostly(graph: &RegionGraph, mask: &Region) -> Vec<bool> {
    let mut inside = vec![0.0f32; graph.region_count()];
    for (&region, &is_inside) in graph.of_pixel.iter().zip(&mask.inside) {
        inside[region as usize] += f32::from(u8::from(is_inside));
    }
    inside.iter().zip(&graph.regions).map(|(inside, region)| *inside > 0.5 * region.area).collect()
}
