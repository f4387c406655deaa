use glam::Vec2;
use rayon::prelude::*;
use wide::f32x8;

use super::plane::{Flow, Level, PAD, Pyramid, interpolated};
use super::variational::smoothed;

/// Side of a patch in pixels.
pub(super) const PATCH: usize = 8;
/// Distance between neighbouring patches in pixels.
const STRIDE: usize = 4;
/// Longer side, in pixels, up to which the search always goes to full resolution.
const SMALL: usize = 320;
/// Rows of patches that one thread searches in sequence.
///
/// Each row starts from the result of the previous one.
const BAND: usize = 8;

/// Pyramid level at which the optical flow search ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Finest {
    /// Half resolution. Fast, but parts thinner than about eight pixels follow their background.
    Half,
    /// Full resolution, at four times the cost.
    Full,
}

/// Estimates the optical flow from the first image to the second by dense inverse search.
///
/// The search runs from the coarsest pyramid level to `finest`, and smooths the flow at every
/// level. Small images are always searched to full resolution. Both pyramids must have the same
/// size.
///
/// Method: Kroeger, Timofte, Dai, Van Gool, "Fast optical flow using dense inverse search", ECCV
/// 2016.
pub(super) fn flow_between(first: &Pyramid, second: &Pyramid, finest: Finest) -> Flow {
    let full = &first.levels[0];
    let is_large = full.width.max(full.height) > SMALL && first.levels.len() > 1;
    let finest = usize::from(is_large && finest == Finest::Half);
    let mut flow = Flow {
        width: 1,
        height: 1,
        vectors: vec![Vec2::ZERO],
    };
    for (from, to) in first.levels[finest..]
        .iter()
        .zip(&second.levels[finest..])
        .rev()
    {
        let start = flow.resized(from.width, from.height);
        flow = if from.width < PATCH || from.height < PATCH {
            start
        } else {
            refined(from, to, &start)
        };
    }
    flow.resized(full.width, full.height)
}

fn refined(from: &Level, to: &Level, start: &Flow) -> Flow {
    let grid = PatchGrid::new(from);
    let found = grid.search(from, to, start);
    smoothed(from, to, &grid.densified(from, to, &found))
}

/// Top-left pixels of the patches, as columns and rows. The last ones touch the border.
struct PatchGrid {
    columns: Vec<usize>,
    rows: Vec<usize>,
}

impl PatchGrid {
    fn new(level: &Level) -> Self {
        let along = |side: usize| {
            let last = side - PATCH;
            let mut starts: Vec<usize> = (0..last).step_by(STRIDE).collect();
            starts.push(last);
            starts
        };
        Self {
            columns: along(level.width),
            rows: along(level.height),
        }
    }

    /// Returns the displacement of every patch, row by row.
    fn search(&self, from: &Level, to: &Level, start: &Flow) -> Vec<Vec2> {
        let columns = self.columns.len();
        let mut found = vec![Vec2::ZERO; columns * self.rows.len()];
        let bands = found
            .par_chunks_mut(columns * BAND)
            .zip(self.rows.par_chunks(BAND));
        bands.for_each(|(found, rows)| {
            let patches: Vec<Patch> = rows
                .iter()
                .flat_map(|&y| self.columns.iter().map(move |&x| (x, y)))
                .map(|(x, y)| Patch::new(from, x, y))
                .collect();
            let half = PATCH / 2;
            for (found, patch) in found.iter_mut().zip(&patches) {
                *found = start.at(patch.x + half, patch.y + half);
            }
            let search = PatchSearch {
                patches: &patches,
                columns,
                to,
            };
            search.sweep(found, 0..patches.len(), -1);
            search.sweep(found, (0..patches.len()).rev(), 1);
        });
        found
    }

