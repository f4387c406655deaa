//! Likelihood that an object ends between two pixels, from colour at three scales and depth.

use rayon::prelude::*;

use super::box_filter::box_mean;
use super::depth_surfaces::{DepthEdges, DepthSurfaces};
use crate::lab::squared_difference;

/// Strengths between 4-neighbours, 0 (none) to 1 (certain), with the raw colour steps.
pub(super) struct EdgeMap {
    /// Steps to the right neighbour; 0 in the last column.
    pub right: Vec<PixelStep>,
    /// Steps to the pixel below; 0 in the last row.
    pub down: Vec<PixelStep>,
}

/// A step between two neighbouring pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PixelStep {
    /// Colour difference of the two pixels, ΔE.
    pub fine: f32,
    /// Chance that an object ends here, 0–1.
    pub strength: f32,
}

/// Computes the edge strengths of an image in Lab.
///
/// Steps of 3-pixel and 7-pixel means on both sides are averaged and compared with their mean in
/// the surroundings. Texture therefore does not count as edges (surround suppression: Grigorescu,
/// Petkov and Westenberg, "Contour detection based on nonclassical receptive field inhibition", TIP
/// 2003). Where depth distinguishes surfaces, colours are taken from the surface itself and not
/// from the background beyond its border.
pub(super) fn edge_map(
    lab: &[[f32; 3]],
    width: usize,
    height: usize,
    depth: Option<(&DepthEdges, &DepthSurfaces)>,
) -> EdgeMap {
    let surfaces = depth.map(|(_, surfaces)| surfaces);
    let mean = |radius: usize| match surfaces {
        Some(surfaces) => surfaces.mean(lab, radius),
        None => box_mean(lab, width, height, radius),
    };
    let colours = Colours {
        lab,
        small: &mean(1),
        large: &mean(3),
        surfaces,
        width,
        height,
    };
    let steps = |dx: usize, dy: usize| {
        let mut out = vec![PixelStep::default(); lab.len()];
        out.par_chunks_exact_mut(width)
            .enumerate()
            .for_each(|(y, out)| {
                for (x, out) in out.iter_mut().enumerate() {
                    if x + dx < width && y + dy < height {
                        *out = colours.step_at([x, y], [dx, dy]);
                    }
                }
            });
        out
    };
    let (mut right, mut down) = (steps(1, 0), steps(0, 1));
    suppress_surround(&mut right, &mut down, width, height);
    if let Some((depth, _)) = depth {
        let add = |(step, &depth): (&mut PixelStep, &f32)| {
            step.strength = 1.0 - (1.0 - step.strength) * (1.0 - depth);
        };
        right.par_iter_mut().zip(&depth.right).for_each(add);
        down.par_iter_mut().zip(&depth.down).for_each(add);
    }
    EdgeMap { right, down }
}

/// Colours of an image at three scales.
struct Colours<'a> {
    lab: &'a [[f32; 3]],
    /// Means over windows of 3 pixels; `large` has those over 7.
    small: &'a [[f32; 3]],
    large: &'a [[f32; 3]],
    surfaces: Option<&'a DepthSurfaces>,
    width: usize,
    height: usize,
}

impl Colours<'_> {
    /// Returns the step between a pixel and its neighbour, `towards` columns and rows away.
    fn step_at(&self, pixel: [usize; 2], towards: [usize; 2]) -> PixelStep {
        let step = |plane: &[[f32; 3]], near: isize, far: isize| {
            let near = self.on_surface(pixel, towards, near);
            let far = self.on_surface(pixel, towards, far);
            squared_difference(plane[near], plane[far]).sqrt()
        };
        PixelStep {
            fine: step(self.lab, 0, 1),
            strength: 0.5 * step(self.small, -1, 2) + 0.5 * step(self.large, -3, 4),
        }
    }

    /// Returns the pixel `along` steps to the far (positive) or near side of an edge.
    fn shifted(&self, [x, y]: [usize; 2], [dx, dy]: [usize; 2], along: isize) -> usize {
        let shift = |at: usize, by: usize, end: usize| {
            (at as isize + by as isize * along).clamp(0, end as isize - 1)
        };
        let (x, y) = (shift(x, dx, self.width), shift(y, dy, self.height));
        y as usize * self.width + x as usize
    }

    /// Returns the farthest pixel, up to `along` steps away, on the surface next to an edge.
    fn on_surface(&self, pixel: [usize; 2], towards: [usize; 2], along: isize) -> usize {
        let shifted = |along: isize| self.shifted(pixel, towards, along);
        let Some(surfaces) = self.surfaces else {
            return shifted(along);
        };
        let base = shifted(along.signum().max(0));
        let mut steps = along;
        while steps.signum() == along.signum() && !surfaces.same(base, shifted(steps)) {
            steps -= along.signum();
        }
        if steps.signum() == along.signum() {
            shifted(steps)
        } else {
            base
        }
    }
}

/// Turns colour steps into strengths 0–1.
///
/// Each step is compared with the mean nearby and in the whole image.
fn suppress_surround(right: &mut [PixelStep], down: &mut [PixelStep], width: usize, height: usize) {
    const SURROUND_PX: usize = 16;
    const LEAST_STEP: f32 = 1.5;
    let both: Vec<[f32; 1]> = right
        .iter()
        .zip(&*down)
        .map(|(a, b)| [a.strength.max(b.strength)])
        .collect();
    let near = box_mean(&both, width, height, SURROUND_PX);
    let whole = both.iter().map(|[step]| f64::from(*step)).sum::<f64>() / both.len() as f64;
    let settle = |(step, [near]): (&mut PixelStep, &[f32; 1])| {
        let half = LEAST_STEP + 0.5 * whole as f32 + 0.8 * near;
        step.strength = step.strength / (step.strength + half);
    };
    right.par_iter_mut().zip(&near).for_each(settle);
    down.par_iter_mut().zip(&near).for_each(settle);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_borders_are_strong_and_texture_is_suppressed() {
        let (width, height) = (80usize, 40usize);
        let lab: Vec<[f32; 3]> = (0..width * height)
            .map(|at| match at % width {
                0..40 => [
                    30.0 + 8.0 * (((at * 2_654_435_761) >> 7) % 3) as f32,
                    0.0,
                    0.0,
                ],
                _ => [75.0, 10.0, 0.0],
            })
            .collect();
        let edges = edge_map(&lab, width, height, None);
        let row = 20 * width;
        let border = edges.right[row + 39].strength;
        let inside = (5..30)
            .map(|x| edges.right[row + x].strength)
            .fold(0.0, f32::max);
        assert!(
            border > 0.5 && inside < border * 0.7,
            "border {border}, texture {inside}"
        );
    }
}
