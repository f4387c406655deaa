use std::sync::{Arc, Mutex, PoisonError};

use glam::DVec2;

use super::surfaces::{SurfacePartitions, VoxelClick, VoxelSet};
use super::voxels::ColoredView;
use crate::reprojection::{
    DepthCompletion, DepthView, PixelBox, ReprojectionOptions, Tolerance, edge_affinity,
    label_scores,
};
use ostra_cloud::SceneError;
use ostra_core::job::Progress;
use ostra_frames::Image;
use ostra_masks::{
    AnswerSize, Click, MaskError, PreparedFrame, Prompt, Region, SegmentRequest, squared_depth_in,
};

/// Maximum distance between a click and the surface it selects, in pixels.
const NEAR_PX: i64 = 40;
/// Radius around a click that follows the click in any case, in pixels.
const AT_PX: f64 = 3.0;
/// Width, in sides of a voxel, below which an object is left to the image segmenter.
const LEAST_SIDES: f32 = 3.0;

/// Reason for leaving an object to the image segmenter.
const THIN: &str = "a thin or small object";

/// A frame with the voxel of every pixel, and the image segmenter's version of it.
pub struct FrameBodies {
    surfaces: Arc<SurfacePartitions>,
    prepared: Arc<dyn PreparedFrame>,
    image: Arc<Image>,
    /// Depths, with holes filled from other frames; 0 where unknown.
    depths: Vec<f32>,
    tolerance: Tolerance,
    options: ReprojectionOptions,
    focal_px: f32,
    /// The voxel at each pixel.
    seen: Vec<Option<u32>>,
    /// Results of the last clicks, in order; most requests repeat them and add one click.
    answered: Mutex<Vec<Answered>>,
}

/// A click, given those before it.
struct Answered {
    click: Click,
    /// `None` if no known surface is near.
    given: Option<VoxelClick>,
    /// Region of this click and those before it; `None` if no answer is an object.
    region: Option<Arc<Region>>,
}

impl FrameBodies {
    /// Prepares a frame; the first of `views` is the frame itself.
    ///
    /// `picture` is the same frame, prepared by the segmenter for single images.
    pub fn new(
        surfaces: Arc<SurfacePartitions>,
        views: &[ColoredView],
        prepared: Arc<dyn PreparedFrame>,
        progress: &Progress,
    ) -> Result<Self, SceneError> {
        let ColoredView { view, image } = &views[0];
        let options = ReprojectionOptions::default();
        let tolerance = Tolerance::most(view, &options);
        let mut completion = DepthCompletion::new(view, tolerance);
        for other in &views[1..] {
            completion.add(&other.view, progress)?;
        }
        let full = DepthView {
            depth: Arc::new(completion.finish()),
            ..view.clone()
        };
        let world = full.to_world();
        let voxel = |at: usize| surfaces.voxels.at(world(full.point(at)?));
        let seen = (0..image.pixels.len()).map(voxel).collect();
        let (depths, focal_px) = (
            full.depth.depths.clone(),
            view.posed.camera.focal_px.x as f32,
        );
        Ok(Self {
            surfaces,
            prepared,
            image: image.clone(),
            depths,
            tolerance,
            options,
            focal_px,
            seen,
            answered: Mutex::default(),
        })
    }

