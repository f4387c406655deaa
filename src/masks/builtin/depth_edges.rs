//! Where depth jumps or a surface folds: edges that colour may not show.

use rayon::prelude::*;

use ostra_frames::DepthMap;

/// Strengths between 4-neighbours, 0–1, from depth alone; 0 where either depth is unknown.
pub(super) struct DepthEdges {
    pub right: Vec<f32>,
    pub down: Vec<f32>,
}

/// Relative depth step that is no edge yet, and the one that is a sure edge.
const STEP_RANGE: (f32, f32) = (0.008, 0.03);

/// Depth edges. A plane has linear inverse depth, so a step counts only as far as it differs from the slope on both
/// of its sides.
pub(super) fn depth_edges(depth: &DepthMap) -> DepthEdges {
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

/// Whether a depth value says anything.
pub(super) fn known(depth: f32) -> bool {
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
    fn jump_is_an_edge_and_unknown_is_none() {
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
    fn steep_plane_has_no_edge() {
        let edges = depth_edges(&map(20, 3, |x, _| 1.0 / (1.0 - 0.03 * x as f32)));
        assert!(edges.right.iter().all(|&strength| strength < 0.05));
    }
}
