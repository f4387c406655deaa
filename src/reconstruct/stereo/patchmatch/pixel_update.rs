//! One update of a pixel: hypotheses are gathered and compared with its own.

use pulp::{NullaryFnOnce, Simd};

use super::level::{MAX_SOURCES, SearchLevel};
use super::plane::{Color, Hypothesis, Plane, WORST};
use super::random::Dice;
use super::views::{COMPARED, ViewWeights, choose_views};
use super::window::Patch;

/// Maximum distance of pixels whose planes are sampled, in pixels.
pub const FAR: f32 = 24.0;

/// Comparison of one pixel's hypotheses.
struct HypothesisTest<'a, 'b> {
    /// Level of the pyramid.
    pub level: &'a SearchLevel<'b>,
    /// The pixel's surroundings.
    pub patch: Patch,
    /// Column.
    pub x: f32,
    /// Row.
    pub y: f32,
    /// The sources with weight.
    pub views: ViewWeights,
    /// The best hypothesis so far.
    pub plane: Plane,
    /// Its cost.
    pub cost: f32,
}

impl HypothesisTest<'_, '_> {
    /// Replaces the best hypothesis by this one if it costs less.
    ///
    /// Returns the cost, or the sum so far if that is already too much.
    #[inline(always)]
    fn try_plane<S: Simd>(&mut self, simd: S, plane: Plane) -> f32 {
        let cost = self.cost_of(simd, plane, self.cost);
        if cost < self.cost {
            (self.plane, self.cost) = (plane, cost);
        }
        cost
    }

    /// Returns the cost over the sources with weight, or the sum so far if that reaches the limit.
    ///
    /// Compiled once, as it is called from many places.
    #[inline(always)]
    fn cost_of<S: Simd>(&self, simd: S, plane: Plane, limit: f32) -> f32 {
        simd.vectorize(CostBound {
            simd,
            test: self,
            plane,
            limit,
        })
    }

    #[inline(always)]
    fn judged<S: Simd>(&self, simd: S, plane: Plane, limit: f32) -> f32 {
        if !self.level.is_possible(plane, self.x, self.y) {
            return f32::INFINITY;
        }
        let (x, y) = (self.x, self.y);
        let hypothesis = Hypothesis { plane, x, y };
        let mut sum = self.level.pulled(&self.patch, hypothesis);
        for &source in &self.views.order[..self.views.count] {
            let source = source as usize;
            let cost = self
                .level
                .cost(simd, &self.patch, hypothesis, &self.level.sources[source]);
            sum += self.views.weights[source] * cost;
            if sum >= limit {
                break;
            }
        }
        sum
    }

    /// Tries random depths over the whole range, and planes of pixels beyond the reach of the regions.
    ///
    /// This recovers a thin part in front of a background that coarser levels took for the surface.
    #[inline(always)]
    pub fn restart<S: Simd>(&mut self, simd: S, other: &Color, dice: Dice, turn: SweepState) {
        let mut dice = dice.adjacent();
        let [low, high] = self.level.range;
        for _ in 0..turn.random_samples.max(u32::from(self.cost > 0.5)) {
            let plane = Plane {
                inverse_depth: low + (high - low) * dice.unit(),
                slope: [0.0; 2],
            };
            self.try_plane(simd, plane);
        }
        for _ in 0..turn.random_samples {
            let (dx, dy) = (FAR * dice.signed(), FAR * dice.signed());
            if let Some(plane) = self.far_off(other, dx as i32, dy as i32) {
                self.try_plane(simd, plane);
            }
        }
    }

    /// Returns the plane of a pixel of the other colour at about an offset.
    #[inline(always)]
    fn far_off(&self, other: &Color, dx: i32, dy: i32) -> Option<Plane> {
        let (width, height) = (self.level.image.width, self.level.image.height);
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

    /// Tries random changes of depth, slope and both, then the vertex of a parabola.
    #[inline(always)]
    pub fn refine<S: Simd>(&mut self, simd: S, mut dice: Dice, turn: SweepState) {
        let Changes {
            depth,
            slope,
            by_depth,
            by_slope,
        } = turn.changes(self.level);
        self.try_plane(simd, self.changed(&mut dice, depth, 0.0));
        self.try_plane(simd, self.changed(&mut dice, 0.0, slope));
        self.try_plane(simd, self.changed(&mut dice, 0.5 * depth, 0.5 * slope));
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

    /// Steps to the vertex of the parabola through the costs here and a little to both sides.
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
        self.try_plane(simd, changed(middle, vertex * by));
    }
}

/// A hypothesis, and the cost from which on it does not matter.
struct CostBound<'a, 'b, 'c, S> {
    simd: S,
    test: &'a HypothesisTest<'b, 'c>,
    plane: Plane,
    limit: f32,
}

impl<S: Simd> NullaryFnOnce for CostBound<'_, '_, '_, S> {
    type Output = f32;

    #[inline(always)]
    fn call(self) -> f32 {
        self.test.judged(self.simd, self.plane, self.limit)
    }
}

/// Progress of the search.
#[derive(Debug, Clone, Copy)]
pub struct SweepState {
    /// Counts all iterations of the view, for the random numbers.
    pub visit: u32,
    /// Iterations done at this level.
    pub iteration: u32,
    /// Maximum random change of depth, in steps of a pixel.
    pub reach: f32,
    /// Number of hypotheses sampled from the whole range, and as many from more distant pixels.
    pub random_samples: u32,
}

