//! Candidate answers to a click.
//!
//! The first family consists of minimum cuts around discs of growing radius. A click is assumed to
//! be in the middle of the intended part. For each radius, the disc around it is therefore certain
//! and provides the colour model. How far the change extends beyond the disc depends on three
//! terms. These are appearance, geodesic distances to the clicks of both sides (Price, Morse and
//! Cohen, "Geodesic graph cut for interactive image segmentation", CVPR 2010), and edges.
//!
//! The second family includes all of an object that is similar to the clicked part: every leaf of a
//! plant, or every grain of an ear. Each part of the object is assigned to the clicked appearance
//! most similar to its own, of either side. Parts that differ from all of them by more than a limit
//! are excluded. A cut keeps borders at edges.

use rayon::prelude::*;

use super::appearance::PaletteHistogram;
use super::candidate_features::{Candidate, agreement, features_of};
use super::click_context::ClickContext;
use super::graph::{Role, cheapest_change};
use super::ranking::ChangeExtent;
use super::region_stats::RegionStats;

/// Options of the candidates.
#[derive(Debug, Clone, Copy)]
pub(super) struct CandidateOptions {
    /// Radius of the smallest disc, pixels.
    pub least_radius_px: f32,
    /// Ratio of each disc's radius to the previous one, above 1.
    pub radius_step: f32,
    /// Log odds that a pixel must exceed to change; one cut per value.
    pub balloons: [f32; 3],
    /// Weights of appearance and of geodesic distance; one set of cuts per pair.
    pub mixes: [(f32, f32); 3],
    /// Gain of one unit of log odds on one pixel, in pixel sides of a border without an edge.
    pub data_weight: f32,
    /// Weight of appearance in cuts over all regions connected in space, which need depth.
    pub scattered_odds: f32,
    /// Log odds against a region that is off the clicked depth.
    pub depth_weight: f32,
}

impl Default for CandidateOptions {
    fn default() -> Self {
        Self {
            least_radius_px: 4.0,
            radius_step: 1.4,
            balloons: [-0.6, 0.0, 0.6],
            mixes: [(0.5, 0.5), (0.0, 1.0), (1.0, 0.2)],
            data_weight: 0.08,
            scattered_odds: 1.2,
            depth_weight: 4.0,
        }
    }
}

/// All candidates for a click.
pub(super) struct Candidates {
    pub all: Vec<Candidate>,
    /// IoU of every pair of candidates.
    pub shared: Vec<Vec<f32>>,
}

impl Candidates {
    /// Returns the extent of each candidate.
    pub fn extents(&self, context: &ClickContext<'_>) -> Vec<ChangeExtent> {
        let graph = context.graph;
        let pixels = (graph.width * graph.height) as f32;
        let outline = 2.0 * (graph.width + graph.height) as f32;
        let extent = |candidate: &Candidate| {
            let regions = graph.regions.iter().zip(&candidate.change);
            let changed = || regions.clone().filter(|(_, change)| **change);
            let area: f32 = changed().map(|(region, _)| region.area).sum();
            let rim: f32 = changed().map(|(region, _)| region.rim).sum();
            ChangeExtent {
                area,
                share: area / pixels,
                rim: rim / outline,
            }
        };
        self.all.iter().map(extent).collect()
    }
}

/// Returns all distinct candidates, small discs first.
pub(super) fn candidates(context: &ClickContext<'_>, options: &CandidateOptions) -> Candidates {
    let radii: Vec<f32> = std::iter::successors(Some(options.least_radius_px), |radius| {
        Some(radius * options.radius_step)
    })
    .take_while(|&radius| radius <= options.least_radius_px.max(1.1 * context.reach))
    .collect();
    let families: Vec<Vec<Candidate>> = radii
        .par_iter()
        .map(|&radius| Disc::new(context, radius).family(options))
        .collect();
    let mut found: Vec<Candidate> = Vec::new();
    for candidate in families
        .into_iter()
        .flatten()
        .chain(of_its_kind(context, options))
    {
        if !found.iter().any(|other| other.change == candidate.change) {
            found.push(candidate);
        }
    }
    let shared = agreement(context, &mut found);
    Candidates { all: found, shared }
}

/// Returns candidates that include all of the clicked object similar to the clicked regions.
fn of_its_kind(context: &ClickContext<'_>, options: &CandidateOptions) -> Vec<Candidate> {
    let near = context.near(&[context.seed]);
    let Leaning { geodesic, .. } = leaning(context, &near, options.least_radius_px);
    let candidate = |found: Alike| {
        let features = features_of(context, &found.change, &found.odds, &geodesic, found.limit);
        Candidate {
            change: found.change,
            features,
        }
    };
    alike(context, &AlikeOptions::default())
        .into_iter()
        .map(candidate)
        .collect()
}

