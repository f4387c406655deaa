use glam::{Vec2, Vec3};

use super::depth_view::{DepthView, Reprojection};
use super::options::Tolerance;
use ostra_core::job::{Progress, Stopped};
use ostra_frames::DepthMap;
use ostra_geometry::is_same_depth;

/// The nearest surface drawn at a pixel.
#[derive(Debug, Clone, Copy)]
pub struct NearestSurface {
    /// Depth in the target; infinite if nothing was drawn.
    pub depth: f32,
    /// Pixel of the source.
    pub from: u32,
}

impl NearestSurface {
    pub const NOTHING: Self = Self {
        depth: f32::INFINITY,
        from: 0,
    };
}

/// Half the largest side of a drawn pixel's footprint, in pixels.
const LARGEST_HALF: f32 = 3.0;
/// Relative depth difference above which neighbours lie on different surfaces.
const SAME_SURFACE: f32 = 0.03;

/// A source pixel projected to the target.
#[derive(Debug, Clone, Copy)]
struct ReprojectedPixel {
    at_px: Vec2,
    depth: f32,
    own_depth: f32,
}

/// Draws the surfaces of `source` as seen from `target`, the nearest on top.
///
/// `canvas` has one entry per target pixel. Surfaces seen from behind are skipped.
pub fn draw(
    source: &DepthView,
    target: &DepthView,
    canvas: &mut [NearestSurface],
    progress: &Progress,
) -> Result<(), Stopped> {
    let reprojection = Reprojection::new(&source.posed, &target.posed);
    let (width, height) = (source.width(), source.height());
    let zoom = (target.posed.camera.focal_px.x / source.posed.camera.focal_px.x) as f32;
    let see = |at: usize| {
        let point: Vec3 = source.point(at)?;
        let moved = reprojection.transform(point);
        let at_px = reprojection.project(moved).filter(|at| at.is_finite())?;
        Some(ReprojectedPixel {
            at_px,
            depth: moved.z,
            own_depth: point.z,
        })
    };
    let mut next: Vec<Option<ReprojectedPixel>> = (0..width).map(&see).collect();
    for row in 0..height {
        if row % 32 == 0 {
            progress.check()?;
        }
        let here = next;
        next = if row + 1 < height {
            (0..width).map(|x| see((row + 1) * width + x)).collect()
        } else {
            vec![None; width]
        };
        for x in 0..width {
            let Some(seen) = here[x] else { continue };
            let right = here.get(x + 1).copied().flatten();
            let Some(half) = footprint(seen, right, next[x], zoom) else {
                continue;
            };
            fill(canvas, target, seen, half, (row * width + x) as u32);
        }
    }
    Ok(())
}

/// Returns half the sides of a pixel's footprint; `None` for a surface seen from behind.
///
/// The footprint reaches the neighbours on the same surface.
fn footprint(
    seen: ReprojectedPixel,
    right: Option<ReprojectedPixel>,
    below: Option<ReprojectedPixel>,
    zoom: f32,
) -> Option<Vec2> {
    let same =
        |other: &ReprojectedPixel| is_same_depth(other.own_depth, seen.own_depth, SAME_SURFACE);
    let plain = Vec2::splat(0.5 * zoom * seen.own_depth / seen.depth);
    let half = match (right.filter(same), below.filter(same)) {
        (Some(right), Some(below)) => {
            let (across, down) = (right.at_px - seen.at_px, below.at_px - seen.at_px);
            if across.perp_dot(down) <= 0.0 {
                return None;
            }
            0.5 * across.abs().max(down.abs())
        }
        (None, None) => return None,
        _ => plain,
    };
    Some((half + 0.25).min(Vec2::splat(LARGEST_HALF)))
}

fn fill(
    canvas: &mut [NearestSurface],
    target: &DepthView,
    seen: ReprojectedPixel,
    half: Vec2,
    from: u32,
) {
    let (low, high) = (seen.at_px - half, seen.at_px + half);
    let (width, height) = (target.width(), target.height());
    if high.x < 0.0 || high.y < 0.0 || low.x >= width as f32 || low.y >= height as f32 {
        return;
    }
    let (left, right) = (low.x.max(0.0) as usize, (high.x as usize).min(width - 1));
    let (top, bottom) = (low.y.max(0.0) as usize, (high.y as usize).min(height - 1));
    for row in top..=bottom {
        for drawn in &mut canvas[row * width + left..=row * width + right] {
            if seen.depth < drawn.depth {
                *drawn = NearestSurface {
                    depth: seen.depth,
                    from,
                };
            }
        }
    }
}

/// Fills holes in a depth map with surfaces seen from other frames.
///
/// A hole is filled where two frames agree, or where only one frame sees it.
#[derive(Debug)]
pub struct DepthCompletion<'a> {
    view: &'a DepthView,
    tolerance: Tolerance,
    /// Pixels without depth, ascending.
    holes: Vec<u32>,
    /// Depths drawn at each hole.
    drawn: Vec<Vec<f32>>,
}

impl<'a> DepthCompletion<'a> {
    pub fn new(view: &'a DepthView, tolerance: Tolerance) -> Self {
        let depths = view.depth.depths.iter().zip(0..);
        let holes: Vec<u32> = depths
            .filter(|&(&depth, _)| depth <= 0.0)
            .map(|(_, at)| at)
            .collect();
        let drawn = vec![Vec::new(); holes.len()];
        Self {
            view,
            tolerance,
            holes,
            drawn,
        }
    }

    /// Draws another frame's surfaces.
    pub fn add(&mut self, source: &DepthView, progress: &Progress) -> Result<(), Stopped> {
        let mut canvas = vec![NearestSurface::NOTHING; self.view.rays.len()];
        draw(source, self.view, &mut canvas, progress)?;
        for (&hole, drawn) in self.holes.iter().zip(&mut self.drawn) {
            let depth = canvas[hole as usize].depth;
            if depth < f32::INFINITY {
                drawn.push(depth);
            }
        }
        Ok(())
    }

    pub fn finish(mut self) -> DepthMap {
        let mut filled = (*self.view.depth).clone();
        for (&hole, drawn) in self.holes.iter().zip(&mut self.drawn) {
            filled.depths[hole as usize] = agreed(drawn, &self.tolerance);
        }
        filled
    }
}

/// Returns the median of the largest group of agreeing depths; 0 if there is none.
///
/// Of equally large groups, the nearest one counts.
fn agreed(depths: &mut [f32], tolerance: &Tolerance) -> f32 {
    depths.sort_by(f32::total_cmp);
    let (mut most, mut middle) = (0, 0.0);
    for (first, &depth) in depths.iter().enumerate() {
        let limit = depth + 2.0 * tolerance.at(depth);
        let count = depths[first..]
            .iter()
            .take_while(|&&other| other <= limit)
            .count();
        if count > most {
            (most, middle) = (count, depths[first + count / 2]);
        }
    }
    if most >= depths.len().min(2) {
        middle
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_of_the_largest_agreeing_group_is_chosen() {
        let tolerance = Tolerance::new(0.01, 1.0);
        assert_eq!(agreed(&mut [], &tolerance), 0.0);
        assert_eq!(agreed(&mut [0.7], &tolerance), 0.7);
        assert_eq!(
            agreed(&mut [0.7, 1.2], &tolerance),
            0.0,
            "two that contradict each other"
        );
        assert_eq!(agreed(&mut [1.21, 0.7, 1.2], &tolerance), 1.21);
        assert_eq!(
            agreed(&mut [1.2, 0.7, 1.2, 0.701], &tolerance),
            0.701,
            "the nearer of two equally large groups"
        );
    }
}
