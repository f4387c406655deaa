//! From prompts to an answer: every click changes one connected part of the previous answer.

use std::sync::Arc;

use super::appearance::Palette;
use super::box_prompt::{BoxOptions, object_in_box};
use super::candidates::{CandidateOptions, candidates};
use super::click_context::ClickContext;
use super::graph::RegionGraph;
use super::local_correction::Correction;
use super::ranking::{ChangeExtent, RankedCandidates, WEIGHTS, kind_of, terms};
use super::raster::Raster;
use crate::thin::follow;
use crate::{AnswerSize, Click, MaskError, PreparedFrame, Prompt, PxBox, Region, SegmentRequest};
use ostra_core::job::Progress;
use ostra_frames::Image;

/// A frame with everything computed that does not depend on a prompt.
pub(super) struct Prepared {
    pub raster: Raster,
    pub graph: RegionGraph,
    pub palette: Palette,
    /// The image, if there is no depth that could separate objects.
    pub flat: Option<FlatImage>,
}

/// An image without depth.
pub(super) struct FlatImage {
    pub image: Arc<Image>,
    /// The image in the size in which it is segmented; the same one where nothing is reduced.
    pub reduced: Arc<Image>,
}

impl FlatImage {
    fn bytes(&self) -> usize {
        let pixels = |image: &Arc<Image>| size_of_val(&*image.pixels);
        let is_same = Arc::ptr_eq(&self.image, &self.reduced);
        pixels(&self.image) + if is_same { 0 } else { pixels(&self.reduced) }
    }
}

impl PreparedFrame for Prepared {
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        _progress: &Progress,
    ) -> Result<Region, MaskError> {
        self.check(request)?;
        let SegmentRequest {
            prompt,
            previous,
            taken,
        } = *request;
        // If there is a previous answer, only the last click is new.
        if let Some(previous) = previous.filter(|_| !prompt.clicks.is_empty()) {
            return Ok(match self.flat.as_ref().filter(|_| prompt.corrects) {
                Some(flat) => self.corrected(&flat.image, previous, prompt, taken),
                None => self.refined(previous, &prompt.clicks, prompt.size, taken),
            });
        }
        let mut boxed = RegionQuery::new(self, taken);
        boxed.add_boxes(&prompt.boxes);
        let count = prompt.clicks.len();
        Ok((1..=count).fold(boxed.answer(), |answer, clicks| {
            let size = if clicks == count {
                prompt.size
            } else {
                AnswerSize::Automatic
            };
            self.refined(&answer, &prompt.clicks[..clicks], size, taken)
        }))
    }

    fn bytes(&self) -> usize {
        let image = self.flat.as_ref().map_or(0, FlatImage::bytes);
        self.raster.bytes() + self.graph.bytes() + self.palette.bytes() + image
    }
}

impl Prepared {
    /// Corrects `previous`, a mask that was not built from clicks, by the last click.
    ///
    /// The sizes of the answer are local corrections of growing depth, then changes of whole
    /// regions. The automatic one is the largest local correction, or the first change of regions
    /// if the click marks a leak.
    fn corrected(
        &self,
        image: &Image,
        previous: &Region,
        prompt: &Prompt,
        taken: Option<&Region>,
    ) -> Region {
        let correction = Correction {
            image,
            factor: self.raster.factor,
            mask: previous,
            clicks: &prompt.clicks,
            taken,
        };
        let first_of_regions = i32::from(!correction.marks_leak());
        let step = prompt.size.steps() - first_of_regions;
        let local = (step < 0).then(|| correction.local(step + 1)).flatten();
        local.unwrap_or_else(|| {
            let size = match step {
                ..=0 => AnswerSize::Automatic,
                1 => AnswerSize::Larger,
                _ => AnswerSize::Largest,
            };
            let mut answer = self.refined(previous, &prompt.clicks, size, taken);
            self.drop_slivers(previous, &prompt.clicks, &mut answer);
            answer
        })
    }

