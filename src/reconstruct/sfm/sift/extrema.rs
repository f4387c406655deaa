use super::rows::{MARGIN, Rows};
use pulp::{Arch, Simd, WithSimd};

/// A sample whose difference of Gaussians is above or below that of all its 26 neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Candidate {
    /// Column.
    pub x: usize,
    /// Row.
    pub y: usize,
    /// Its difference is between levels `level + 1` and `level`.
    pub level: usize,
}

/// Samples compared at a time.
const LANES: usize = 16;
/// Columns processed at a time, so that the differences stay in the first-level cache.
const TILE: usize = 256;
/// Share of the threshold that a sample must reach before its peak is fitted: the fit can only raise it.
const EARLY_SHARE: f32 = 0.8;

/// Differences of three rows of a tile, wider than the tile on either side; row `y` is at `y` modulo 3.
type Differences = [[f32; TILE + 2 * LANES]; 3];

/// Finds extrema in rows `first..last` of the differences of neighbouring levels.
pub(super) fn find_extrema(
    levels: &[Rows],
    first: usize,
    last: usize,
    peak_threshold: f32,
) -> Vec<Candidate> {
    let (width, height) = (levels[0].width, levels[0].height);
    let (first, last) = (first.max(1), last.min(height.saturating_sub(1)));
    let (arch, least) = (Arch::new(), peak_threshold * EARLY_SHARE);
    let mut found = Vec::new();
    let mut differences = vec![[[0.0; TILE + 2 * LANES]; 3]; levels.len() - 1];
    for at in (0..width).step_by(TILE) {
        for y in first.saturating_sub(1)..(last + 1).min(height) {
            arch.dispatch(Subtract {
                levels,
                at,
                y,
                differences: &mut differences,
            });
            if y > first {
                let differences = &differences;
                arch.dispatch(RowScan {
                    differences,
                    at,
                    y: y - 1,
                    width,
                    least,
                    found: &mut found,
                });
            }
        }
    }
    found.sort_unstable_by_key(|candidate| (candidate.y, candidate.x, candidate.level));
    found
}

/// Fills row `y` of every difference, from column `at - 1` on.
struct Subtract<'a> {
    levels: &'a [Rows],
    at: usize,
    y: usize,
    differences: &'a mut [Differences],
}

impl WithSimd for Subtract<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let start = MARGIN + self.at - 1;
        for (pair, difference) in self.levels.windows(2).zip(self.differences) {
            let [finer, coarser] =
                [&pair[0], &pair[1]].map(|level| &level.with_margins(self.y)[start..]);
            for ((out, &fine), &coarse) in difference[self.y % 3].iter_mut().zip(finer).zip(coarser)
            {
                *out = coarse - fine;
            }
        }
    }
}

/// Finds extrema of row `y` in the tile from column `at` on.
struct RowScan<'a> {
    differences: &'a [Differences],
    at: usize,
    y: usize,
    width: usize,
    least: f32,
    found: &'a mut Vec<Candidate>,
}

impl WithSimd for RowScan<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let columns = (self.width - self.at).min(TILE);
        for (k, around) in self.differences.windows(3).enumerate() {
            for start in (0..columns).step_by(LANES) {
                let mut hits = extreme_lanes(around, self.y, start, self.least);
                while hits != 0 {
                    let x = self.at + start + hits.trailing_zeros() as usize;
                    if x > 0 && x + 1 < self.width {
                        self.found.push(Candidate {
                            x,
                            y: self.y,
                            level: k + 1,
                        });
                    }
                    hits &= hits - 1;
                }
            }
        }
    }
}

/// Lowest and highest value around each lane.
struct Bounds {
    low: [f32; LANES],
    high: [f32; LANES],
}

/// Returns one bit for each sample from tile column `start` on that is extreme among its 26 neighbours.
#[inline(always)]
fn extreme_lanes(around: &[Differences], y: usize, start: usize, least: f32) -> u32 {
    let centre: [f32; LANES] = lanes(&around[1][y % 3], start + 1);
    if !centre
        .iter()
        .fold(false, |any, value| any | (value.abs() >= least))
    {
        return 0;
    }
    let mut bounds = Bounds {
        low: [f32::INFINITY; LANES],
        high: [f32::NEG_INFINITY; LANES],
    };
    widen(&around[1], y, start, true, &mut bounds);
    if extreme(&centre, &bounds, least) == 0 {
        return 0;
    }
    widen(&around[0], y, start, false, &mut bounds);
    widen(&around[2], y, start, false, &mut bounds);
    extreme(&centre, &bounds, least)
}

/// Widens the lower and upper bounds by the nine samples around each lane, or the eight without the centre.
#[inline(always)]
fn widen(
    difference: &Differences,
    y: usize,
    start: usize,
    without_centre: bool,
    bounds: &mut Bounds,
) {
    let Bounds { low, high } = bounds;
    for dy in 0..3 {
        for dx in 0..3 {
            if without_centre && dx == 1 && dy == 1 {
                continue;
            }
            let values = lanes(&difference[(y + dy + 2) % 3], start + dx);
            for (k, value) in values.into_iter().enumerate() {
                low[k] = if value < low[k] { value } else { low[k] };
                high[k] = if value > high[k] { value } else { high[k] };
            }
        }
    }
}

/// Returns one bit for each lane that lies outside its bounds and is at least `least` from zero, on the same side.
#[inline(always)]
fn extreme(centre: &[f32; LANES], bounds: &Bounds, least: f32) -> u32 {
    let Bounds { low, high } = bounds;
    let mut hits = 0;
    for k in 0..LANES {
        let above = (centre[k] > high[k]) & (centre[k] >= least);
        let below = (centre[k] < low[k]) & (centre[k] <= -least);
        hits |= u32::from(above | below) << k;
    }
    hits
}

#[inline(always)]
fn lanes(row: &[f32], start: usize) -> [f32; LANES] {
    row[start..].first_chunk().copied().unwrap_or_default()
}