/// A disc around the click, and the log odds of each region to belong to it.
struct Disc<'a> {
    context: &'a ClickContext<'a>,
    radius: f32,
    roles: Vec<Role>,
    odds: Vec<f32>,
    geodesic: Vec<f32>,
}

impl<'a> Disc<'a> {
    fn new(context: &'a ClickContext<'a>, radius: f32) -> Self {
        let mut roles = context.roles.clone();
        let mut disc = Vec::new();
        for (at, role) in roles.iter_mut().enumerate() {
            if *role == Role::Seed
                || (*role == Role::Open
                    && context.apart[at] <= radius
                    && context.off_depth[at] < 0.5)
            {
                *role = Role::Seed;
                disc.push(at as u32);
            }
        }
        let near = context.near(&disc);
        let Leaning { odds, geodesic } = leaning(context, &near, radius);
        Self {
            context,
            radius,
            roles,
            odds,
            geodesic,
        }
    }

    fn family(&self, options: &CandidateOptions) -> Vec<Candidate> {
        let mut found = Vec::new();
        for (odds, geodesic) in options.mixes {
            let leaning: Vec<f32> = self
                .odds
                .iter()
                .zip(&self.geodesic)
                .map(|(a, b)| odds * a + geodesic * b)
                .collect();
            let beyond = |at: usize| {
                0.12 * ((self.context.apart[at] - self.radius) / (self.radius + 10.0))
                    .clamp(0.0, 10.0)
            };
            for balloon in options.balloons {
                let change = self.cut(options, |at| leaning[at] - balloon - beyond(at));
                found.push(self.candidate(self.context.around_seed(&change)));
            }
        }
        if let Some(same_thing) = &self.context.same_thing {
            for balloon in options.balloons {
                let mut change = self.cut(options, |at| {
                    options.scattered_odds * self.odds[at] - balloon
                });
                change
                    .iter_mut()
                    .zip(same_thing)
                    .for_each(|(change, same)| *change &= same);
                change[self.context.seed as usize] = true;
                found.push(self.candidate(change));
            }
        }
        found
    }

    /// Returns the cheapest change when changing a pixel of a region gains `log_odds`.
    fn cut(&self, options: &CandidateOptions, log_odds: impl Fn(usize) -> f32) -> Vec<bool> {
        let ClickContext {
            graph, off_depth, ..
        } = self.context;
        let gain = |at: usize| {
            let worth = log_odds(at) - options.depth_weight * off_depth[at];
            options.data_weight * graph.regions[at].area * worth
        };
        let gains: Vec<f32> = (0..self.roles.len()).map(gain).collect();
        cheapest_change(graph, &self.roles, &gains, 0.5)
    }

    fn candidate(&self, change: Vec<bool>) -> Candidate {
        let features = features_of(self.context, &change, &self.odds, &self.geodesic, 0.0);
        Candidate { change, features }
    }
}

/// Log odds of each region to belong to a disc.
struct Leaning {
    /// Log odds from appearance.
    odds: Vec<f32>,
    /// Log odds from geodesic distances.
    geodesic: Vec<f32>,
}

/// Computes the log odds of each region to belong to a disc.
fn leaning(context: &ClickContext<'_>, near: &[f32], radius: f32) -> Leaning {
    let spread = 8.0 + 0.3 * radius;
    let closeness: Vec<f32> = near
        .iter()
        .map(|near| (-(near / spread).powi(2)).exp())
        .collect();
    let odds = odds(context, &closeness);
    let lean = |at: usize| {
        let (near, far) = (near[at], context.far[at]);
        match (near.is_finite(), far.is_finite()) {
            (true, true) => (far - near) / (far + near + 1.0),
            (true, false) => 1.0,
            _ => -1.0,
        }
    };
    let of_region = context
        .palette
        .of_region
        .iter()
        .map(|&entry| odds[usize::from(entry)])
        .collect();
    Leaning {
        odds: of_region,
        geodesic: (0..near.len()).map(lean).collect(),
    }
}

