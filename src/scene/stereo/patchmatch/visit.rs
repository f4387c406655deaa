use pulp::Simd;

use super::field::Color;
use super::level::{Level, MAX_SOURCES};
use super::plane::Plane;
use super::random::Dice;
use super::views::{COMPARED, ViewWeights, choose_views};
use super::window::Patch;

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

/// Reach of draws from other pixels, pixels.
const FAR: f32 = 24.0;

/// One pixel's hypotheses being compared.
struct Contest<'a, 'b> {
    level: &'a Level<'b>,
    patch: Patch,
    x: f32,
    y: f32,
    views: ViewWeights,
    plane: Plane,
    cost: f32,
}

/// The best hypothesis for a pixel, of its own, those of the other colour around it, and changed ones.
pub fn visit<S: Simd>(
    simd: S,
    level: &Level<'_>,
    other: &Color,
    own: Plane,
    (x, y): (usize, usize),
    turn: Turn,
) -> (Plane, f32) {
    let patch = Patch::new(level.window, &level.picture, x, y);
    if patch.variance < level.options.min_variance {
        return (own, super::ncc::WORST);
    }
    let (u, v) = (x as f32, y as f32);
    let mut planes = [own; COMPARED];
    let mut times = [1; COMPARED];
    let count = gather(level, other, (x, y), &mut planes, &mut times);
    let mut costs = [[super::ncc::WORST; MAX_SOURCES]; COMPARED];
    for (costs, &plane) in costs.iter_mut().zip(&planes[..count]) {
        for (cost, source) in costs.iter_mut().zip(&level.sources) {
            *cost = level.cost(simd, &patch, (plane, u, v), source);
        }
    }
    let good = 0.8 - 0.03 * turn.iteration.min(10) as f32;
    let views = choose_views(&costs[..count], &times[..count], level.sources.len(), good, level.options.best_views);
    let mut contest = Contest { level, patch, x: u, y: v, views, plane: own, cost: f32::INFINITY };
    for (costs, &plane) in costs[..count].iter().zip(&planes) {
        let cost: f32 = views.weights.iter().zip(costs).map(|(weight, cost)| weight * cost).sum();
        if cost < contest.cost {
            (contest.plane, contest.cost) = (plane, cost);
        }
    }
    let dice = Dice::new(level.options.seed, turn.visit, (y * level.picture.width + x) as u32);
    contest.restart(simd, other, dice, turn);
    contest.refine(simd, dice, turn);
    (contest.plane, contest.cost)
}

/// Cost of a pixel's own hypothesis over the two sources that like it most.
pub fn own_cost<S: Simd>(simd: S, level: &Level<'_>, own: Plane, (x, y): (usize, usize)) -> f32 {
    let patch = Patch::new(level.window, &level.picture, x, y);
    if patch.variance < level.options.min_variance {
        return super::ncc::WORST;
    }
    let mut least = [super::ncc::WORST; 2];
    for source in &level.sources {
        let cost = level.cost(simd, &patch, (own, x as f32, y as f32), source);
        if cost < least[1] {
            least = [least[0].min(cost), least[0].max(cost)];
        }
    }
    if level.sources.len() > 1 { 0.5 * (least[0] + least[1]) } else { least[0] }
}

