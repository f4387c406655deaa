use glam::Vec2;
use rayon::prelude::*;

use super::patches::Patch;
use super::plane::Flow;
use super::pyramid::{Level, Pyramid};
use super::variational::smoothed;

/// Side of a patch, in pixels.
pub(super) const PATCH: usize = 8;
/// Pixels from one patch to the next.
const STRIDE: usize = 4;
/// Pictures with no longer side are always searched at full size.
const SMALL: usize = 320;
/// Rows of patches that are searched one after the other, each from what the one before found.
const BAND: usize = 8;

/// The size at which a search for optical flow ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Finest {
    /// Half of the pictures' size: quick, but parts thinner than some eight pixels go with what lies behind them.
    Half,
    /// The pictures' own size, at four times the work.
    Full,
}

/// Where the pixels of the first picture lie in the second: dense inverse search (Kroeger, Timofte, Dai, Van Gool,
/// "Fast optical flow using dense inverse search", ECCV 2016), from the smallest level of the pyramids to `finest` (small
/// pictures: to full size), smoothed at every level. Both pyramids are of one size.
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
    let grid = Grid::new(from);
    let found = grid.search(from, to, start);
    smoothed(from, to, &grid.densified(from, to, &found))
}

/// Top-left pixels of the patches: rows and columns of them, the last ones at the border.
struct Grid {
    columns: Vec<usize>,
    rows: Vec<usize>,
}

impl Grid {
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

    /// A displacement for every patch, row by row of patches.
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
            sweep(
                &patches,
                found,
                columns,
                to,
                (0..patches.len()).collect(),
                -1,
            );
            sweep(
                &patches,
                found,
                columns,
                to,
                (0..patches.len()).rev().collect(),
                1,
            );
        });
        found
    }

    /// A vector for every pixel: the mean over the patches that hold it, by how well each fits there.
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

/// Visits patches in order; each begins at the best of its own displacement and those of the neighbours just visited,
/// which lie one patch `towards` the left and above (−1) or the right and below (1).
fn sweep(
    patches: &[Patch],
    found: &mut [Vec2],
    columns: usize,
    to: &Level,
    order: Vec<usize>,
    towards: isize,
) {
    for at in order {
        let patch = &patches[at];
        let beside = at
            .checked_add_signed(towards)
            .filter(|&other| other / columns == at / columns);
        let over = at.checked_add_signed(towards * columns as isize);
        let mut best = found[at];
        let mut least = patch.cost(to, best);
        for neighbour in [beside, over].into_iter().flatten() {
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

/// The grey level of the second picture where a pixel of the first lies after its displacement.
pub(super) fn interpolated(level: &Level, x: usize, y: usize, displacement: Vec2) -> f32 {
    let x = (x as f32 + displacement.x).clamp(-1.0, level.width as f32);
    let y = (y as f32 + displacement.y).clamp(-1.0, level.height as f32);
    let (left, top) = (x.floor(), y.floor());
    let (u, v) = (x - left, y - top);
    let at = level.place(left as isize, top as isize);
    let row = |at: usize| level.padded[at] * (1.0 - u) + level.padded[at + 1] * u;
    row(at) * (1.0 - v) + row(at + level.stride) * v
}
