use super::depth_view::{DepthView, PixelBox};
use super::options::Tolerance;
use ostra_core::statistics::upper_median;
use ostra_frames::DepthMap;
use ostra_masks::{LabelId, LabelMask};

/// Largest depth slope within one surface, relative to a plane seen at 45°.
const STEEPEST: f32 = 4.0;
/// Maximum number of pixels without depth between a patch and its neighbour.
const WALK: usize = 3;
/// Half width, in pixels, up to which a patch is taken for a lost rim or tip.
const HALF_WIDTH: usize = 4;
/// Maximum distance, in pixels, between a patch and the label's other parts.
const REACH: usize = 16;

/// Background depth at pixels of a label where the depth map lost a thin part or its rim.
///
/// Depth maps from stereo show this effect.
#[derive(Debug)]
pub struct DepthLeak {
    /// Background depths at pixels of labels in front of them; 0 elsewhere.
    shown: Vec<f32>,
    limits: Limits,
}

/// Thresholds at which two depths belong to different surfaces.
#[derive(Debug, Clone, Copy)]
struct Limits {
    tolerance: Tolerance,
    focal: f32,
}

/// Pixels of one label that form one surface.
struct SurfacePatch {
    label: LabelId,
    around: PixelBox,
    depth: f32,
    /// Outline positions where the surface continues without the label.
    leaks: usize,
    /// Outline positions where a surface lies farther behind.
    fronts: usize,
    pixels: Vec<usize>,
}

impl Limits {
    fn jump(&self, depth: f32, pixels: usize) -> f32 {
        self.tolerance.at(depth) + STEEPEST * depth / self.focal * pixels as f32
    }
}

impl DepthLeak {
    /// Finds patches of a label that continue as one surface outside it.
    ///
    /// Other parts of the label nearby must lie in front of that surface.
    pub fn find(view: &DepthView, mask: &LabelMask, tolerance: Tolerance) -> Self {
        let focal = view.posed.camera.focal_px.x as f32;
        let limits = Limits { tolerance, focal };
        let patches = patches(view, mask, &limits);
        let mut shown = vec![0.0; mask.ids.len()];
        let (front, uncertain): (Vec<&SurfacePatch>, Vec<&SurfacePatch>) =
            patches.iter().partition(|patch| patch.fronts > patch.leaks);
        for patch in uncertain
            .into_iter()
            .filter(|patch| patch.pixels.len() <= HALF_WIDTH * patch.leaks)
        {
            let around = patch.around.grown(REACH, view.width(), view.height());
            let stands_before = |other: &&SurfacePatch| {
                other.label == patch.label
                    && other.depth < patch.depth - limits.jump(patch.depth, 1)
                    && other.around.meets(&around)
            };
            if front.iter().any(stands_before) {
                patch
                    .pixels
                    .iter()
                    .for_each(|&at| shown[at] = view.depth.depths[at]);
            }
        }
        Self { shown, limits }
    }

    /// Returns the depth map without the leaks.
    pub fn without_leaks(&self, depth: &DepthMap) -> DepthMap {
        let kept = depth
            .depths
            .iter()
            .zip(&self.shown)
            .map(|(&depth, &shown)| if shown > 0.0 { 0.0 } else { depth });
        DepthMap {
            depths: kept.collect(),
            ..*depth
        }
    }

    /// Removes filled-in depths that are not nearer than the leak they replace.
    pub fn check(&self, filled: &mut DepthMap) {
        for (depth, &shown) in filled.depths.iter_mut().zip(&self.shown) {
            if shown > 0.0 && *depth > shown - self.limits.jump(shown, 1) {
                *depth = 0.0;
            }
        }
    }
}

fn patches(view: &DepthView, mask: &LabelMask, limits: &Limits) -> Vec<SurfacePatch> {
    let depths = &view.depth.depths;
    let mut seen = vec![false; depths.len()];
    let mut patches = Vec::new();
    for start in 0..depths.len() {
        if !seen[start] && mask.ids[start] != LabelId::NONE && depths[start] > 0.0 {
            patches.push(patch(view, mask, limits, start, &mut seen));
        }
    }
    patches
}