/// Puts the planes of the best pixels around, and another view's, behind the pixel's own; planes that are nearly the same are counted.
fn gather(
    level: &Level<'_>,
    other: &Color,
    (x, y): (usize, usize),
    planes: &mut [Plane; COMPARED],
    times: &mut [u32; COMPARED],
) -> usize {
    let mut count = 1;
    let size = (level.picture.width, level.picture.height);
    let near = level.options.alike_px * level.step;
    let around = level.regions.best(other, size, x, y).into_iter().flatten();
    let around = around.map(|(dx, dy, at)| other.planes[at].moved(-dx as f32, -dy as f32));
    for plane in around.chain(level.hints.get(y * size.0 + x).copied()) {
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

impl Contest<'_, '_> {
    /// Takes a hypothesis where it costs less. Gives its cost; the sum so far where that is too much already.
    fn challenge<S: Simd>(&mut self, simd: S, plane: Plane) -> f32 {
        let cost = self.cost_of(simd, plane, self.cost);
        if cost < self.cost {
            (self.plane, self.cost) = (plane, cost);
        }
        cost
    }

    fn cost_of<S: Simd>(&self, simd: S, plane: Plane, limit: f32) -> f32 {
        if !self.level.is_possible(plane, self.x, self.y) {
            return f32::INFINITY;
        }
        let mut sum = 0.0;
        for &source in &self.views.order[..self.views.count] {
            let source = source as usize;
            let at = (plane, self.x, self.y);
            sum += self.views.weights[source] * self.level.cost(simd, &self.patch, at, &self.level.sources[source]);
            if sum >= limit {
                break;
            }
        }
        sum
    }

    /// Depths from anywhere in the range, and planes of pixels farther off than the regions reach: a thin part before a
    /// background that coarser levels took for the surface is found again.
    fn restart<S: Simd>(&mut self, simd: S, other: &Color, dice: Dice, turn: Turn) {
        let mut dice = dice.beside();
        let [low, high] = self.level.range;
        for _ in 0..turn.draws.max(u32::from(self.cost > 0.5)) {
            let plane = Plane { inverse_depth: low + (high - low) * dice.unit(), slope: [0.0; 2] };
            self.challenge(simd, plane);
        }
        for _ in 0..turn.draws {
            let (dx, dy) = (FAR * dice.signed(), FAR * dice.signed());
            if let Some(plane) = self.far_off(other, dx as i32, dy as i32) {
                self.challenge(simd, plane);
            }
        }
    }

    /// The plane of a pixel of the other colour at about an offset.
    fn far_off(&self, other: &Color, dx: i32, dy: i32) -> Option<Plane> {
        let (width, height) = (self.level.picture.width, self.level.picture.height);
        let dx = if (dx + dy) % 2 == 0 { dx + 1 } else { dx };
        let column = usize::try_from(self.x as i32 + dx).ok().filter(|&column| column < width)?;
        let row = usize::try_from(self.y as i32 + dy).ok().filter(|&row| row < height)?;
        let plane = other.planes[row * width.div_ceil(2) + column / 2];
        Some(plane.moved(-dx as f32, -dy as f32))
    }

    /// Random changes of depth, slope and both, then the vertex of a parabola.
    fn refine<S: Simd>(&mut self, simd: S, mut dice: Dice, turn: Turn) {
        let depth = turn.reach * self.level.step;
        let slope = 0.25 * turn.reach.min(2.0);
        self.challenge(simd, self.changed(&mut dice, depth, 0.0));
        self.challenge(simd, self.changed(&mut dice, 0.0, slope));
        self.challenge(simd, self.changed(&mut dice, 0.5 * depth, 0.5 * slope));
        self.descend(simd, 0.25 * self.level.step * turn.reach.min(1.0), |plane, by| Plane {
            inverse_depth: plane.inverse_depth + by,
            ..plane
        });
        let across = (turn.visit & 1) as usize;
        self.descend(simd, 0.1 * self.level.step * turn.reach.min(1.0), |mut plane, by| {
            plane.slope[across] += by;
            plane
        });
    }

    fn changed(&self, dice: &mut Dice, depth: f32, slope: f32) -> Plane {
        let mut plane = self.plane;
        plane.inverse_depth += depth * dice.signed();
        for (slope_px, focal) in plane.slope.iter_mut().zip(self.level.raster.focal) {
            *slope_px += slope * dice.signed() * plane.inverse_depth / focal;
        }
        plane
    }

    /// A step to the vertex of the parabola through the costs here and a little to both sides.
    fn descend<S: Simd>(&mut self, simd: S, by: f32, changed: impl Fn(Plane, f32) -> Plane) {
        let (middle, cost) = (self.plane, self.cost);
        let before = self.cost_of(simd, changed(middle, -by), f32::INFINITY);
        let after = self.cost_of(simd, changed(middle, by), f32::INFINITY);
        let bend = before - 2.0 * cost + after;
        let vertex = if bend > 1e-6 && bend.is_finite() {
            (0.5 * (before - after) / bend).clamp(-2.0, 2.0)
        } else if before < after {
            -1.0
        } else {
            1.0
        };
        self.challenge(simd, changed(middle, vertex * by));
    }
}
