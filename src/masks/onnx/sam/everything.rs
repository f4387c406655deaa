use glam::DVec2;

use super::decoder::Answer;
use super::frame::SamFrame;
use crate::onnx::boxes::without_doubles;
use crate::{Click, MaskError, Proposal, PxBox, Region};
use ostra_core::job::Progress;

/// Settings of [`SamFrame::everything`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EverythingOptions {
    /// Points along each side of the grid that is clicked; each costs a run of the decoder.
    pub points_per_side: u32,
    /// Least predicted IoU of a mask, 0–1.
    pub least_score: f32,
    /// Least share of a mask that stays when the threshold of its logits rises from −`offset` to `offset`, 0–1.
    pub least_stability: f32,
    /// In logits.
    pub offset: f32,
    /// IoU of bounding boxes above which two masks are one thing, 0–1.
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

impl SamFrame {
    /// Masks of all things in the picture, the surest first: a grid of points is clicked, every mask of every click that
    /// is sure and stable enough counts, and of those with nearly the same bounding box the surest.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or what the network says.
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
        // Stable: of equal scores the first, row by row.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(without_doubles(found, options.most_overlap, |one| {
            one.extent
        }))
    }

    fn proposal(&self, mask: &Answer, options: &EverythingOptions) -> Option<Proposal> {
        if mask.score <= options.least_score {
            return None;
        }
        let logits = self.enlarged(mask);
        let above = |least: f32| logits.iter().filter(|&&logit| logit > least).count();
        let (sure, possible) = (above(options.offset), above(-options.offset));
        let stability = sure as f32 / possible.max(1) as f32;
        if stability < options.least_stability || sure == 0 {
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
}

/// The box around a region; `None` for an empty one.
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
