//! Answers that take all of a thing that looks like what was clicked: every leaf of a plant, every grain of an ear.
//!
//! Each part of the thing goes with the clicked appearance nearest to its own, of either side, unless it is farther than
//! a limit from all of them; a cut keeps borders where edges are.

use super::energy::cheapest_change;
use super::graph::RegionStats;
use super::situation::Situation;

/// How alike is measured.
#[derive(Debug, Clone, Copy)]
pub(super) struct AlikeOptions {
    /// Farthest appearance that is still taken, ΔE; one answer each.
    pub limits: [f32; 5],
    /// ΔE nearer to the one side than to the other that is worth one log odd.
    pub scale: f32,
    /// Worth of one log odd on one pixel, in pixel sides of a border without any edge.
    pub data_weight: f32,
}

impl Default for AlikeOptions {
    fn default() -> Self {
        Self {
            limits: [3.5, 5.0, 7.0, 10.0, 16.0],
            scale: 2.0,
            data_weight: 0.15,
        }
    }
}

/// A change that takes all that is alike.
pub(super) struct Alike {
    pub limit: f32,
    /// Log odds per region that it belongs with what was clicked.
    pub odds: Vec<f32>,
    pub change: Vec<bool>,
}

/// One change per limit; none where no depth tells what hangs together.
pub(super) fn alike(situation: &Situation<'_>, options: &AlikeOptions) -> Vec<Alike> {
    let Some(same_thing) = &situation.same_thing else {
        return Vec::new();
    };
    let nearest = |samples: &[usize]| -> Vec<f32> {
        let regions = &situation.graph.regions;
        let apart = |region: &RegionStats| {
            samples
                .iter()
                .map(|&sample| unlike(region, &regions[sample]))
                .fold(f32::INFINITY, f32::min)
        };
        regions.iter().map(apart).collect()
    };
    let to_clicked = nearest(&samples(situation, situation.include));
    let to_others = nearest(&samples(situation, !situation.include));
    let answer = |limit: f32| {
        let odds_of = |(clicked, others): (&f32, &f32)| {
            ((others.min(limit) - clicked) / options.scale).clamp(-2.0, 2.0)
        };
        let odds: Vec<f32> = to_clicked.iter().zip(&to_others).map(odds_of).collect();
        let gain = |at: usize| options.data_weight * situation.graph.regions[at].area * odds[at];
        let gains: Vec<f32> = (0..odds.len()).map(gain).collect();
        let mut change = cheapest_change(situation.graph, &situation.roles, &gains, 0.5);
        change
            .iter_mut()
            .zip(same_thing)
            .for_each(|(change, same)| *change &= same);
        change[situation.seed as usize] = true;
        Alike {
            limit,
            odds,
            change,
        }
    };
    options.limits.map(answer).into()
}

/// The regions clicked for one side and those beside them that look the same.
fn samples(situation: &Situation<'_>, include: bool) -> Vec<usize> {
    const SAME: f32 = 4.0;
    let Situation { graph, .. } = situation;
    let mut found = Vec::new();
    for &(_, region) in situation
        .clicks
        .iter()
        .filter(|(click, _)| click.include == include)
    {
        let clicked = &graph.regions[region as usize];
        found.push(region as usize);
        let beside = graph
            .neighbours(region as usize)
            .iter()
            .map(|&(to, _)| to as usize);
        found.extend(beside.filter(|&to| unlike(clicked, &graph.regions[to]) < SAME));
    }
    found
}

/// How far two appearances are apart, ΔE; lightness, which shading changes, counts less than hue.
fn unlike(a: &RegionStats, b: &RegionStats) -> f32 {
    const LIGHTNESS: f32 = 0.35;
    let [l, red, yellow]: [f32; 3] =
        std::array::from_fn(|channel| a.tone[channel] - b.tone[channel]);
    ((LIGHTNESS * l).powi(2) + red * red + yellow * yellow).sqrt()
}