    /// Removes what an exclude click left of a leak along the border of the mask.
    ///
    /// The border of a leak follows no edge of the image. Regions that it crosses are mostly outside
    /// the mask, so that no cut changes them.
    fn drop_slivers(&self, previous: &Region, clicks: &[Click], answer: &mut Region) {
        if clicks.last().is_none_or(|click| click.include) {
            return;
        }
        let (before, after) = (self.raster.mostly(previous), self.raster.mostly(answer));
        let is_removed = |region: usize| before[region] && !after[region];
        let is_held = |region: usize| {
            let here = |click: &&Click| self.raster.region_at(click.at_px) as usize == region;
            clicks.iter().filter(here).any(|click| click.include)
        };
        let is_sliver = |region: usize| {
            let neighbours = self.graph.neighbours(region);
            !before[region]
                && neighbours.iter().any(|&(to, _)| is_removed(to as usize))
                && !is_held(region)
        };
        let slivers: Vec<bool> = (0..before.len()).map(is_sliver).collect();
        for (inside, &region) in answer.inside.iter_mut().zip(&self.raster.of_pixel) {
            *inside &= !slivers[region as usize];
        }
    }

    /// Refines `previous`, the answer to all clicks but the last, by the last click.
    fn refined(
        &self,
        previous: &Region,
        clicks: &[Click],
        size: AnswerSize,
        taken: Option<&Region>,
    ) -> Region {
        let mut query = RegionQuery::new(self, taken);
        query.start_from(previous);
        if let Some((last, earlier)) = clicks.split_last() {
            earlier
                .iter()
                .for_each(|click| query.add_known_click(click));
            let thin = match earlier {
                [] if previous.is_empty() => self.thin_answer(last, taken),
                _ => None,
            };
            if let Some(thin) = thin {
                if !query.add_click_beside(last, size, thin.area()) {
                    return thin;
                }
            } else {
                query.add_click(last, size);
            }
        }
        query.answer()
    }

    /// Returns the thin structure under the first click on an object, if there is a clear one.
    ///
    /// Regions of the graph are wider than a leaf, so that no cut between them follows it.
    fn thin_answer(&self, click: &Click, taken: Option<&Region>) -> Option<Region> {
        let flat = self.flat.as_ref().filter(|_| click.include)?;
        let at = self.raster.pixel_at(click.at_px);
        if taken.is_some_and(|taken| taken.inside[at]) {
            return None;
        }
        let Raster {
            width,
            height,
            factor,
            ..
        } = self.raster;
        let ribbon = follow(&flat.reduced, click.at_px / factor as f64)?;
        let mut region = ribbon.region(width as u32, height as u32, factor).ok()?;
        region.inside[at] = true;
        if let Some(taken) = taken {
            region.subtract(taken);
        }
        Some(region)
    }

    fn check(&self, request: &SegmentRequest<'_>) -> Result<(), MaskError> {
        let (width, height) = (self.raster.width, self.raster.height);
        if request.prompt.is_empty() {
            return Err(MaskError::Request(
                "there is no click and no box; click on the object first".into(),
            ));
        }
        let inside = |click: &Click| {
            let at = click.at_px;
            at.x >= 0.0 && at.y >= 0.0 && at.x < width as f64 && at.y < height as f64
        };
        if let Some(click) = request.prompt.clicks.iter().find(|click| !inside(click)) {
            return Err(MaskError::Request(format!(
                "the click at {}, {} lies outside the image of {width}×{height}; click inside it",
                click.at_px.x, click.at_px.y
            )));
        }
        let crosses = |part: &PxBox| {
            part.max_px.x > part.min_px.x.max(0.0)
                && part.max_px.y > part.min_px.y.max(0.0)
                && part.min_px.x < width as f64
                && part.min_px.y < height as f64
        };
        if let Some(part) = request.prompt.boxes.iter().find(|part| !crosses(part)) {
            return Err(MaskError::Request(format!(
                "the box from {}, {} to {}, {} holds no pixel of the image of {width}×{height}; draw it inside",
                part.min_px.x, part.min_px.y, part.max_px.x, part.max_px.y
            )));
        }
        let fits = |region: &Region| {
            region.width as usize == width
                && region.height as usize == height
                && region.inside.len() == width * height
        };
        if [request.previous, request.taken]
            .into_iter()
            .flatten()
            .all(fits)
        {
            Ok(())
        } else {
            Err(MaskError::Request(format!(
                "a mask given does not have the image's size of {width}×{height}"
            )))
        }
    }
}

