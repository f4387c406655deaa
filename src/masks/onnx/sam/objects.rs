//! One label may lie on several objects, but the network is never asked about two at once: each object has its own
//! prompt, and the label is all of them together.

use std::sync::Arc;

use super::decoder::Answer;
use super::frame::SamFrame;
use super::mask_logits::hint;
use crate::{Click, Connectivity, MaskError, PxBox, Region, components, deepest_point};

/// The objects of one label.
pub(super) struct Objects<'a> {
    frame: &'a SamFrame,
    objects: Vec<Object>,
    excludes: Vec<Click>,
    /// What is taken as it is.
    kept: Region,
}

/// One object: its clicks and box, and the network's answer.
struct Object {
    within: Option<PxBox>,
    clicks: Vec<Click>,
    answer: Arc<Answer>,
    /// The pixels that the answer stands for where it was not the network that gave it.
    given: Option<Region>,
}

/// Overlap from which on a mask is what the clicks gave, and was not painted or tracked since.
const SAME_IOU: f64 = 0.9;
/// How often exclude clicks that a new answer covers are given: the network may ignore them.
const ROUNDS: usize = 2;

impl<'a> Objects<'a> {
    /// The objects that boxes and clicks in the order given mean; every click is answered before the next.
    pub fn of(frame: &'a SamFrame, boxes: &[PxBox], clicks: &[Click]) -> Result<Self, MaskError> {
        let (width, height) = frame.size();
        let mut found = Self {
            frame,
            objects: Vec::new(),
            excludes: Vec::new(),
            kept: Region::empty(width, height),
        };
        for within in boxes {
            let answer = frame.ask(&[], Some(within), None)?;
            found.objects.push(Object {
                within: Some(*within),
                clicks: Vec::new(),
                answer,
                given: None,
            });
        }
        clicks.iter().try_for_each(|click| found.add(click))?;
        Ok(found)
    }

    /// The parts of a mask that came from elsewhere, with the include clicks that lie on them. Each is looked at as an
    /// object only once a click asks for it, and is kept as it is otherwise.
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
            Object {
                within: None,
                clicks: own,
                answer: Arc::new(Answer {
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

    /// Whether a mask is what the objects give, but for what other labels took.
    pub fn agree_with(&self, mask: &Region, taken: Option<&Region>) -> bool {
        let mut own = self.region();
        if let Some(taken) = taken {
            own.subtract(taken);
        }
        own.iou(mask) >= SAME_IOU
    }

    /// Answers one more click.
    pub fn add(&mut self, click: &Click) -> Result<(), MaskError> {
        if click.include {
            self.include(click)?;
        } else {
            self.excludes.push(*click);
        }
        self.refine_by_excludes()
    }

    fn include(&mut self, click: &Click) -> Result<(), MaskError> {
        let boxed = self.smallest_box(click);
        if let Some(at) = boxed.or_else(|| self.holding(click)) {
            return if self.objects[at].given.is_some() {
                Ok(())
            } else {
                self.refine(at, click)
            };
        }
        let alone = self.frame.ask(&[*click], None, None)?;
        match self.touched_by(&alone) {
            Some(at) => self.refine(at, click),
            None => {
                self.objects.push(Object {
                    within: None,
                    clicks: vec![*click],
                    answer: alone,
                    given: None,
                });
                Ok(())
            }
        }
    }

    /// Asks for the object again with one more click, refining its answer.
    fn refine(&mut self, at: usize, click: &Click) -> Result<(), MaskError> {
        let object = &mut self.objects[at];
        object.clicks.push(*click);
        object.answer =
            self.frame
                .ask(&object.clicks, object.within.as_ref(), Some(&object.answer))?;
        if let Some(mut given) = object.given.take() {
            // The answer says nothing of pixels outside the part that the network sees.
            given.subtract(&self.frame.part().region(given.width, given.height));
            self.kept.unite(&given);
        }
        Ok(())
    }

    /// Exclude clicks go to the object whose answer covers them: those elsewhere (other labels' clicks among
    /// them) are right already.
    fn refine_by_excludes(&mut self) -> Result<(), MaskError> {
        for _ in 0..ROUNDS {
            let mut all_right = true;
            for at in 0..self.objects.len() {
                for click in self.excludes.clone() {
                    let object = &self.objects[at];
                    if self.covers(object, &click) && !object.clicks.contains(&click) {
                        self.refine(at, &click)?;
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

    fn covers(&self, object: &Object, click: &Click) -> bool {
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

    /// The object that an answer shares most with; one that it only touches will do.
    fn touched_by(&self, answer: &Answer) -> Option<usize> {
        let fine = self.frame.fine();
        let near = grown(&answer.logits, fine);
        let shared = |object: &Object| {
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

    /// All objects together.
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

/// Which cells are inside, and those that touch them.
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