impl SweepState {
    /// Returns the cost below which a view sees the surface.
    pub fn good(self) -> f32 {
        0.8 - 0.03 * self.iteration.min(10) as f32
    }

    /// Returns how much the hypothesis of a pixel is changed at a level.
    pub fn changes(self, level: &SearchLevel<'_>) -> Changes {
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

/// How much a hypothesis is changed.
#[derive(Debug, Clone, Copy)]
pub struct Changes {
    /// Maximum random change of inverse depth.
    pub depth: f32,
    /// Maximum random change of slope, as a share.
    pub slope: f32,
    /// Step of the parabola along the inverse depth.
    pub by_depth: f32,
    /// Step of the parabola along the slope.
    pub by_slope: f32,
}

/// Input that updates of the pixels of one colour share.
#[derive(Clone, Copy)]
pub struct ColorUpdate<'a, 'b> {
    /// Level of the pyramid.
    pub level: &'a SearchLevel<'b>,
    /// Pixels of the other colour.
    pub other: &'a Color,
    /// Progress of the search.
    pub turn: SweepState,
}

/// Hypotheses of a pixel that differ.
struct Candidates {
    planes: [Plane; COMPARED],
    /// Number of gathered hypotheses that are nearly the same as each.
    times: [u32; COMPARED],
    /// Number of hypotheses.
    count: usize,
}

impl ColorUpdate<'_, '_> {
    /// Finds the best hypothesis for a pixel: its own, those of the other colour around it, and changed ones.
    ///
    /// The pixel must have something to compare. Every hypothesis is compared in all sources. Three
    /// cheaper ways together take a quarter less time (temple: 2.87 s a view instead of 3.74 on two
    /// cores) and find as many of the reference points of dtu and fountain, as exactly (`cargo bench
    /// --bench depths`):
    /// * only the first five distinct hypotheses compared in all sources, the others in the chosen
    ///   ones;
    /// * slopes sought by a parabola in consistent rounds only;
    /// * consistent rounds begun with the costs of the round before.
    ///
    /// But the demo from images alone then falls below its floors of 0.93 accuracy and 0.90 IoU of the
    /// leaves: from 0.938 to 0.929 by the first, to 0.914 by two, and to a leaf IoU of 0.86 by all
    /// three, probably because thin parts depend on hypotheses from farther away. Skipping sources
    /// whose cost alone already decides, with the same result to the bit, takes as long as computing
    /// all.
    #[inline(always)]
    pub fn update_pixel<S: Simd>(&self, simd: S, own: Plane, x: usize, y: usize) -> (Plane, f32) {
        let Self { level, other, turn } = *self;
        let patch = level.patch(x, y);
        let (u, v) = (x as f32, y as f32);
        let at_pixel = |plane: Plane| Hypothesis { plane, x: u, y: v };
        let hint = level.hint_for(&patch, x, y);
        let Candidates {
            planes,
            times,
            count,
        } = self.gather(own, hint, x, y);
        let mut costs = [[WORST; MAX_SOURCES]; COMPARED];
        for (costs, &plane) in costs.iter_mut().zip(&planes[..count]) {
            for (cost, source) in costs.iter_mut().zip(&level.sources) {
                *cost = level.cost(simd, &patch, at_pixel(plane), source);
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
        let mut test = HypothesisTest {
            level,
            patch,
            x: u,
            y: v,
            views,
            plane: own,
            cost: f32::INFINITY,
        };
        for (costs, &plane) in costs[..count].iter().zip(&planes) {
            let pulled = level.pulled(&test.patch, at_pixel(plane));
            let cost = views
                .weights
                .iter()
                .zip(costs)
                .fold(pulled, |sum, (weight, cost)| sum + weight * cost);
            if cost < test.cost {
                (test.plane, test.cost) = (plane, cost);
            }
        }
        let dice = Dice::new(
            level.options.seed,
            turn.visit,
            (y * level.image.width + x) as u32,
        );
        test.restart(simd, other, dice, turn);
        test.refine(simd, dice, turn);
        (test.plane, test.cost)
    }

    /// Gathers the pixel's own plane, those of the best pixels around, and one from elsewhere.
    ///
    /// Planes that are nearly the same are counted.
    #[inline(always)]
    fn gather(&self, own: Plane, hint: Option<Plane>, x: usize, y: usize) -> Candidates {
        let Self { level, other, .. } = *self;
        let mut planes = [own; COMPARED];
        let mut times = [1; COMPARED];
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
        Candidates {
            planes,
            times,
            count,
        }
    }
}

/// Returns the cost of a pixel's own hypothesis over its two best sources; `None` if there is nothing to compare.
#[inline(always)]
pub fn own_cost<S: Simd>(
    simd: S,
    level: &SearchLevel<'_>,
    own: Plane,
    x: usize,
    y: usize,
) -> Option<f32> {
    let patch = level.patch(x, y);
    if patch.is_empty(level.options.min_variance) {
        return None;
    }
    let own = Hypothesis {
        plane: own,
        x: x as f32,
        y: y as f32,
    };
    let mut least = [WORST; 2];
    for source in &level.sources {
        let cost = level.cost(simd, &patch, own, source);
        if cost < least[1] {
            least = [least[0].min(cost), least[0].max(cost)];
        }
    }
    let seen = if level.sources.len() > 1 {
        0.5 * (least[0] + least[1])
    } else {
        least[0]
    };
    Some((seen + level.pulled(&patch, own)).min(WORST))
}
