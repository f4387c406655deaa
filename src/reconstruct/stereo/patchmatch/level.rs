//! One level of the pyramid: all input of its search, and the regions around its pixels.

use std::sync::Arc;

use pulp::Simd;

use super::plane::{Color, Hypothesis, Plane, Raster, Transfer, WORST};
use super::posed_image::{PosedImage, Texture};
use super::search_input::{DepthSearch, PatchMatchOptions, PlaneMap};
use super::window::{Patch, SupportWindow};
use ostra_core::statistics::upper_median;

/// Maximum number of source views.
pub const MAX_SOURCES: usize = 8;

/// A source view at one level of the pyramid.
#[derive(Debug, Clone)]
pub struct LevelSource {
    /// Transfer from the reference to the source.
    pub transfer: Transfer,
    /// Its image.
    pub texture: Arc<Texture>,
    /// Planes that an earlier round found there; `None` = not compared.
    pub found: Option<FoundPlanes>,
}

/// Planes that an earlier round found in a source.
#[derive(Debug, Clone)]
pub struct FoundPlanes {
    /// The planes.
    pub planes: Arc<PlaneMap>,
    /// Transfer from the source to the reference.
    pub back: Transfer,
}

/// Prior knowledge of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlanePrior {
    /// A hypothesis from elsewhere; inverse depth 0 = none.
    pub plane: Plane,
    /// Whether the surface here is known from the surroundings; missing texture is then no evidence against it.
    pub is_known: bool,
}

/// Hints pull up to this many pixels away.
const PULL_REACH_PX: f32 = 2.0;

/// All input of the search of one view at one level.
#[derive(Debug)]
pub struct SearchLevel<'a> {
    /// The reference image.
    pub image: Arc<Texture>,
    /// The reference camera at this level.
    pub raster: Raster,
    /// At most [`MAX_SOURCES`].
    pub sources: Vec<LevelSource>,
    /// Smallest and largest inverse depth.
    pub range: [f32; 2],
    /// Change of inverse depth that moves the image in a source by about a pixel.
    pub step: f32,
    /// Pixels to process, row by row; `None` = all.
    pub allowed: Option<&'a [bool]>,
    /// Known data of each pixel, row by row; empty = nothing is known.
    pub hints: Vec<PlanePrior>,
    /// Cost of a flat patch that differs from its hint by [`Self::pull_reach`] or more; 0 if hints do not pull.
    pub pull: f32,
    /// Its options.
    pub options: &'a PatchMatchOptions,
    /// The window.
    pub window: &'a SupportWindow,
    /// The regions around its pixels.
    pub regions: Regions,
}

impl SearchLevel<'_> {
    /// Prepares a pixel's surroundings for comparison.
    #[inline(always)]
    pub fn patch(&self, x: usize, y: usize) -> Patch {
        let is_known = self
            .hints
            .get(y * self.image.width + x)
            .is_some_and(|hint| hint.is_known);
        Patch::new(self.window, &self.image, x, y).on(is_known)
    }

    /// Returns a pixel's hypothesis from elsewhere, if it has one.
    ///
    /// A hypothesis from the surrounding surface is only used if the patch is flat.
    #[inline(always)]
    pub fn hint_for(&self, patch: &Patch, x: usize, y: usize) -> Option<Plane> {
        let counts = self.pull <= 0.0 || patch.flatness > 0.0;
        self.hints
            .get(y * self.image.width + x)
            .filter(|_| counts)
            .map(|hint| hint.plane)
    }

    /// Returns the change of inverse depth beyond which the pull of hints does not increase.
    pub fn pull_reach(&self) -> f32 {
        PULL_REACH_PX * self.step
    }

    /// Returns the cost of a hypothesis' difference from a pixel's hint, if its patch is flat.
    #[inline(always)]
    pub fn pulled(&self, patch: &Patch, hypothesis: Hypothesis) -> f32 {
        let Hypothesis { plane, x, y } = hypothesis;
        let most = patch.flatness * self.pull;
        if most <= 0.0 {
            return 0.0;
        }
        let hint = self.hints[y as usize * self.image.width + x as usize].plane;
        let off = (plane.inverse_depth - hint.inverse_depth).abs() * (1.0 / self.pull_reach());
        (most * off).min(most)
    }

    /// Returns whether a hypothesis lies in range and faces the camera.
    #[inline(always)]
    pub fn is_possible(&self, plane: Plane, x: f32, y: f32) -> bool {
        let [low, high] = self.range;
        plane.inverse_depth >= low
            && plane.inverse_depth <= high
            && plane.is_facing(&self.raster, x, y, self.options.min_facing)
    }

    /// Returns the cost of a hypothesis in one source.
    ///
    /// It is `1 − NCC`, plus the forward-backward error if the source's depth is known.
    #[inline(always)]
    pub fn cost<S: Simd>(
        &self,
        simd: S,
        patch: &Patch,
        hypothesis: Hypothesis,
        source: &LevelSource,
    ) -> f32 {
        let photometric = patch.cost(
            simd,
            self.window,
            hypothesis,
            &source.transfer,
            &source.texture,
        );
        match &source.found {
            Some(found) if photometric < WORST => {
                photometric + self.geometric_cost(hypothesis, source, found)
            }
            _ => photometric,
        }
    }

    #[inline(always)]
    fn geometric_cost(
        &self,
        hypothesis: Hypothesis,
        source: &LevelSource,
        found: &FoundPlanes,
    ) -> f32 {
        let error = forward_backward(hypothesis, source, found).unwrap_or(f32::INFINITY);
        self.options.geometric_weight * error.min(self.options.max_geometric_px)
    }
}