/// Returns the log odds of each palette entry.
///
/// They compare the close regions, and to a small share those joined before, with all others.
fn odds(context: &ClickContext<'_>, closeness: &[f32]) -> Vec<f32> {
    const JOINED_SHARE: f32 = 0.25;
    const RARE: f32 = 1e-3;
    const CLEAR: f32 = 2.0;
    let ClickContext {
        graph,
        palette,
        roles,
        ..
    } = context;
    let is_joined = |at: &usize| roles[*at] == Role::Joined;
    let weighted = |joined: bool, weight: &dyn Fn(usize) -> f32| -> PaletteHistogram {
        let chosen = (0..roles.len()).filter(|at| is_joined(at) == joined);
        palette.model(chosen.map(|at| (at, graph.regions[at].area * weight(at))))
    };
    let same = weighted(false, &|at| closeness[at]);
    let other = weighted(false, &|at| 1.0 - closeness[at]);
    let joined = weighted(true, &|_| 1.0);
    let joined_share = if roles.contains(&Role::Joined) {
        JOINED_SHARE
    } else {
        0.0
    };
    let odds_of = |entry: u8| {
        let share = (1.0 - joined_share) * same.share(entry) + joined_share * joined.share(entry);
        ((share + RARE) / (other.share(entry) + RARE))
            .ln()
            .clamp(-CLEAR, CLEAR)
    };
    (0..palette.entries()).map(odds_of).collect()
}

/// Options of the candidates that include all similar regions.
#[derive(Debug, Clone, Copy)]
pub(super) struct AlikeOptions {
    /// Maximum appearance difference to be included, ΔE; one candidate per value.
    pub limits: [f32; 5],
    /// Difference between the distances to both sides that gives one unit of log odds, ΔE.
    pub scale: f32,
    /// Gain of one unit of log odds on one pixel, in pixel sides of a border without an edge.
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

/// A change that includes all similar regions.
pub(super) struct Alike {
    pub limit: f32,
    /// Log odds of each region to belong to the clicked appearance.
    pub odds: Vec<f32>,
    pub change: Vec<bool>,
}

/// Returns one change per limit.
///
/// Returns none without depth, because depth shows what is connected.
pub(super) fn alike(context: &ClickContext<'_>, options: &AlikeOptions) -> Vec<Alike> {
    let Some(same_thing) = &context.same_thing else {
        return Vec::new();
    };
    let nearest = |samples: &[usize]| -> Vec<f32> {
        let regions = &context.graph.regions;
        let apart = |region: &RegionStats| {
            samples
                .iter()
                .map(|&sample| unlike(region, &regions[sample]))
                .fold(f32::INFINITY, f32::min)
        };
        regions.iter().map(apart).collect()
    };
    let to_clicked = nearest(&samples(context, context.include));
    let to_others = nearest(&samples(context, !context.include));
    let answer = |limit: f32| {
        let odds_of = |(clicked, others): (&f32, &f32)| {
            ((others.min(limit) - clicked) / options.scale).clamp(-2.0, 2.0)
        };
        let odds: Vec<f32> = to_clicked.iter().zip(&to_others).map(odds_of).collect();
        let gain = |at: usize| options.data_weight * context.graph.regions[at].area * odds[at];
        let gains: Vec<f32> = (0..odds.len()).map(gain).collect();
        let mut change = cheapest_change(context.graph, &context.roles, &gains, 0.5);
        change
            .iter_mut()
            .zip(same_thing)
            .for_each(|(change, same)| *change &= same);
        change[context.seed as usize] = true;
        Alike {
            limit,
            odds,
            change,
        }
    };
    options.limits.map(answer).into()
}

/// Returns the regions clicked for one side and their neighbours of the same appearance.
fn samples(context: &ClickContext<'_>, include: bool) -> Vec<usize> {
    const SAME: f32 = 4.0;
    let ClickContext { graph, .. } = context;
    let mut found = Vec::new();
    for &(_, region) in context
        .clicks
        .iter()
        .filter(|(click, _)| click.include == include)
    {
        let clicked = &graph.regions[region as usize];
        found.push(region as usize);
        let neighbours = graph
            .neighbours(region as usize)
            .iter()
            .map(|&(to, _)| to as usize);
        found.extend(neighbours.filter(|&to| unlike(clicked, &graph.regions[to]) < SAME));
    }
    found
}

/// Returns the difference of two appearances, ΔE.
///
/// Lightness counts less than hue, because shading changes it.
fn unlike(a: &RegionStats, b: &RegionStats) -> f32 {
    const LIGHTNESS: f32 = 0.35;
    let [l, red, yellow]: [f32; 3] =
        std::array::from_fn(|channel| a.tone[channel] - b.tone[channel]);
    ((LIGHTNESS * l).powi(2) + red * red + yellow * yellow).sqrt()
}