/// An answer under construction.
pub(super) struct RegionQuery<'a> {
    raster: &'a Raster,
    graph: &'a RegionGraph,
    palette: &'a Palette,
    previous: Option<&'a Region>,
    taken: Option<&'a Region>,
    /// Regions mostly taken by other labels.
    closed: Vec<bool>,
    /// Whether each region is (mostly) in the answer.
    pub inside: Vec<bool>,
    /// Regions that a prompt decided; all others keep their pixels of the previous answer.
    decided: Vec<bool>,
    clicks: Vec<(Click, u32)>,
}

impl<'a> RegionQuery<'a> {
    pub fn new(frame: &'a Prepared, taken: Option<&'a Region>) -> Self {
        let Prepared {
            raster,
            graph,
            palette,
            ..
        } = frame;
        let count = graph.region_count();
        let closed = taken.map_or_else(|| vec![false; count], |taken| raster.mostly(taken));
        Self {
            raster,
            graph,
            palette,
            previous: None,
            taken,
            closed,
            inside: vec![false; count],
            decided: vec![false; count],
            clicks: Vec::new(),
        }
    }

    /// Starts from an earlier answer.
    pub fn start_from(&mut self, previous: &'a Region) {
        self.previous = Some(previous);
        self.inside = self.raster.mostly(previous);
    }

    /// Adds the object in each box.
    pub fn add_boxes(&mut self, boxes: &[PxBox]) {
        let factor = self.raster.factor as f64;
        for within in boxes {
            let within = PxBox {
                min_px: within.min_px / factor,
                max_px: within.max_px / factor,
            };
            let found = object_in_box(
                self.graph,
                self.palette,
                &self.closed,
                &within,
                &BoxOptions::default(),
            );
            self.apply(&found, true);
        }
    }

    /// Records an earlier click and enforces it where the initial answer contradicts it.
    pub fn add_known_click(&mut self, click: &Click) {
        let at = self.note(click);
        let holds = self.previous.is_some_and(|previous| {
            previous.inside[self.raster.pixel_at(click.at_px)] == click.include
        });
        if !holds && !self.closed[at] {
            self.inside[at] = click.include;
            self.decided[at] = true;
        }
    }

    /// Applies a new click: changes the answer around it if the answer contradicts it.
    pub fn add_click(&mut self, click: &Click, size: AnswerSize) {
        self.note_new_click(click);
        let change = self.context().and_then(|context| chosen(&context, size));
        if let Some(change) = change {
            self.apply(&change, click.include);
        }
    }

    /// Applies a new click for which there is an automatic answer of `area` pixels.
    ///
    /// Returns `false` without a change if that answer has the size.
    fn add_click_beside(&mut self, click: &Click, size: AnswerSize, area: usize) -> bool {
        if size == AnswerSize::Automatic {
            return false;
        }
        self.note_new_click(click);
        let area = area as f32 / self.raster.factor.pow(2) as f32;
        let change = self
            .context()
            .and_then(|context| chosen_beside(&context, size, area));
        let is_other = change.is_some();
        if let Some(change) = change {
            self.apply(&change, click.include);
        }
        is_other
    }

    /// Records a new click without applying it. From now on its whole region is on one side.
    pub fn note_new_click(&mut self, click: &Click) {
        let at = self.note(click);
        self.decided[at] |= !click.include || !self.closed[at];
    }

    fn note(&mut self, click: &Click) -> usize {
        let region = self.raster.region_at(click.at_px);
        let reduced = Click {
            at_px: click.at_px / self.raster.factor as f64,
            ..*click
        };
        self.clicks.push((reduced, region));
        region as usize
    }