/// Returns the distance in pixels between a pixel and its projection to the source and back, by the source's own depth.
///
/// `None` outside the source and where it has no depth.
#[inline(always)]
fn forward_backward(
    hypothesis: Hypothesis,
    source: &LevelSource,
    found: &FoundPlanes,
) -> Option<f32> {
    let Hypothesis { plane, x, y } = hypothesis;
    let [u, v, z] = source.transfer.apply(x, y, plane.inverse_depth);
    let scale = 1.0 / z;
    let (u, v) = (u * scale, v * scale);
    // Processors convert to signed 32 bits.
    let (column, row) = ((u + 0.5).max(0.0) as i32, (v + 0.5).max(0.0) as i32);
    let (width, height) = (source.texture.width, source.texture.height);
    if column as usize >= width || row as usize >= height {
        return None;
    }
    let there = found.planes.planes[row as usize * width + column as usize];
    if there.inverse_depth <= 0.0 {
        return None;
    }
    let w = there.moved(u - column as f32, v - row as f32).inverse_depth;
    let [s, t, z] = found.back.apply(u, v, w);
    let scale = 1.0 / z;
    let (s, t) = (s * scale - x, t * scale - y);
    Some((s * s + t * t).sqrt())
}

/// Maximum number of pixels per region.
const MOST: usize = 11;

/// Eight regions around a pixel: four V-shaped near ones and four far strips.
///
/// All lie on the other colour of the checkerboard (Q. Xu and W. Tao, *Multi-Scale Geometric
/// Consistency Guided Multi-View Stereo*, CVPR 2019).
#[derive(Debug, Clone)]
pub struct Regions {
    regions: [Vec<RegionPixel>; 8],
    width: usize,
    height: usize,
    /// Maximum reach of a region in columns and rows.
    reach: usize,
}

/// A pixel of a region.
#[derive(Debug, Clone, Copy)]
struct RegionPixel {
    /// Offset in columns and rows.
    offset: (i32, i32),
    /// The same offset among the pixels of a colour, from even and from odd columns.
    steps: [isize; 2],
}