    /// Returns the region of the clicks.
    ///
    /// # Errors
    /// The reason, if after one of the clicks none is near a known surface, no answer is an object, or
    /// the object is thin.
    pub fn solid(&self, clicks: &[Click]) -> Result<Region, &'static str> {
        let kept = || self.answered.lock().unwrap_or_else(PoisonError::into_inner);
        let mut answered = std::mem::take(&mut *kept());
        let known = answered
            .iter()
            .zip(clicks)
            .take_while(|(answered, click)| answered.click == **click)
            .count();
        for (at, &click) in clicks.iter().enumerate().skip(known) {
            answered.truncate(at);
            let next = self.next(&answered, click);
            answered.push(next);
        }
        let regions: Vec<_> = answered[..clicks.len()]
            .iter()
            .skip_while(|answered| !answered.click.include)
            .map(|answered| answered.region.clone())
            .collect();
        *kept() = answered;
        // Clicks given together are judged as if they came one after the other: several thin objects
        // can be broad together. Clicks of other labels, which exclude, come first.
        let mut solid = None;
        for region in regions {
            let region = region.ok_or("no separate object was found here")?;
            if region.is_empty() {
                return Err("no surface with depth near the click");
            }
            if !self.is_broad(&region) {
                return Err(THIN);
            }
            solid = Some(region);
        }
        let region = solid.ok_or("no surface with depth near the click")?;
        Ok(Arc::unwrap_or_clone(region))
    }

    /// Computes the result of one more click.
    fn next(&self, before: &[Answered], click: Click) -> Answered {
        let region = before
            .last()
            .map_or_else(|| Some(self.nothing()), |last| last.region.clone());
        let Some((region, (at, voxel))) = region.clone().zip(self.surface_at(&click)) else {
            return Answered {
                click,
                given: None,
                region,
            };
        };
        let from = if click.include {
            &region.inverted()
        } else {
            &region
        };
        let depth_px = (squared_depth_in(from)[at] as f32).sqrt();
        let is_first = click.include && region.is_empty();
        let depth = if is_first {
            f32::INFINITY
        } else {
            depth_px * self.depths[at] / self.focal_px
        };
        let given = VoxelClick {
            voxel,
            include: click.include,
            depth,
        };
        let all: Vec<VoxelClick> = before
            .iter()
            .filter_map(|before| before.given)
            .chain([given])
            .collect();
        let region = match all.iter().any(|given| given.include) {
            true => self
                .surfaces
                .answer(&all)
                .map(|voxels| Arc::new(self.region(&voxels))),
            false => Some(region),
        };
        Answered {
            click,
            given: Some(given),
            region,
        }
    }

    fn nothing(&self) -> Arc<Region> {
        Arc::new(Region::empty(self.image.width, self.image.height))
    }

    fn is_broad(&self, region: &Region) -> bool {
        let least = 0.5 * LEAST_SIDES * self.surfaces.voxels.side * self.focal_px;
        let depths = squared_depth_in(region);
        depths
            .iter()
            .zip(&self.depths)
            .any(|(&squared, depth)| (squared as f32).sqrt() * depth > least)
    }

    /// Returns the pixel nearest to a click that has a voxel, and that voxel.
    fn surface_at(&self, click: &Click) -> Option<(usize, u32)> {
        let (width, height) = (i64::from(self.image.width), i64::from(self.image.height));
        let (x, y) = (click.at_px.x.floor() as i64, click.at_px.y.floor() as i64);
        let near = |at: i64, limit: i64| (at - NEAR_PX).max(0)..(at + NEAR_PX + 1).min(limit);
        let around =
            near(y, height).flat_map(|row| near(x, width).map(move |column| (column, row)));
        let known = around.filter_map(|(column, row)| {
            let at = (row * width + column) as usize;
            Some(((column - x).pow(2) + (row - y).pow(2), at, self.seen[at]?))
        });
        known.min().map(|(_, at, voxel)| (at, voxel))
    }

    /// Returns the pixels of the voxels.
    ///
    /// Pixels without a voxel are decided by the colours and depths around them.
    fn region(&self, voxels: &VoxelSet) -> Region {
        let (width, height) = (self.image.width as usize, self.image.height as usize);
        let mut region = Region::empty(self.image.width, self.image.height);
        let is_in = |at: &usize| self.seen[*at].is_some_and(|voxel| voxels.has(voxel));
        let pixels = (0..self.seen.len())
            .filter(is_in)
            .map(|at| PixelBox::pixel(at % width, at / width));
        let Some(within) = pixels.reduce(|a, b| a.union(&b)) else {
            return region;
        };
        let within = within.grown(self.options.margin_px, width, height);
        let edge_affinity = edge_affinity(
            &self.image,
            &self.depths,
            within,
            &self.tolerance,
            &self.options,
        );
        let vote = |at: usize| match self.seen[at] {
            None => [0.0, 0.0],
            Some(voxel) if voxels.has(voxel) => [1.0, 1.0],
            Some(_) => [-1.0, 1.0],
        };
        let places = (within.top..within.bottom)
            .flat_map(|y| y * width + within.left..y * width + within.right);
        let votes: Vec<[f32; 2]> = places.clone().map(vote).collect();
        for (at, share) in places.zip(label_scores(&votes, edge_affinity, &self.options)) {
            region.inside[at] = share > 0.0;
        }
        region
    }

    /// Returns whether a pixel lies at a click.
    fn is_at(&self, click: &Click, pixel: usize) -> bool {
        let width = self.image.width as usize;
        let centre = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        centre.distance(click.at_px) <= AT_PX
    }

    /// Applies the change from `before` to `after` to `previous`.
    fn changed(previous: &Region, before: &Region, after: &Region) -> Region {
        let change = |(at, &was): (usize, &bool)| {
            if was == after.inside[at] {
                previous.inside[at]
            } else {
                !was
            }
        };
        Region {
            inside: before.inside.iter().enumerate().map(change).collect(),
            ..*after
        }
    }
}

impl PreparedFrame for FrameBodies {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        progress: &Progress,
    ) -> Result<Region, MaskError> {
        let SegmentRequest {
            prompt,
            previous,
            taken,
        } = *request;
        let solid = self.solid(&prompt.clicks);
        let Some(after) = solid.ok().filter(|_| prompt.boxes.is_empty()) else {
            return self.prepared.segment(request, progress);
        };
        if prompt.size != AnswerSize::Automatic {
            return Err(MaskError::Request(
                "geometry has a single answer to a click; choose another segmenter for a smaller or larger one".into(),
            ));
        }
        let before = previous.and_then(|previous| {
            let (_, clicks) = prompt.clicks.split_last()?;
            Some((previous, self.solid(clicks).ok()?))
        });
        let mut answer = match before {
            Some((previous, before)) => Self::changed(previous, &before, &after),
            None => after,
        };
        if let Some(taken) = taken {
            answer.subtract(taken);
        }
        // Where geometry contradicts a click, the image segmenter decides the pixels at the click.
        // If no surface is known near the click, it also decides all pixels without a voxel.
        for (at, click) in prompt.clicks.iter().enumerate() {
            let pixel = click.pixel_in(answer.width, answer.height);
            if pixel.is_none_or(|pixel| answer.inside[pixel] != click.include) {
                let prompt = Prompt {
                    clicks: prompt.clicks[..=at].to_vec(),
                    ..Prompt::default()
                };
                let request = SegmentRequest {
                    prompt: &prompt,
                    previous: Some(&answer),
                    taken,
                };
                let requested = self.prepared.segment(&request, progress)?;
                let is_unknown = self.surface_at(click).is_none();
                let is_free =
                    |at: usize| self.is_at(click, at) || is_unknown && self.seen[at].is_none();
                for (at, inside) in answer
                    .inside
                    .iter_mut()
                    .enumerate()
                    .filter(|(at, _)| is_free(*at))
                {
                    *inside = requested.inside[at];
                }
            }
        }
        Ok(answer)
    }

    fn bytes(&self) -> usize {
        self.surfaces.bytes() + self.prepared.bytes() + self.seen.len() * 12
    }
}