    /// Marks regions as changed to the side of a click.
    pub fn apply(&mut self, change: &[bool], include: bool) {
        for (at, _) in change.iter().enumerate().filter(|(_, changes)| **changes) {
            self.inside[at] = include;
            self.decided[at] = true;
        }
    }

    /// Returns the context of the last click, or `None` if the click changes nothing.
    pub fn context(&self) -> Option<ClickContext<'_>> {
        let (click, region) = self.clicks.last()?;
        let at = *region as usize;
        let contested = self
            .clicks
            .iter()
            .any(|(other, there)| there == region && other.include != click.include);
        let changes = !self.closed[at] && !contested && self.inside[at] != click.include;
        changes
            .then(|| {
                ClickContext::new(
                    self.graph,
                    self.palette,
                    &self.clicks,
                    &self.inside,
                    &self.closed,
                )
            })
            .flatten()
    }

    /// Returns the answer as pixels.
    pub fn answer(self) -> Region {
        let (width, height) = (self.raster.width, self.raster.height);
        let mut answer = Region::empty(width as u32, height as u32);
        for (at, (out, &region)) in answer
            .inside
            .iter_mut()
            .zip(&self.raster.of_pixel)
            .enumerate()
        {
            let region = region as usize;
            *out = match self.previous {
                Some(previous) if !self.decided[region] => previous.inside[at],
                _ => self.inside[region],
            } && !self.taken.is_some_and(|taken| taken.inside[at]);
        }
        self.split_contested(&mut answer);
        answer
    }

    /// Splits each region that has clicks of both kinds: every pixel goes with the nearest click.
    fn split_contested(&self, answer: &mut Region) {
        let contested = |region: u32| {
            let here = || self.clicks.iter().filter(|(_, other)| *other == region);
            here().any(|(click, _)| click.include) && here().any(|(click, _)| !click.include)
        };
        let mut regions: Vec<u32> = self
            .clicks
            .iter()
            .map(|&(_, region)| region)
            .filter(|&at| contested(at))
            .collect();
        regions.sort_unstable();
        regions.dedup();
        if regions.is_empty() {
            return;
        }
        for (at, region) in self.raster.of_pixel.iter().enumerate() {
            if regions.contains(region) && !self.taken.is_some_and(|taken| taken.inside[at]) {
                let centre = glam::DVec2::new(
                    (at % self.raster.width) as f64 + 0.5,
                    (at / self.raster.width) as f64 + 0.5,
                ) / self.raster.factor as f64;
                let here = self.clicks.iter().filter(|(_, other)| other == region);
                let nearest = here.min_by(|(a, _), (b, _)| {
                    a.at_px
                        .distance_squared(centre)
                        .total_cmp(&b.at_px.distance_squared(centre))
                });
                answer.inside[at] = nearest.is_some_and(|(click, _)| click.include);
            }
        }
    }
}

/// Returns the change that the click most likely means, or one of another size.
fn chosen(context: &ClickContext<'_>, size: AnswerSize) -> Option<Vec<bool>> {
    change_by(context, |ranked, extents| {
        ranked.best_of_size(&WEIGHTS, extents, size)
    })
}

/// Returns the change of a size if the automatic answer has `area` pixels of the reduced image.
///
/// Returns `None` if that answer has the size.
fn chosen_beside(context: &ClickContext<'_>, size: AnswerSize, area: f32) -> Option<Vec<bool>> {
    change_by(context, |ranked, extents| {
        ranked.best_beside(&WEIGHTS, extents, area, size)
    })
}

/// Returns the candidate that `choose` picks by its index.
fn change_by(
    context: &ClickContext<'_>,
    choose: impl Fn(&RankedCandidates<'_>, &[ChangeExtent]) -> Option<usize>,
) -> Option<Vec<bool>> {
    let mut found = candidates(context, &CandidateOptions::default());
    let terms: Vec<_> = found
        .all
        .iter()
        .map(|candidate| terms(&candidate.features))
        .collect();
    let ranked = RankedCandidates {
        kind: kind_of(context),
        terms: &terms,
        shared: &found.shared,
    };
    let best = choose(&ranked, &found.extents(context))?;
    Some(found.all.swap_remove(best).change)
}