impl Regions {
    /// Creates the regions around pixels of an image.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        let near: Vec<(i32, i32)> = vec![(0, 1), (1, 2), (-1, 2), (2, 3), (-2, 3), (3, 4), (-3, 4)];
        let far: Vec<(i32, i32)> = (0..MOST as i32).map(|step| (0, 3 + 2 * step)).collect();
        let half = width.div_ceil(2) as isize;
        let place = |(dx, dy): (i32, i32)| {
            let step = |odd: isize| dy as isize * half + (dx as isize + odd).div_euclid(2);
            RegionPixel {
                offset: (dx, dy),
                steps: [step(0), step(1)],
            }
        };
        let turned = |offsets: &[(i32, i32)], quarter: usize| {
            let turn = |&(x, y): &(i32, i32)| [(x, y), (y, x), (x, -y), (-y, x)][quarter];
            offsets.iter().map(turn).map(place).collect::<Vec<_>>()
        };
        let regions =
            std::array::from_fn(|region| turned(if region < 4 { &near } else { &far }, region % 4));
        Self {
            regions,
            width,
            height,
            reach: 2 * MOST + 1,
        }
    }

    /// Returns the pixel of least cost in each region, as its offset and its index among the pixels of its colour.
    #[inline(always)]
    pub fn best(&self, other: &Color, x: usize, y: usize) -> [Option<(i32, i32, usize)>; 8] {
        let (reach, width, height) = (self.reach, self.width, self.height);
        let is_far_in = x >= reach && y >= reach && x + reach < width && y + reach < height;
        let from = y * width.div_ceil(2) + x / 2;
        std::array::from_fn(|region| {
            let (mut best, mut least) = (0, f32::INFINITY);
            for (
                number,
                &RegionPixel {
                    offset: (dx, dy),
                    steps,
                },
            ) in self.regions[region].iter().enumerate()
            {
                let (column, row) = (x as i32 + dx, y as i32 + dy);
                let is_within =
                    || column >= 0 && row >= 0 && column < width as i32 && row < height as i32;
                if !is_far_in && !is_within() {
                    continue;
                }
                // Without a branch, which could not be predicted.
                let cost = other.costs[from.wrapping_add_signed(steps[x % 2])];
                best = if cost < least { number } else { best };
                least = least.min(cost);
            }
            let RegionPixel {
                offset: (dx, dy),
                steps,
            } = self.regions[region][best];
            (least < f32::INFINITY).then(|| (dx, dy, from.wrapping_add_signed(steps[x % 2])))
        })
    }
}

/// Prepares a level of the pyramid, 0 = the finest.
pub fn level<'a>(
    search: &DepthSearch<'_>,
    number: usize,
    options: &'a PatchMatchOptions,
    window: &'a SupportWindow,
    allowed: Option<&'a [bool]>,
) -> SearchLevel<'a> {
    let reference = search.reference;
    let comparable = search
        .sources
        .iter()
        .filter(|source| source.levels.len() > number);
    let sources: Vec<LevelSource> = comparable
        .take(MAX_SOURCES)
        .map(|source| LevelSource {
            transfer: reference.transfer(source, number),
            texture: Arc::clone(&source.levels[number]),
            found: None,
        })
        .collect();
    let [near, far] = search.depth_range.map(|depth| (1.0 / depth) as f32);
    let image = Arc::clone(&reference.levels[number]);
    let centre = [0.5 * image.width as f32, 0.5 * image.height as f32];
    let step = pixel_step(&sources, centre, 0.5 * (near + far));
    SearchLevel {
        regions: Regions::new(image.width, image.height),
        image,
        raster: reference.raster(number),
        sources,
        range: [far, near],
        step,
        allowed,
        hints: Vec::new(),
        pull: 0.0,
        options,
        window,
    }
}

/// Returns the change of inverse depth that moves the middle of the image by a pixel in the median source.
fn pixel_step(sources: &[LevelSource], [x, y]: [f32; 2], w: f32) -> f32 {
    let change = 1e-3 * w;
    let seen = |source: &LevelSource, w: f32| {
        let [u, v, z] = source.transfer.apply(x, y, w);
        [u / z, v / z]
    };
    let step = |source: &LevelSource| {
        let (a, b) = (seen(source, w), seen(source, w + change));
        change / (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-6)
    };
    let mut steps: Vec<f32> = sources
        .iter()
        .map(step)
        .filter(|step| step.is_finite())
        .collect();
    upper_median(&mut steps).unwrap_or(change)
}

/// Returns the pixels of a level that contain a pixel of the finest level to process.
pub fn coarse_mask(allowed: &[bool], image: &PosedImage, number: usize) -> Vec<bool> {
    let (width, height) = image.size();
    let level = &image.levels[number];
    let mut coarse = vec![false; level.width * level.height];
    for (at, _) in allowed
        .iter()
        .enumerate()
        .filter(|(_, allowed)| **allowed)
        .take(width * height)
    {
        let (x, y) = ((at % width) >> number, (at / width) >> number);
        if x < level.width && y < level.height {
            coarse[y * level.width + x] = true;
        }
    }
    coarse
}
