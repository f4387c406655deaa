//! The answers a click could mean: minimum cuts around discs of growing radius.
//!
//! A click is taken for the middle of what it means, so for each radius the disc around it is certain and gives the
//! colour model; how far beyond it the change reaches is decided by appearance, by geodesic distances to the clicks of
//! both sides (Price, Morse and Cohen, "Geodesic graph cut for interactive image segmentation", CVPR 2010) and by edges.

use rayon::prelude::*;

use super::alike::{Alike, AlikeOptions, alike};
use super::appearance::Model;
use super::energy::{Role, cheapest_change};
use super::situation::Situation;
use super::traits::{Traits, agreement, traits_of};

/// What the family of candidates is made of.
#[derive(Debug, Clone, Copy)]
pub(super) struct CandidateOptions {
    /// Smallest disc, pixels.
    pub least_radius_px: f32,
    /// Each disc's radius over that of the one before, above 1.
    pub radius_step: f32,
    /// What leaving out one pixel must at least be worth, log odds; one cut each.
    pub balloons: [f32; 3],
    /// Weights of appearance and of geodesic distance; one set of cuts each.
    pub mixes: [(f32, f32); 3],
    /// Worth of one log odd on one pixel, in pixel sides of a border without any edge.
    pub data_weight: f32,
    /// Weight of appearance where, with depth, like parts of the same thing in space are taken from it all.
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

/// One way to answer a click.
pub(super) struct Candidate {
    /// Which regions change.
    pub change: Vec<bool>,
    pub traits: Traits,
}

/// All candidates for a click.
pub(super) struct Candidates {
    pub all: Vec<Candidate>,
    /// IoU of every two of them.
    pub shared: Vec<Vec<f32>>,
}

/// All different candidates, small discs first.
pub(super) fn candidates(situation: &Situation<'_>, options: &CandidateOptions) -> Candidates {
    let radii: Vec<f32> = std::iter::successors(Some(options.least_radius_px), |radius| {
        Some(radius * options.radius_step)
    })
    .take_while(|&radius| radius <= options.least_radius_px.max(1.1 * situation.reach))
    .collect();
    let families: Vec<Vec<Candidate>> = radii
        .par_iter()
        .map(|&radius| Disc::new(situation, radius).family(options))
        .collect();
    let mut found: Vec<Candidate> = Vec::new();
    for candidate in families
        .into_iter()
        .flatten()
        .chain(of_its_kind(situation, options))
    {
        if !found.iter().any(|other| other.change == candidate.change) {
            found.push(candidate);
        }
    }
    let shared = agreement(situation, &mut found);
    Candidates { all: found, shared }
}

/// Candidates that take all of the clicked thing that looks like the clicked places.
fn of_its_kind(situation: &Situation<'_>, options: &CandidateOptions) -> Vec<Candidate> {
    let near = situation.near(&[situation.seed]);
    let (_, geodesic) = leaning(situation, &near, options.least_radius_px);
    let candidate = |found: Alike| {
        let traits = traits_of(
            situation,
            &found.change,
            &found.odds,
            &geodesic,
            found.limit,
        );
        Candidate {
            change: found.change,
            traits,
        }
    };
    alike(situation, &AlikeOptions::default())
        .into_iter()
        .map(candidate)
        .collect()
}

/// A disc around the click, and how each region leans towards it.
struct Disc<'a> {
    situation: &'a Situation<'a>,
    radius: f32,
    roles: Vec<Role>,
    odds: Vec<f32>,
    geodesic: Vec<f32>,
}

impl<'a> Disc<'a> {
    fn new(situation: &'a Situation<'a>, radius: f32) -> Self {
        let mut roles = situation.roles.clone();
        let mut disc = Vec::new();
        for (at, role) in roles.iter_mut().enumerate() {
            if *role == Role::Seed
                || (*role == Role::Open
                    && situation.apart[at] <= radius
                    && situation.off_depth[at] < 0.5)
            {
                *role = Role::Seed;
                disc.push(at as u32);
            }
        }
        let near = situation.near(&disc);
        let (odds, geodesic) = leaning(situation, &near, radius);
        Self {
            situation,
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
                0.12 * ((self.situation.apart[at] - self.radius) / (self.radius + 10.0))
                    .clamp(0.0, 10.0)
            };
            for balloon in options.balloons {
                let change = self.cut(options, |at| leaning[at] - balloon - beyond(at));
                found.push(self.candidate(self.situation.around_seed(&change)));
            }
        }
        if let Some(same_thing) = &self.situation.same_thing {
            for balloon in options.balloons {
                let mut change = self.cut(options, |at| {
                    options.scattered_odds * self.odds[at] - balloon
                });
                change
                    .iter_mut()
                    .zip(same_thing)
                    .for_each(|(change, same)| *change &= same);
                change[self.situation.seed as usize] = true;
                found.push(self.candidate(change));
            }
        }
        found
    }

    /// The cheapest change when changing a pixel of a region is worth `log_odds`.
    fn cut(&self, options: &CandidateOptions, log_odds: impl Fn(usize) -> f32) -> Vec<bool> {
        let Situation {
            graph, off_depth, ..
        } = self.situation;
        let gain = |at: usize| {
            let worth = log_odds(at) - options.depth_weight * off_depth[at];
            options.data_weight * graph.regions[at].area * worth
        };
        let gains: Vec<f32> = (0..self.roles.len()).map(gain).collect();
        cheapest_change(graph, &self.roles, &gains, 0.5)
    }

    fn candidate(&self, change: Vec<bool>) -> Candidate {
        let traits = traits_of(self.situation, &change, &self.odds, &self.geodesic, 0.0);
        Candidate { change, traits }
    }
}

/// Log odds per region that it belongs with the disc, from appearance and from geodesic distances.
fn leaning(situation: &Situation<'_>, near: &[f32], radius: f32) -> (Vec<f32>, Vec<f32>) {
    let spread = 8.0 + 0.3 * radius;
    let closeness: Vec<f32> = near
        .iter()
        .map(|near| (-(near / spread).powi(2)).exp())
        .collect();
    let odds = odds(situation, &closeness);
    let lean = |at: usize| {
        let (near, far) = (near[at], situation.far[at]);
        match (near.is_finite(), far.is_finite()) {
            (true, true) => (far - near) / (far + near + 1.0),
            (true, false) => 1.0,
            _ => -1.0,
        }
    };
    let of_region = situation
        .palette
        .of_region
        .iter()
        .map(|&entry| odds[usize::from(entry)])
        .collect();
    (of_region, (0..near.len()).map(lean).collect())
}

/// Log odds per palette entry: the close regions (and a little what was joined before) against all others.
fn odds(situation: &Situation<'_>, closeness: &[f32]) -> Vec<f32> {
    const JOINED_SHARE: f32 = 0.25;
    const RARE: f32 = 1e-3;
    const CLEAR: f32 = 2.0;
    let Situation {
        graph,
        palette,
        roles,
        ..
    } = situation;
    let is_joined = |at: &usize| roles[*at] == Role::Joined;
    let weighted = |joined: bool, weight: &dyn Fn(usize) -> f32| -> Model {
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
