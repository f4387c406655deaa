use pulp::Simd;

use super::contest::Contest;
use super::field::Color;
use super::level::{Level, MAX_SOURCES};
use super::plane::Plane;
use super::random::Dice;
use super::views::{COMPARED, choose_views};

/// Where the search stands.
#[derive(Debug, Clone, Copy)]
pub struct Turn {
    /// Counts all iterations of the view, for the random numbers.
    pub visit: u32,
    /// Iterations done at this level.
    pub iteration: u32,
    /// Reach of random changes of depth, in steps of a pixel.
    pub reach: f32,
    /// Hypotheses drawn from the whole range, and as many from pixels farther off.
    pub draws: u32,
}

impl Turn {
    /// A cost below this says that a view sees the surface.
    pub fn good(self) -> f32 {
        0.8 - 0.03 * self.iteration.min(10) as f32
    }

    /// How the hypothesis of a pixel is changed at a level.
    pub fn changes(self, level: &Level<'_>) -> Changes {
        let near = level.step * self.reach.min(1.0);
        let depth = self.reach * level.step;
        Changes {
            depth,
            slope: 0.25 * self.reach.min(2.0),
            by_depth: 0.25 * near,
            by_slope: 0.1 * near,
        }
    }
}

/// How far a hypothesis is changed.
#[derive(Debug, Clone, Copy)]
pub struct Changes {
    /// Reach of random changes of inverse depth.
    pub depth: f32,
    /// Reach of random changes of slope, as a share.
    pub slope: f32,
    /// Step of the parabola along the inverse depth.
    pub by_depth: f32,
    /// Step of the parabola along the slope.
    pub by_slope: f32,
}

/// The best hypothesis for a pixel with something to be compared, of its own, those of the other colour around it, and changed ones.
#[inline(always)]
pub fn visit<S: Simd>(
    simd: S,
    level: &Level<'_>,
    other: &Color,
    own: Plane,
    (x, y): (usize, usize),
    turn: Turn,
) -> (Plane, f32) {
    let patch = level.patch(x, y);
    let (u, v) = (x as f32, y as f32);
    let mut planes = [own; COMPARED];
    let mut times = [1; COMPARED];
    let hint = level.hint_for(&patch, x, y);
    let count = gather(level, other, (x, y), hint, &mut planes, &mut times);
    let mut costs = [[super::ncc::WORST; MAX_SOURCES]; COMPARED];
    for (costs, &plane) in costs.iter_mut().zip(&planes[..count]) {
        for (cost, source) in costs.iter_mut().zip(&level.sources) {
            *cost = level.cost(simd, &patch, (plane, u, v), source);
        }
    }
    let sources = level.sources.len();
    let views = choose_views(
        &costs[..count],
        &times[..count],
        sources,
        turn.good(),
        level.options.best_views,
    );
    let mut contest = Contest {
        level,
        patch,
        x: u,
        y: v,
        views,
        plane: own,
        cost: f32::INFINITY,
    };
    for (costs, &plane) in costs[..count].iter().zip(&planes) {
        let pulled = level.pulled(&contest.patch, (plane, u, v));
        let cost = views
            .weights
            .iter()
            .zip(costs)
            .fold(pulled, |sum, (weight, cost)| sum + weight * cost);
        if cost < contest.cost {
            (contest.plane, contest.cost) = (plane, cost);
        }
    }
    let dice = Dice::new(
        level.options.seed,
        turn.visit,
        (y * level.picture.width + x) as u32,
    );
    contest.restart(simd, other, dice, turn);
    contest.refine(simd, dice, turn);
    (contest.plane, contest.cost)
}

/// Cost of a pixel's own hypothesis over the two sources that like it most; `None` where there is nothing to be compared.
#[inline(always)]
pub fn own_cost<S: Simd>(
    simd: S,
    level: &Level<'_>,
    own: Plane,
    (x, y): (usize, usize),
) -> Option<f32> {
    let patch = level.patch(x, y);
    if patch.is_empty(level.options.min_variance) {
        return None;
    }
    let mut least = [super::ncc::WORST; 2];
    for source in &level.sources {
        let cost = level.cost(simd, &patch, (own, x as f32, y as f32), source);
        if cost < least[1] {
            least = [least[0].min(cost), least[0].max(cost)];
        }
    }
    let seen = if level.sources.len() > 1 {
        0.5 * (least[0] + least[1])
    } else {
        least[0]
    };
    Some((seen + level.pulled(&patch, (own, x as f32, y as f32))).min(super::ncc::WORST))
}

/// Puts the planes of the best pixels around, and one from elsewhere, behind the pixel's own; planes that are nearly the
/// same are counted.
#[inline(always)]
fn gather(
    level: &Level<'_>,
    other: &Color,
    (x, y): (usize, usize),
    hint: Option<Plane>,
    planes: &mut [Plane; COMPARED],
    times: &mut [u32; COMPARED],
) -> usize {
    let mut count = 1;
    let near = level.options.alike_px * level.step;
    let around = level.regions.best(other, x, y).into_iter().flatten();
    let around = around.map(|(dx, dy, at)| other.planes[at].moved(-dx as f32, -dy as f32));
    for plane in around.chain(hint) {
        if !level.is_possible(plane, x as f32, y as f32) {
            continue;
        }
        let alike = |known: &Plane| {
            (known.inverse_depth - plane.inverse_depth).abs() < near
                && 4.0 * (known.slope[0] - plane.slope[0]).abs() < near
                && 4.0 * (known.slope[1] - plane.slope[1]).abs() < near
        };
        match planes[..count].iter().position(alike) {
            Some(known) => times[known] += 1,
            None => {
                (planes[count], times[count]) = (plane, 1);
                count += 1;
            }
        }
    }
    count
}
