use pulp::{NullaryFnOnce, Simd};

use super::field::Color;
use super::level::Level;
use super::plane::Plane;
use super::random::Dice;
use super::views::ViewWeights;
use super::visit::{Changes, Turn};
use super::window::Patch;

/// Reach of draws from other pixels, pixels.
pub const FAR: f32 = 24.0;

/// One pixel's hypotheses being compared.
pub struct Contest<'a, 'b> {
    /// Where.
    pub level: &'a Level<'b>,
    /// The pixel's surroundings.
    pub patch: Patch,
    /// Column.
    pub x: f32,
    /// Row.
    pub y: f32,
    /// The sources that count.
    pub views: ViewWeights,
    /// The best hypothesis so far.
    pub plane: Plane,
    /// Its cost.
    pub cost: f32,
}

impl Contest<'_, '_> {
    /// Takes a hypothesis where it costs less. Gives its cost; the sum so far where that is too much already.
    #[inline(always)]
    fn challenge<S: Simd>(&mut self, simd: S, plane: Plane) -> f32 {
        let cost = self.cost_of(simd, plane, self.cost);
        if cost < self.cost {
            (self.plane, self.cost) = (plane, cost);
        }
        cost
    }

    /// The cost over the sources that count; the sum so far where that reaches a limit. Compiled once, as it is called
    /// from many places.
    #[inline(always)]
    fn cost_of<S: Simd>(&self, simd: S, plane: Plane, limit: f32) -> f32 {
        simd.vectorize(Judgement {
            simd,
            contest: self,
            plane,
            limit,
        })
    }

    #[inline(always)]
    fn judged<S: Simd>(&self, simd: S, plane: Plane, limit: f32) -> f32 {
        if !self.level.is_possible(plane, self.x, self.y) {
            return f32::INFINITY;
        }
        let mut sum = self.level.pulled(&self.patch, (plane, self.x, self.y));
        for &source in &self.views.order[..self.views.count] {
            let source = source as usize;
            let at = (plane, self.x, self.y);
            sum += self.views.weights[source]
                * self
                    .level
                    .cost(simd, &self.patch, at, &self.level.sources[source]);
            if sum >= limit {
                break;
            }
        }
        sum
    }

    /// Depths from anywhere in the range, and planes of pixels farther off than the regions reach: a thin part before a
    /// background that coarser levels took for the surface is found again.
    #[inline(always)]
    pub fn restart<S: Simd>(&mut self, simd: S, other: &Color, dice: Dice, turn: Turn) {
        let mut dice = dice.beside();
        let [low, high] = self.level.range;
        for _ in 0..turn.draws.max(u32::from(self.cost > 0.5)) {
            let plane = Plane {
                inverse_depth: low + (high - low) * dice.unit(),
                slope: [0.0; 2],
            };
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
    #[inline(always)]
    fn far_off(&self, other: &Color, dx: i32, dy: i32) -> Option<Plane> {
        let (width, height) = (self.level.picture.width, self.level.picture.height);
        let dx = if (dx + dy) % 2 == 0 { dx + 1 } else { dx };
        let column = usize::try_from(self.x as i32 + dx)
            .ok()
            .filter(|&column| column < width)?;
        let row = usize::try_from(self.y as i32 + dy)
            .ok()
            .filter(|&row| row < height)?;
        let plane = other.planes[row * width.div_ceil(2) + column / 2];
        Some(plane.moved(-dx as f32, -dy as f32))
    }

    /// Random changes of depth, slope and both, then the vertex of a parabola.
    #[inline(always)]
    pub fn refine<S: Simd>(&mut self, simd: S, mut dice: Dice, turn: Turn) {
        let Changes {
            depth,
            slope,
            by_depth,
            by_slope,
        } = turn.changes(self.level);
        self.challenge(simd, self.changed(&mut dice, depth, 0.0));
        self.challenge(simd, self.changed(&mut dice, 0.0, slope));
        self.challenge(simd, self.changed(&mut dice, 0.5 * depth, 0.5 * slope));
        self.descend(simd, by_depth, |plane, by| Plane {
            inverse_depth: plane.inverse_depth + by,
            ..plane
        });
        let across = (turn.visit & 1) as usize;
        self.descend(simd, by_slope, |mut plane, by| {
            plane.slope[across] += by;
            plane
        });
    }

    #[inline(always)]
    fn changed(&self, dice: &mut Dice, depth: f32, slope: f32) -> Plane {
        let mut plane = self.plane;
        plane.inverse_depth += depth * dice.signed();
        for (slope_px, focal) in plane.slope.iter_mut().zip(self.level.raster.focal) {
            *slope_px += slope * dice.signed() * plane.inverse_depth * (1.0 / focal);
        }
        plane
    }

    /// A step to the vertex of the parabola through the costs here and a little to both sides.
    #[inline(always)]
    fn descend<S: Simd>(&mut self, simd: S, by: f32, changed: impl Fn(Plane, f32) -> Plane) {
        let (middle, cost) = (self.plane, self.cost);
        let before = self.cost_of(simd, changed(middle, -by), f32::INFINITY);
        let after = self.cost_of(simd, changed(middle, by), f32::INFINITY);
        let bend = before + after - 2.0 * cost;
        let vertex = if bend > 1e-6 && bend.is_finite() {
            (0.5 * (before - after) * (1.0 / bend)).clamp(-2.0, 2.0)
        } else if before < after {
            -1.0
        } else {
            1.0
        };
        self.challenge(simd, changed(middle, vertex * by));
    }
}

/// A hypothesis and the cost from which on it does not matter.
struct Judgement<'a, 'b, 'c, S> {
    simd: S,
    contest: &'a Contest<'b, 'c>,
    plane: Plane,
    limit: f32,
}

impl<S: Simd> NullaryFnOnce for Judgement<'_, '_, '_, S> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        self.contest.judged(self.simd, self.plane, self.limit)
    }
}
