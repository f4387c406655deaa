use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::stereo::DepthEstimate;
use crate::stereo::patchmatch::Texture;

/// When borders of surfaces move to changes of colour.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SnapOptions {
    /// Depths that differ by more than this share belong to two surfaces, above 0.
    pub surface_step: f32,
    /// Difference of colour (in grey levels) at which the fit of a pixel falls to `exp(−½)`, above 0.
    pub color_sigma: f32,
    /// Minimum number of fitting pixels of the other surface, each weighted by its fit.
    pub least_fit: f32,
    /// How many times better the other surface's colours must fit, above 1.
    pub better: f32,
}

impl Default for SnapOptions {
    fn default() -> Self {
        Self {
            surface_step: 0.05,
            color_sigma: 20.0,
            least_fit: 1.0,
            better: 2.0,
        }
    }
}

/// Reach of the window in which surfaces are compared by colour, in pixels.
const REACH: usize = 3;

/// Moves borders of surfaces to changes of colour in the image.
///
/// A pixel next to another surface takes the depth of that one if its colour fits much better.
/// Matching windows extend surfaces a pixel or two beyond their border and lose thin tips; colour
/// is more exact (after Z. Ma et al., *Constant Time Weighted Median Filtering for Stereo Matching
/// and Beyond*, ICCV 2013). The result must then be confirmed by other views.
#[must_use]
pub fn snapped(estimate: &DepthEstimate, image: &Texture, options: &SnapOptions) -> DepthEstimate {
    let chosen: Vec<Option<usize>> = (0..estimate.depths.len())
        .into_par_iter()
        .map(|at| better(estimate, image, at, options))
        .collect();
    let mut snapped = estimate.clone();
    for (at, from) in chosen.into_iter().enumerate() {
        if let Some(from) = from {
            snapped.depths[at] = estimate.depths[from];
            snapped.normals[at] = estimate.normals[from];
            snapped.confidence[at] = estimate.confidence[from];
        }
    }
    snapped
}

/// How well the colours of a surface's pixels fit.
#[derive(Default)]
struct ColorFit {
    sum: f32,
    pixels: f32,
}

impl ColorFit {
    fn add(&mut self, weight: f32) {
        self.sum += weight;
        self.pixels += 1.0;
    }

    fn mean(&self) -> f32 {
        self.sum / self.pixels.max(1.0)
    }
}

/// Returns the pixel whose depth a pixel takes; `None` if its own fits well enough.
fn better(
    estimate: &DepthEstimate,
    image: &Texture,
    at: usize,
    options: &SnapOptions,
) -> Option<usize> {
    let (width, height) = (estimate.width(), estimate.height());
    let (x, y) = (at % width, at / width);
    let same = |a: f32, b: f32| a.max(b) <= (1.0 + options.surface_step) * a.min(b);
    let own = estimate.depths[at];
    let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(width);
    let rows = y.saturating_sub(REACH)..(y + REACH + 1).min(height);
    let window = || {
        rows.clone()
            .flat_map(|row| columns.clone().map(move |column| row * width + column))
    };
    let others = || window().filter(|&to| to != at && estimate.depths[to] > 0.0);
    if others().all(|to| same(estimate.depths[to], own)) {
        return None;
    }
    let alike = |to: usize| {
        (-0.5 * image.color_difference(at, image, to) / (options.color_sigma * options.color_sigma))
            .exp()
    };
    let elsewhere = others().filter(|&to| !same(estimate.depths[to], own));
    let (best, _) = elsewhere
        .map(|to| (to, alike(to)))
        .reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let (mut here, mut there) = (ColorFit::default(), ColorFit::default());
    for to in others() {
        if same(estimate.depths[to], own) {
            here.add(alike(to));
        } else if same(estimate.depths[to], estimate.depths[best]) {
            there.add(alike(to));
        }
    }
    let fits = there.sum >= options.least_fit && there.mean() > options.better * here.mean();
    fits.then_some(best)
}