    /// Returns one vector per pixel, averaged over the patches that cover it.
    ///
    /// Each patch is weighted by how well it fits at that pixel.
    fn densified(&self, from: &Level, to: &Level, found: &[Vec2]) -> Flow {
        let mut flow = Flow {
            width: from.width,
            height: from.height,
            vectors: vec![Vec2::ZERO; from.width * from.height],
        };
        flow.vectors
            .par_chunks_exact_mut(from.width)
            .enumerate()
            .for_each(|(y, out)| {
                let mut weights = vec![0.0f32; out.len()];
                let rows = self
                    .rows
                    .iter()
                    .enumerate()
                    .filter(|(_, top)| (**top..**top + PATCH).contains(&y));
                for (row, _) in rows {
                    for (column, &left) in self.columns.iter().enumerate() {
                        let vector = found[row * self.columns.len() + column];
                        for x in left..left + PATCH {
                            let weight = 1.0
                                / (interpolated(to, x, y, vector)
                                    - from.at(x as isize, y as isize))
                                .abs()
                                .max(1.0);
                            out[x] += vector * weight;
                            weights[x] += weight;
                        }
                    }
                }
                out.iter_mut()
                    .zip(&weights)
                    .for_each(|(vector, weight)| *vector /= *weight);
            });
        flow
    }
}

/// A band of patches of the first image, and the image that they are searched in.
struct PatchSearch<'a> {
    patches: &'a [Patch],
    /// Number of patches in a row.
    columns: usize,
    to: &'a Level,
}

impl PatchSearch<'_> {
    /// Visits the patches in order and refines each displacement.
    ///
    /// Each patch starts from the best of its own displacement and those of the two neighbours just
    /// visited. These lie one patch to the left and above (`towards` = −1), or to the right and
    /// below (`towards` = 1).
    fn sweep(&self, found: &mut [Vec2], order: impl Iterator<Item = usize>, towards: isize) {
        let Self {
            patches,
            columns,
            to,
        } = *self;
        for at in order {
            let patch = &patches[at];
            let adjacent = at
                .checked_add_signed(towards)
                .filter(|&other| other / columns == at / columns);
            let over = at.checked_add_signed(towards * columns as isize);
            let mut best = found[at];
            let mut least = patch.cost(to, best);
            for neighbour in [adjacent, over].into_iter().flatten() {
                let Some(&candidate) = found.get(neighbour) else {
                    continue;
                };
                let cost = patch.cost(to, candidate);
                if cost < least {
                    (best, least) = (candidate, cost);
                }
            }
            found[at] = patch.descend(to, best);
        }
    }
}

/// Maximum descent steps per patch and sweep.
const STEPS: usize = 8;
/// Step length, in pixels, below which the descent stops.
const STILL: f32 = 0.02;
const PIXELS: f32 = (PATCH * PATCH) as f32;

/// A square of the first image, prepared for the search in the second.
pub(super) struct Patch {
    pub x: usize,
    pub y: usize,
    grey: [f32x8; PATCH],
    slope_x: [f32x8; PATCH],
    slope_y: [f32x8; PATCH],
    mean_slope: Vec2,
    /// Inverse of the Hessian: xx, xy, yy. Zero if the patch has too little texture.
    inverse: [f32; 3],
}

/// Cost of a patch at a displacement, and its descent direction.
struct PatchFit {
    /// Sum of squared differences of grey levels after their mean difference is removed.
    cost: f32,
    slide: Vec2,
}

