use std::sync::Arc;

use pulp::Simd;

use super::ncc::{self, Transfer};
use super::options::PatchMatchOptions;
use super::plane::{Plane, Raster};
use super::regions::Regions;
use super::search::Found;
use super::texture::Texture;
use super::window::{Patch, Window};

/// Source views at most.
pub const MAX_SOURCES: usize = 8;

/// A source view at one level of the pyramid.
#[derive(Debug, Clone)]
pub struct Source {
    /// From the reference to the source.
    pub transfer: Transfer,
    /// Its picture.
    pub texture: Arc<Texture>,
    /// What an earlier round found there, with the way back; `None` = not to be compared.
    pub found: Option<(Arc<Found>, Transfer)>,
}

/// All that the search of one view at one level looks at.
#[derive(Debug)]
pub struct Level<'a> {
    /// The reference picture.
    pub picture: Arc<Texture>,
    /// The reference camera at this level.
    pub raster: Raster,
    /// At most [`MAX_SOURCES`].
    pub sources: Vec<Source>,
    /// Smallest and largest inverse depth.
    pub range: [f32; 2],
    /// Change of inverse depth that moves the picture in a source by about a pixel.
    pub step: f32,
    /// Pixels to be worked on, row by row; `None` = all.
    pub allowed: Option<&'a [bool]>,
    /// A hypothesis of another view for each pixel, row by row (none = inverse depth 0); empty = none for any.
    pub hints: Vec<Plane>,
    /// Its options.
    pub options: &'a PatchMatchOptions,
    /// The window.
    pub window: &'a Window,
    /// The regions.
    pub regions: &'a Regions,
}

impl Level<'_> {
    /// Whether a hypothesis lies in range and faces the camera.
    #[inline(always)]
    pub fn is_possible(&self, plane: Plane, x: f32, y: f32) -> bool {
        let [low, high] = self.range;
        plane.inverse_depth >= low
            && plane.inverse_depth <= high
            && plane.is_facing(&self.raster, (x, y), self.options.min_facing)
    }

    /// Cost of a hypothesis in one source: `1 − NCC`, and forward-backward error where the source's depth is known.
    #[inline(always)]
    pub fn cost<S: Simd>(&self, simd: S, patch: &Patch, at: (Plane, f32, f32), source: &Source) -> f32 {
        let photometric = ncc::cost(simd, self.window, patch, at, &source.transfer, &source.texture);
        match &source.found {
            Some(found) if photometric < ncc::WORST => photometric + self.geometric_cost(at, source, found),
            _ => photometric,
        }
    }

    #[inline(always)]
    fn geometric_cost(&self, at: (Plane, f32, f32), source: &Source, found: &(Arc<Found>, Transfer)) -> f32 {
        let error = forward_backward(at, source, found).unwrap_or(f32::INFINITY);
        self.options.geometric_weight * error.min(self.options.max_geometric_px)
    }
}

/// Distance in pixels between a pixel and where the source's own depth, at the place where the source sees the pixel,
/// is seen; `None` outside and where the source has no depth.
#[inline(always)]
fn forward_backward(
    (plane, x, y): (Plane, f32, f32),
    source: &Source,
    (found, back): &(Arc<Found>, Transfer),
) -> Option<f32> {
    let [u, v, z] = source.transfer.apply(x, y, plane.inverse_depth);
    let scale = 1.0 / z;
    let (u, v) = (u * scale, v * scale);
    let (column, row) = ((u + 0.5) as usize, (v + 0.5) as usize);
    if column >= source.texture.width || row >= source.texture.height {
        return None;
    }
    let there = found.planes[row * source.texture.width + column];
    if there.inverse_depth <= 0.0 {
        return None;
    }
    let w = there.moved(u - column as f32, v - row as f32).inverse_depth;
    let [s, t, z] = back.apply(u, v, w);
    let scale = 1.0 / z;
    let (s, t) = (s * scale - x, t * scale - y);
    Some((s * s + t * t).sqrt())
}
