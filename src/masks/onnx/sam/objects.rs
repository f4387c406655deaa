//! Several objects under one label.
//!
//! The network is never prompted for two objects at once: each object has its own prompt, and the
//! label is the union of all of them.

use std::sync::Arc;

use super::decoder::MaskPrediction;
use super::frame::SamFrame;
use super::mask_logits::hint;
use crate::{AnswerSize, Click, Connectivity, MaskError, PxBox, Region, components, deepest_point};

/// The objects of one label.
pub(super) struct Objects<'a> {
    frame: &'a SamFrame,
    objects: Vec<PromptedObject>,
    excludes: Vec<Click>,
    /// Pixels that are kept unchanged.
    kept: Region,
}

/// One object: its clicks and box, and the network's answer.
struct PromptedObject {
    within: Option<PxBox>,
    clicks: Vec<Click>,
    answer: Arc<MaskPrediction>,
    /// Pixels of the answer if it was not predicted by the network.
    given: Option<Region>,
}

/// Minimum IoU at which a mask counts as the result of the clicks, not painted or tracked since.
const SAME_IOU: f64 = 0.9;
/// Maximum number of passes over the exclude clicks: the network may ignore them.
const ROUNDS: usize = 2;

impl<'a> Objects<'a> {
    /// Builds the objects of boxes and clicks.
    ///
    /// Clicks are applied one by one, in the order given; `size` is that of the last one's answer.
    pub fn of(
        frame: &'a SamFrame,
        boxes: &[PxBox],
        clicks: &[Click],
        size: AnswerSize,
    ) -> Result<Self, MaskError> {
        let (width, height) = frame.size();
        let mut found = Self {
            frame,
            objects: Vec::new(),
            excludes: Vec::new(),
            kept: Region::empty(width, height),
        };
        for within in boxes {
            let answer = frame.ask(&[], Some(within), None, AnswerSize::Automatic)?;
            found.objects.push(PromptedObject {
                within: Some(*within),
                clicks: Vec::new(),
                answer,
                given: None,
            });
        }
        if let Some((last, earlier)) = clicks.split_last() {
            for click in earlier {
                found.add(click, AnswerSize::Automatic)?;
            }
            found.add(last, size)?;
        }
        Ok(found)
    }

    /// Builds one object per connected part of a mask from elsewhere.
    ///
    /// Each object gets the include clicks that lie on it. The network sees an object only once a
    /// click changes it; all others stay as they are.
    pub fn of_region(frame: &'a SamFrame, region: &Region, clicks: &[Click]) -> Self {
        let parts = components(region, Connectivity::Eight);
        let numbers = 1..=u32::try_from(parts.areas.len()).unwrap_or(u32::MAX);
        let object = |number: u32| {
            let inside = parts.labels.iter().map(|&part| part == number).collect();
            let part = Region { inside, ..*region };
            let is_on = |click: &&Click| {
                click
                    .pixel_in(part.width, part.height)
                    .is_some_and(|at| part.inside[at])
            };
            let mut own: Vec<Click> = clicks
                .iter()
                .filter(|click| click.include)
                .filter(is_on)
                .copied()
                .collect();
            if own.is_empty() {
                let middle =
                    deepest_point(&part).map(|(x, y)| glam::DVec2::new(x.into(), y.into()) + 0.5);
                own.extend(middle.map(|at_px| Click {
                    at_px,
                    include: true,
                }));
            }
            let logits = hint(&part, frame.part(), frame.canvas(), frame.fine());
            let own = own
                .into_iter()
                .filter(|click| frame.part().holds(click.at_px))
                .collect();
            PromptedObject {
                within: None,
                clicks: own,
                answer: Arc::new(MaskPrediction {
                    logits,
                    score: 0.0,
                    is_given: true,
                }),
                given: Some(part),
            }
        };
        let excludes = clicks
            .iter()
            .filter(|click| !click.include)
            .copied()
            .collect();
        let kept = Region::empty(region.width, region.height);
        Self {
            frame,
            objects: numbers.map(object).collect(),
            excludes,
            kept,
        }
    }

    /// Returns whether the objects result in `mask`, except for pixels taken by other labels.
    pub fn agree_with(&self, mask: &Region, taken: Option<&Region>) -> bool {
        let mut own = self.region();
        if let Some(taken) = taken {
            own.subtract(taken);
        }
        own.iou(mask) >= SAME_IOU
    }

    /// Applies one more click, with an answer of a size.
    pub fn add(&mut self, click: &Click, size: AnswerSize) -> Result<(), MaskError> {
        if click.include {
            self.include(click, size)?;
            self.refine_by_excludes(AnswerSize::Automatic)
        } else {
            self.excludes.push(*click);
            self.refine_by_excludes(size.reversed())
        }
    }

