//! Prompts to a frame, and segmentation of everything in the image.

use glam::DVec2;

use super::decoder::MaskPrediction;
use super::frame::SamFrame;
use super::objects::Objects;
use super::part::ImagePart;
use crate::onnx::non_maximum_suppression::non_maximum_suppression;
use crate::{
    AnswerSize, Click, MaskError, PreparedFrame, Prompt, Proposal, PxBox, Region, SegmentRequest,
};
use ostra_core::job::Progress;

/// Options of [`SamFrame::everything`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EverythingOptions {
    /// Number of grid points along each side; each costs a run of the decoder.
    pub points_per_side: u32,
    /// Minimum predicted IoU of a mask, 0–1.
    pub least_score: f32,
    /// Minimum stability of a mask, 0–1.
    ///
    /// Stability is the share of a mask that remains when the threshold of its logits rises from
    /// −`offset` to `offset`.
    pub least_stability: f32,
    /// Offset of the logit threshold for the stability.
    pub offset: f32,
    /// Bounding-box IoU above which two masks are the same object, 0–1.
    pub most_overlap: f64,
}

impl Default for EverythingOptions {
    fn default() -> Self {
        Self {
            points_per_side: 16,
            least_score: 0.88,
            least_stability: 0.95,
            offset: 1.0,
            most_overlap: 0.7,
        }
    }
}

impl PreparedFrame for SamFrame {
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
        let mut region = self.found(prompt, previous, taken)?;
        prompt
            .clicks
            .iter()
            .for_each(|click| hold(&mut region, click));
        if let Some(taken) = taken {
            region.subtract(taken);
        }
        Ok(region)
    }

    fn proposals(&self, progress: &Progress) -> Result<Option<Vec<Proposal>>, MaskError> {
        self.everything(&EverythingOptions::default(), progress)
            .map(Some)
    }

    fn bytes(&self) -> usize {
        self.held_bytes()
    }
}

impl SamFrame {
    /// Returns masks of all objects in the image, highest score first.
    ///
    /// Every point of a grid is clicked. Of the masks with a sufficient score and stability, only
    /// the best of those with nearly the same bounding box is kept.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or the error of the network.
    pub fn everything(
        &self,
        options: &EverythingOptions,
        progress: &Progress,
    ) -> Result<Vec<Proposal>, MaskError> {
        let count = options.points_per_side;
        let part = self.part();
        let along = |first: u32, size: u32, at: u32| {
            f64::from(first) + (f64::from(at) + 0.5) / f64::from(count) * f64::from(size)
        };
        let mut found = Vec::new();
        for at in 0..count * count {
            progress.step(at as usize, (count * count) as usize)?;
            let at_px = DVec2::new(
                along(part.x, part.width, at % count),
                along(part.y, part.height, at / count),
            );
            let masks = self.masks_at(Click {
                at_px,
                include: true,
            })?;
            found.extend(masks.iter().filter_map(|mask| self.proposal(mask, options)));
        }
        // Stable sort: of equal scores the first, row by row.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(non_maximum_suppression(
            found,
            options.most_overlap,
            |one| one.extent,
        ))
    }

    fn proposal(&self, mask: &MaskPrediction, options: &EverythingOptions) -> Option<Proposal> {
        if mask.score <= options.least_score {
            return None;
        }
        let logits = self.enlarged(mask);
        let above = |least: f32| logits.iter().filter(|&&logit| logit > least).count();
        let (confidence, possible) = (above(options.offset), above(-options.offset));
        let stability = confidence as f32 / possible.max(1) as f32;
        if stability < options.least_stability || confidence == 0 {
            return None;
        }
        let region = self.region(mask);
        let extent = extent(&region)?;
        Some(Proposal {
            region,
            extent,
            score: mask.score,
            stability,
        })
    }

    fn check(&self, request: &SegmentRequest<'_>) -> Result<(), MaskError> {
        let ImagePart {
            x,
            y,
            width,
            height,
        } = self.part();
        let shown = format!("the {width}×{height} pixels from {x}, {y} that are looked at");
        let prompt = request.prompt;
        if prompt.is_empty() {
            return Err(MaskError::Request(
                "there is no click and no box; click on the object first".into(),
            ));
        }
        if let Some(click) = prompt
            .clicks
            .iter()
            .find(|click| !self.part().holds(click.at_px))
        {
            let at = click.at_px;
            return Err(MaskError::Request(format!(
                "the click at {}, {} lies outside {shown}; click on the image",
                at.x, at.y
            )));
        }
        let (first, last) = (
            glam::DVec2::new(x.into(), y.into()),
            glam::DVec2::new(width.into(), height.into()),
        );
        let crosses = |part: &PxBox| {
            let common = part.max_px.min(first + last) - part.min_px.max(first);
            common.min_element() > 0.0
        };
        if let Some(part) = prompt.boxes.iter().find(|part| !crosses(part)) {
            let (a, b) = (part.min_px, part.max_px);
            let text = format!(
                "the box from {}, {} to {}, {} holds no pixel of {shown}",
                a.x, a.y, b.x, b.y
            );
            return Err(MaskError::Request(text));
        }
        let fits = |region: &Region| (region.width, region.height) == self.size();
        if [request.previous, request.taken]
            .into_iter()
            .flatten()
            .all(fits)
        {
            return Ok(());
        }
        let (width, height) = self.size();
        Err(MaskError::Request(format!(
            "a mask given does not have the image's size of {width}×{height}"
        )))
    }

    /// Returns the object's pixels before those of other labels are removed.
    fn found(
        &self,
        prompt: &Prompt,
        previous: Option<&Region>,
        taken: Option<&Region>,
    ) -> Result<Region, MaskError> {
        let (Some(previous), Some((last, earlier))) = (previous, prompt.clicks.split_last()) else {
            return Ok(Objects::of(self, &prompt.boxes, &prompt.clicks, prompt.size)?.region());
        };
        let mut objects = Objects::of(self, &prompt.boxes, earlier, AnswerSize::Automatic)?;
        if !objects.agree_with(previous, taken) {
            objects = Objects::of_region(self, previous, earlier);
        }
        objects.add(last, prompt.size)?;
        Ok(objects.region())
    }
}

/// Enforces a click on its pixel and the pixels that touch it, whatever the network predicts.
pub(super) fn hold(region: &mut Region, click: &Click) {
    let (x, y) = (click.at_px.x as u32, click.at_px.y as u32);
    for y in y.saturating_sub(1)..=(y + 1).min(region.height - 1) {
        for x in x.saturating_sub(1)..=(x + 1).min(region.width - 1) {
            region.inside[y as usize * region.width as usize + x as usize] = click.include;
        }
    }
}

/// Returns the bounding box of a region; `None` if it is empty.
fn extent(region: &Region) -> Option<PxBox> {
    let width = region.width as usize;
    let inside = region
        .inside
        .iter()
        .enumerate()
        .filter(|(_, inside)| **inside);
    let places = inside.map(|(at, _)| DVec2::new((at % width) as f64, (at / width) as f64));
    let extents = places
        .map(|at| (at, at + 1.0))
        .reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    extents.map(|(min_px, max_px)| PxBox { min_px, max_px })
}