impl Patch {
    /// Prepares the patch whose top-left pixel is (x, y).
    pub fn new(level: &Level, x: usize, y: usize) -> Self {
        let row = |dx: isize, dy: isize, line: usize| {
            eight(
                &level.padded,
                level.place(x as isize + dx, (y + line) as isize + dy),
            )
        };
        let grey = std::array::from_fn(|line| row(0, 0, line));
        let half = f32x8::splat(0.5);
        let slope_x: [f32x8; PATCH] =
            std::array::from_fn(|line| (row(1, 0, line) - row(-1, 0, line)) * half);
        let slope_y: [f32x8; PATCH] =
            std::array::from_fn(|line| (row(0, 1, line) - row(0, -1, line)) * half);
        let sum = |a: &[f32x8; PATCH], b: &[f32x8; PATCH]| {
            a.iter()
                .zip(b)
                .fold(f32x8::ZERO, |sum, (&a, &b)| sum + a * b)
                .reduce_add()
        };
        let ones = [f32x8::ONE; PATCH];
        let mean_slope = Vec2::new(sum(&slope_x, &ones), sum(&slope_y, &ones)) / PIXELS;
        let xx = sum(&slope_x, &slope_x) - PIXELS * mean_slope.x * mean_slope.x;
        let xy = sum(&slope_x, &slope_y) - PIXELS * mean_slope.x * mean_slope.y;
        let yy = sum(&slope_y, &slope_y) - PIXELS * mean_slope.y * mean_slope.y;
        let determinant = xx * yy - xy * xy;
        let inverse = if determinant > 1.0 {
            [yy, -xy, xx].map(|h| h / determinant)
        } else {
            [0.0; 3]
        };
        Self {
            x,
            y,
            grey,
            slope_x,
            slope_y,
            mean_slope,
            inverse,
        }
    }

    /// Returns the mean-free sum of squared differences at this displacement.
    pub fn cost(&self, other: &Level, displacement: Vec2) -> f32 {
        self.fit(other, displacement).cost
    }

    /// Descends from `start` to a local minimum of the cost (inverse compositional).
    ///
    /// Returns `start` if the descent moves farther than one patch.
    pub fn descend(&self, other: &Level, start: Vec2) -> Vec2 {
        let mut best = start;
        let mut fit = self.fit(other, start);
        for _ in 0..STEPS {
            let next = best - fit.slide;
            if (next - start).length_squared() > (PATCH * PATCH) as f32 {
                return start;
            }
            let after = self.fit(other, next);
            if after.cost >= fit.cost {
                break;
            }
            let still = fit.slide.length_squared() < STILL * STILL;
            (best, fit) = (next, after);
            if still {
                break;
            }
        }
        best
    }

    fn fit(&self, other: &Level, displacement: Vec2) -> PatchFit {
        let reach = PAD as f32 - 2.0;
        let x =
            (self.x as f32 + displacement.x).clamp(-reach, (other.width - PATCH) as f32 + reach);
        let y =
            (self.y as f32 + displacement.y).clamp(-reach, (other.height - PATCH) as f32 + reach);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = (f32x8::splat(x - left), f32x8::splat(y - top));
        let mut place = other.place(left as isize, top as isize);
        let line = |place: usize| {
            let (a, b) = (eight(&other.padded, place), eight(&other.padded, place + 1));
            a + (b - a) * u
        };
        let mut above = line(place);
        let (mut sum, mut squares, mut along_x, mut along_y) =
            (f32x8::ZERO, f32x8::ZERO, f32x8::ZERO, f32x8::ZERO);
        for row in 0..PATCH {
            place += other.stride;
            let below = line(place);
            let difference = above + (below - above) * v - self.grey[row];
            sum += difference;
            squares += difference * difference;
            along_x += difference * self.slope_x[row];
            along_y += difference * self.slope_y[row];
            above = below;
        }
        let sum = sum.reduce_add();
        let pull = Vec2::new(along_x.reduce_add(), along_y.reduce_add()) - self.mean_slope * sum;
        let [xx, xy, yy] = self.inverse;
        let slide = Vec2::new(xx * pull.x + xy * pull.y, xy * pull.x + yy * pull.y);
        PatchFit {
            cost: squares.reduce_add() - sum * sum / PIXELS,
            slide,
        }
    }
}

/// Loads eight values, starting at `place`.
fn eight(values: &[f32], place: usize) -> f32x8 {
    let mut lanes = [0.0; 8];
    lanes.copy_from_slice(&values[place..place + 8]);
    f32x8::new(lanes)
}
