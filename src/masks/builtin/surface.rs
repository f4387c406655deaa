//! What depth says of the pixels around one: which lie on its own surface, and where something thin stands before
//! something else.

use rayon::prelude::*;

use super::depth_edges::known;
use ostra_frames::DepthMap;

/// Relative depths this far apart are different surfaces.
const APART: f32 = 0.03;

/// The surfaces of a frame with depth.
pub(super) struct Surfaces {
    width: usize,
    height: usize,
    /// ln depth; NaN where unknown.
    ln_depth: Vec<f32>,
}

impl Surfaces {
    pub fn new(depth: &DepthMap) -> Self {
        let ln = |&depth: &f32| if known(depth) { depth.ln() } else { f32::NAN };
        Self {
            width: depth.width as usize,
            height: depth.height as usize,
            ln_depth: depth.depths.par_iter().map(ln).collect(),
        }
    }

    /// Whether nothing says that two pixels near each other lie on different surfaces.
    pub fn same(&self, a: usize, b: usize) -> bool {
        // An unknown depth makes this not a number, which says nothing.
        let apart = (self.ln_depth[a] - self.ln_depth[b]).abs();
        apart.is_nan() || apart <= APART
    }

    /// Mean over the pixels of the same surface in a `(2 · radius + 1)²` window.
    pub fn mean(&self, values: &[[f32; 3]], radius: usize) -> Vec<[f32; 3]> {
        let (width, height) = (self.width, self.height);
        let mut out = vec![[0.0; 3]; values.len()];
        out.par_chunks_exact_mut(width)
            .enumerate()
            .for_each(|(y, row)| {
                let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
                for (x, out) in row.iter_mut().enumerate() {
                    let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
                    let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
                    for line in rows.clone() {
                        let start = line * width + columns.start;
                        for (beside, value) in
                            values[start..start + columns.len()].iter().enumerate()
                        {
                            if self.same(y * width + x, start + beside) {
                                (0..3).for_each(|channel| sum[channel] += value[channel]);
                                count += 1.0;
                            }
                        }
                    }
                    *out = sum.map(|sum| sum / count);
                }
            });
        out
    }

    /// How much finer than elsewhere each pixel's surroundings are to be told apart: [`FINE`] where something much
    /// farther away is near in the picture, 1 elsewhere.
    pub fn fineness(&self) -> Vec<f32> {
        const FINE: f32 = 14.0;
        const REACH_PX: usize = 8;
        const BEHIND: f32 = 0.06;
        let farthest = self.farthest_within(REACH_PX);
        let fine = |(own, farthest): (&f32, &f32)| if farthest - own > BEHIND { FINE } else { 1.0 };
        self.ln_depth.par_iter().zip(&farthest).map(fine).collect()
    }

    /// Largest known ln depth in a `(2 · radius + 1)²` window; −∞ where none is known.
    fn farthest_within(&self, radius: usize) -> Vec<f32> {
        let width = self.width;
        let rows: Vec<f32> = (self.ln_depth.par_chunks_exact(width))
            .flat_map_iter(|row| {
                (0..width).map(move |x| {
                    largest(&row[x.saturating_sub(radius)..(x + radius + 1).min(width)])
                })
            })
            .collect();
        let mut out = vec![f32::NEG_INFINITY; rows.len()];
        out.par_chunks_exact_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                for line in y.saturating_sub(radius)..(y + radius + 1).min(self.height) {
                    let row = &rows[line * width..(line + 1) * width];
                    out.iter_mut()
                        .zip(row)
                        .for_each(|(out, value)| *out = out.max(*value));
                }
            });
        out
    }
}

/// The largest value that is a number.
fn largest(values: &[f32]) -> f32 {
    values.iter().copied().fold(f32::NEG_INFINITY, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stalk_before_a_wall() -> Surfaces {
        let depths = (0..60 * 20)
            .map(|at| {
                if (28..31).contains(&(at % 60)) {
                    0.9
                } else {
                    1.4
                }
            })
            .collect();
        Surfaces::new(&DepthMap {
            width: 60,
            height: 20,
            depths,
        })
    }

    #[test]
    fn colour_of_a_stalk_is_not_mixed_with_that_of_the_wall() {
        let surfaces = stalk_before_a_wall();
        let lab: Vec<[f32; 3]> = (0..60 * 20)
            .map(|at| {
                if (28..31).contains(&(at % 60)) {
                    [50.0; 3]
                } else {
                    [90.0; 3]
                }
            })
            .collect();
        assert_eq!(surfaces.mean(&lab, 3), lab);
    }

    #[test]
    fn what_is_thin_is_told_apart_finely_and_the_wall_is_not() {
        let fineness = stalk_before_a_wall().fineness();
        assert!(fineness[5 * 60 + 29] > 1.0);
        assert!(fineness[5 * 60 + 26] == 1.0 && fineness[5 * 60 + 5] == 1.0);
    }
}