/// Grows the patch that contains a pixel.
fn patch(
    view: &DepthView,
    mask: &LabelMask,
    limits: &Limits,
    start: usize,
    seen: &mut [bool],
) -> SurfacePatch {
    let (width, depths, label) = (view.width(), &view.depth.depths, mask.ids[start]);
    let around = PixelBox::pixel(start % width, start / width);
    let mut patch = SurfacePatch {
        label,
        around,
        depth: 0.0,
        leaks: 0,
        fronts: 0,
        pixels: vec![start],
    };
    seen[start] = true;
    let mut next = 0;
    while let Some(&at) = patch.pixels.get(next) {
        next += 1;
        patch.around = patch.around.union(&PixelBox::pixel(at % width, at / width));
        for (to, steps) in (0..4).filter_map(|side| adjacent(view, mask, at, side)) {
            let step = depths[to] - depths[at];
            let goes_on = step.abs() <= limits.jump(depths[at], steps);
            if mask.ids[to] != label {
                patch.leaks += usize::from(goes_on);
                patch.fronts += usize::from(!goes_on && step > 0.0);
            } else if goes_on && steps == 1 && !seen[to] {
                seen[to] = true;
                patch.pixels.push(to);
            }
        }
    }
    let mut known: Vec<f32> = patch.pixels.iter().map(|&at| depths[at]).collect();
    patch.depth = upper_median(&mut known).unwrap_or(0.0);
    patch
}

/// Returns the next pixel with depth on one of four sides, and its distance in steps.
fn adjacent(view: &DepthView, mask: &LabelMask, at: usize, side: usize) -> Option<(usize, usize)> {
    let (width, height) = (view.width(), view.height());
    let (x, y) = (at % width, at / width);
    let label = mask.ids[at];
    for steps in 1..=WALK {
        let to = match side {
            0 => (x + steps < width).then(|| at + steps),
            1 => (x >= steps).then(|| at - steps),
            2 => (y + steps < height).then(|| at + steps * width),
            _ => (y >= steps).then(|| at - steps * width),
        }?;
        if view.depth.depths[to] > 0.0 {
            return Some((to, steps));
        }
        if steps == 1 && mask.ids[to] == label {
            return None;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::reprojection::depth_view::CalibratedView;
    use ostra_geometry::{Camera, Pose};

    /// A leaf of 30 × 4 pixels at depth 1 in front of a wall at depth 2.
    ///
    /// From column `lost` on, the leaf's depth is lost.
    fn leaf_before_wall(lost: usize) -> (DepthView, LabelMask) {
        let (width, height) = (60, 20);
        let is_leaf =
            |at: usize| (10..40).contains(&(at % width)) && (8..12).contains(&(at / width));
        let depth = |at: usize| {
            if is_leaf(at) && at % width < lost {
                1.0
            } else {
                2.0
            }
        };
        let depth = DepthMap {
            width: 60,
            height: 20,
            depths: (0..width * height).map(depth).collect(),
        };
        let mut mask = LabelMask::empty(60, 20);
        (0..width * height)
            .filter(|&at| is_leaf(at))
            .for_each(|at| mask.ids[at] = LabelId(3));
        let posed = CalibratedView {
            camera: Camera::pinhole(60, 20, [60.0, 60.0], [30.0, 10.0]),
            camera_from_world: Pose::IDENTITY,
        };
        (
            DepthView {
                posed,
                depth: Arc::new(depth),
                rays: Arc::default(),
            },
            mask,
        )
    }

    #[test]
    fn wall_depth_at_a_lost_leaf_tip_is_removed() {
        let (view, mask) = leaf_before_wall(30);
        let leak = DepthLeak::find(&view, &mask, Tolerance::new(0.02, 1.5));
        let without_leaks = leak.without_leaks(&view.depth);
        let lost = |at: usize| mask.ids[at] != LabelId::NONE && at % 60 >= 30;
        let is_right = |(at, (&now, &before)): (usize, (&f32, &f32))| {
            now == if lost(at) { 0.0 } else { before }
        };
        assert!(
            without_leaks
                .depths
                .iter()
                .zip(&view.depth.depths)
                .enumerate()
                .all(is_right)
        );
        let mut filled = DepthMap {
            depths: vec![1.9; 1200],
            ..without_leaks
        };
        leak.check(&mut filled);
        assert_eq!(
            (filled.depths[10 * 60 + 35], filled.depths[10 * 60 + 25]),
            (0.0, 1.9)
        );
    }

    #[test]
    fn label_flat_on_a_wall_keeps_its_depth() {
        let (view, mask) = leaf_before_wall(0);
        let leak = DepthLeak::find(&view, &mask, Tolerance::new(0.02, 1.5));
        assert_eq!(leak.without_leaks(&view.depth), *view.depth);
    }
}
