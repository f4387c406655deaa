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

/// What is known of a pixel before it is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hint {
    /// A hypothesis from elsewhere; inverse depth 0 = none.
    pub plane: Plane,
    /// What surface lies here is known from around: a flat patch is no reason for doubt.
    pub is_known: bool,
}

/// Hints pull up to so many pixels away.
const PULL_REACH_PX: f32 = 2.0;

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
    /// What is known of each pixel beforehand, row by row; empty = nothing of any.
    pub hints: Vec<Hint>,
    /// Cost of a flat patch that lies off its hint by [`Self::pull_reach`] or more; 0 where hints do not pull.
    pub pull: f32,
    /// Its options.
    pub options: &'a PatchMatchOptions,
    /// The window.
    pub window: &'a Window,
    /// The regions around its pixels.
    pub regions: Regions,
}

impl Level<'_> {
    /// A pixel's surroundings, made ready to be compared.
    #[inline(always)]
    pub fn patch(&self, x: usize, y: usize) -> Patch {
        let is_known = self
            .hints
            .get(y * self.picture.width + x)
            .is_some_and(|hint| hint.is_known);
        Patch::new(self.window, &self.picture, x, y).on(is_known)
    }

    /// A pixel's hypothesis from elsewhere, if it has one; of the surface around only where its patch is flat.
    #[inline(always)]
    pub fn hint_for(&self, patch: &Patch, x: usize, y: usize) -> Option<Plane> {
        let counts = self.pull <= 0.0 || patch.flatness > 0.0;
        self.hints
            .get(y * self.picture.width + x)
            .filter(|_| counts)
            .map(|hint| hint.plane)
    }

    /// Change of inverse depth beyond which hints do not pull more.
    pub fn pull_reach(&self) -> f32 {
        PULL_REACH_PX * self.step
    }

    /// Cost of how far a hypothesis lies off a pixel's hint, where its patch is flat.
    #[inline(always)]
    pub fn pulled(&self, patch: &Patch, (plane, x, y): (Plane, f32, f32)) -> f32 {
        let most = patch.flatness * self.pull;
        if most <= 0.0 {
            return 0.0;
        }
        let hint = self.hints[y as usize * self.picture.width + x as usize].plane;
        let off = (plane.inverse_depth - hint.inverse_depth).abs() * (1.0 / self.pull_reach());
        (most * off).min(most)
    }

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
    pub fn cost<S: Simd>(
        &self,
        simd: S,
        patch: &Patch,
        at: (Plane, f32, f32),
        source: &Source,
    ) -> f32 {
        let photometric = ncc::cost(
            simd,
            self.window,
            patch,
            at,
            &source.transfer,
            &source.texture,
        );
        match &source.found {
            Some(found) if photometric < ncc::WORST => {
                photometric + self.geometric_cost(at, source, found)
            }
            _ => photometric,
        }
    }

    #[inline(always)]
    fn geometric_cost(
        &self,
        at: (Plane, f32, f32),
        source: &Source,
        found: &(Arc<Found>, Transfer),
    ) -> f32 {
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
    // Signed 32 bits are what processors convert to.
    let (column, row) = ((u + 0.5).max(0.0) as i32, (v + 0.5).max(0.0) as i32);
    let (width, height) = (source.texture.width, source.texture.height);
    if column as usize >= width || row as usize >= height {
        return None;
    }
    let there = found.planes[row as usize * width + column as usize];
    if there.inverse_depth <= 0.0 {
        return None;
    }
    let w = there.moved(u - column as f32, v - row as f32).inverse_depth;
    let [s, t, z] = back.apply(u, v, w);
    let scale = 1.0 / z;
    let (s, t) = (s * scale - x, t * scale - y);
    Some((s * s + t * t).sqrt())
}