    fn include(&mut self, click: &Click, size: AnswerSize) -> Result<(), MaskError> {
        let boxed = self.smallest_box(click);
        if let Some(at) = boxed.or_else(|| self.holding(click)) {
            return if self.objects[at].given.is_some() {
                Ok(())
            } else {
                self.refine(at, click, size)
            };
        }
        let alone = self.frame.ask(&[*click], None, None, size)?;
        match self.touched_by(&alone) {
            Some(at) => self.refine(at, click, size),
            None => {
                self.objects.push(PromptedObject {
                    within: None,
                    clicks: vec![*click],
                    answer: alone,
                    given: None,
                });
                Ok(())
            }
        }
    }

    /// Refines the answer of an object with one more click.
    fn refine(&mut self, at: usize, click: &Click, size: AnswerSize) -> Result<(), MaskError> {
        let object = &mut self.objects[at];
        object.clicks.push(*click);
        object.answer = self.frame.ask(
            &object.clicks,
            object.within.as_ref(),
            Some(&object.answer),
            size,
        )?;
        if let Some(mut given) = object.given.take() {
            // The answer does not extend to pixels outside the part that the network sees.
            given.subtract(&self.frame.part().region(given.width, given.height));
            self.kept.unite(&given);
        }
        Ok(())
    }

    /// Adds exclude clicks to the objects whose answers cover them.
    ///
    /// Clicks elsewhere, including those of other labels, are satisfied already. `size` is that of
    /// the mask after the last exclude click.
    fn refine_by_excludes(&mut self, size: AnswerSize) -> Result<(), MaskError> {
        for _ in 0..ROUNDS {
            let mut all_right = true;
            for at in 0..self.objects.len() {
                let excludes = self.excludes.clone();
                for (number, click) in excludes.iter().enumerate() {
                    let object = &self.objects[at];
                    if self.covers(object, click) && !object.clicks.contains(click) {
                        let is_last = number + 1 == excludes.len();
                        let size = if is_last { size } else { AnswerSize::Automatic };
                        self.refine(at, click, size)?;
                        all_right = false;
                    }
                }
            }
            if all_right {
                break;
            }
        }
        Ok(())
    }

    fn covers(&self, object: &PromptedObject, click: &Click) -> bool {
        match &object.given {
            Some(part) => click
                .pixel_in(part.width, part.height)
                .is_some_and(|at| part.inside[at]),
            None => self.frame.logit_at(&object.answer, click) > 0.0,
        }
    }

    fn smallest_box(&self, click: &Click) -> Option<usize> {
        let holds = |part: &PxBox| {
            click.at_px.cmpge(part.min_px).all() && click.at_px.cmplt(part.max_px).all()
        };
        let area = |part: &PxBox| (part.max_px - part.min_px).element_product();
        let boxed = self
            .objects
            .iter()
            .enumerate()
            .filter_map(|(at, object)| Some((at, object.within.as_ref()?)));
        let around = boxed.filter(|(_, part)| holds(part));
        around
            .min_by(|(_, a), (_, b)| area(a).total_cmp(&area(b)))
            .map(|(at, _)| at)
    }

    fn holding(&self, click: &Click) -> Option<usize> {
        self.objects
            .iter()
            .position(|object| self.covers(object, click))
    }

    /// Returns the object that shares the most cells with an answer; touching it is enough.
    fn touched_by(&self, answer: &MaskPrediction) -> Option<usize> {
        let fine = self.frame.fine();
        let near = grown(&answer.logits, fine);
        let shared = |object: &PromptedObject| {
            let inside = object.answer.logits.iter().map(|&logit| logit > 0.0);
            inside
                .zip(&near)
                .filter(|&(inside, &near)| inside && near)
                .count()
        };
        let shares = self
            .objects
            .iter()
            .map(shared)
            .enumerate()
            .filter(|&(_, shared)| shared > 0);
        shares
            .max_by_key(|&(at, shared)| (shared, std::cmp::Reverse(at)))
            .map(|(at, _)| at)
    }

    /// Returns the union of all objects.
    pub fn region(&self) -> Region {
        let mut all = self.kept.clone();
        for object in &self.objects {
            match &object.given {
                Some(part) => all.unite(part),
                None => all.unite(&self.frame.region(&object.answer)),
            }
        }
        all
    }
}

/// Returns which cells are inside or touch a cell that is inside.
fn grown(logits: &[f32], fine: usize) -> Vec<bool> {
    let mut near = vec![false; logits.len()];
    for at in (0..logits.len()).filter(|&at| logits[at] > 0.0) {
        let (x, y) = (at % fine, at / fine);
        for y in y.saturating_sub(1)..=(y + 1).min(fine - 1) {
            near[y * fine..][x.saturating_sub(1)..=(x + 1).min(fine - 1)].fill(true);
        }
    }
    near
}
