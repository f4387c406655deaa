//! Depth edges and surfaces of a frame.
//!
//! Edges are where depth jumps or a surface folds, which colour may not show. Surfaces show which
//! pixels around one belong together, and where a thin object is in front of another.

use rayon::prelude::*;

use ostra_frames::DepthMap;

/// Edge strengths between 4-neighbours from depth alone, 0–1; 0 where a depth is unknown.
pub(crate) struct DepthEdges {
    pub right: Vec<f32>,
    pub down: Vec<f32>,
}

/// Relative depth steps up to which there is no edge, and from which there certainly is one.
const STEP_RANGE: (f32, f32) = (0.008, 0.03);

/// Computes the depth edges.
///
/// A plane has linear inverse depth, so a step counts only as far as it differs from the slope on
/// both of its sides.
pub(crate) fn depth_edges(depth: &DepthMap) -> DepthEdges {
    let (width, height) = (depth.width as usize, depth.height as usize);
    let inverse: Vec<f32> = depth
        .depths
        .iter()
        .map(|&depth| if known(depth) { 1.0 / depth } else { 0.0 })
        .collect();
    let plane = |stride: usize, room: fn(usize, usize, usize, usize) -> bool| {
        let mut out = vec![0.0; inverse.len()];
        out.par_chunks_exact_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                for (x, out) in out.iter_mut().enumerate() {
                    if room(x, y, width, height) {
                        *out = strength_at(&inverse, y * width + x, stride);
                    }
                }
            });
        out
    };
    DepthEdges {
        right: plane(1, |x, _, width, _| x + 1 < width),
        down: plane(width, |_, y, _, height| y + 1 < height),
    }
}

/// Returns whether a depth value is known: positive and finite.
pub(crate) fn known(depth: f32) -> bool {
    depth > 0.0 && depth.is_finite()
}

fn strength_at(inverse: &[f32], at: usize, stride: usize) -> f32 {
    let value = |at: Option<usize>| {
        at.and_then(|at| inverse.get(at))
            .copied()
            .filter(|&value| value > 0.0)
    };
    let (Some(near), Some(far)) = (value(Some(at)), value(Some(at + stride))) else {
        return 0.0;
    };
    let step = far - near;
    let beyond_slope = |before: Option<f32>, from: f32, to: f32| {
        before.map_or(f32::INFINITY, |before| {
            ((to - from) - (from - before)).abs()
        })
    };
    let least = step
        .abs()
        .min(beyond_slope(value(at.checked_sub(stride)), near, far))
        .min(beyond_slope(value(Some(at + 2 * stride)), far, near));
    let relative = least / near.max(far);
    ((relative - STEP_RANGE.0) / (STEP_RANGE.1 - STEP_RANGE.0)).clamp(0.0, 1.0)
}

/// Maximum difference of ln depth within one surface.
const APART: f32 = 0.03;

/// Surfaces of a frame with depth.
pub(super) struct DepthSurfaces {
    width: usize,
    height: usize,
    /// ln depth; NaN where unknown.
    ln_depth: Vec<f32>,
}

impl DepthSurfaces {
    pub fn new(depth: &DepthMap) -> Self {
        let ln = |&depth: &f32| if known(depth) { depth.ln() } else { f32::NAN };
        Self {
            width: depth.width as usize,
            height: depth.height as usize,
            ln_depth: depth.depths.par_iter().map(ln).collect(),
        }
    }

    /// Returns whether two nearby pixels may lie on the same surface.
    pub fn same(&self, a: usize, b: usize) -> bool {
        // An unknown depth gives NaN and does not separate the pixels.
        let apart = (self.ln_depth[a] - self.ln_depth[b]).abs();
        apart.is_nan() || apart <= APART
    }

    /// Returns the mean over pixels of the same surface in a `(2 · radius + 1)²` window.
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
                        for (adjacent, value) in
                            values[start..start + columns.len()].iter().enumerate()
                        {
                            if self.same(y * width + x, start + adjacent) {
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

    /// Returns how much finer than elsewhere the surroundings of each pixel are resolved.
    ///
    /// The value is `FINE` where something much farther away is nearby in the image, and 1
    /// elsewhere.
    pub fn fineness(&self) -> Vec<f32> {
        const FINE: f32 = 14.0;
        const REACH_PX: usize = 8;
        const BEHIND: f32 = 0.06;
        let farthest = self.farthest_within(REACH_PX);
        let fine = |(own, farthest): (&f32, &f32)| if farthest - own > BEHIND { FINE } else { 1.0 };
        self.ln_depth.par_iter().zip(&farthest).map(fine).collect()
    }

    /// Returns the largest known ln depth in a `(2 · radius + 1)²` window; −∞ when none is known.
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

/// Returns the largest value that is not NaN.
fn largest(values: &[f32]) -> f32 {
    values.iter().copied().fold(f32::NEG_INFINITY, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: u32, height: u32, depth_at: impl Fn(u32, u32) -> f32) -> DepthMap {
        let depths = (0..width * height)
            .map(|at| depth_at(at % width, at / width))
            .collect();
        DepthMap {
            width,
            height,
            depths,
        }
    }

    #[test]
    fn depth_jump_is_an_edge_but_unknown_depth_is_not() {
        let edges = depth_edges(&map(10, 4, |x, y| match (x, y) {
            (_, 3) => 0.0,
            (0..5, _) => 0.9,
            _ => 1.1,
        }));
        assert_eq!(edges.right[4], 1.0);
        assert_eq!(edges.right[3], 0.0);
        assert_eq!(edges.right[34], 0.0);
        assert!(edges.down.iter().all(|&strength| strength == 0.0));
    }

    #[test]
    fn steep_plane_has_no_edges() {
        let edges = depth_edges(&map(20, 3, |x, _| 1.0 / (1.0 - 0.03 * x as f32)));
        assert!(edges.right.iter().all(|&strength| strength < 0.05));
    }

    fn stalk_before_a_wall() -> DepthSurfaces {
        let depths = (0..60 * 20)
            .map(|at| {
                if (28..31).contains(&(at % 60)) {
                    0.9
                } else {
                    1.4
                }
            })
            .collect();
        DepthSurfaces::new(&DepthMap {
            width: 60,
            height: 20,
            depths,
        })
    }

    #[test]
    fn mean_color_of_a_stalk_excludes_the_wall() {
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
    fn thin_stalk_is_resolved_finely_but_not_the_wall() {
        let fineness = stalk_before_a_wall().fineness();
        assert!(fineness[5 * 60 + 29] > 1.0);
        assert!(fineness[5 * 60 + 26] == 1.0 && fineness[5 * 60 + 5] == 1.0);
    }
}
