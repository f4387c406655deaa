use std::sync::Arc;

use glam::Vec2;
use rayon::prelude::*;

use super::dis::{Finest, flow_between};
use super::evidence::{Evidence, Sight, evidence, median};
use super::memory::Memory;
use super::motion::{PlaneMotion, Step};
use super::object::{Object, Prediction};
use super::options::FlowOptions;
use super::picture::Picture;
use super::plane::{Flow, Plane};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::{LabelId, LabelMask, Region, WalkedFrame};

/// Pixels whose motion is looked at to find the background's.
const MOST_STEPS: usize = 1500;
/// Largest miss of the background's motion, in pixels.
const AGREES_PX: f32 = 2.0;

/// Two neighbouring frames and how pixels move between them.
pub(super) struct Change {
    pub last: Arc<Picture>,
    pub next: Arc<Picture>,
    /// From the last frame to the next, and back.
    pub forward: Arc<Flow>,
    pub backward: Arc<Flow>,
    /// By pixel of the next frame: how well both flows agree, 0–1.
    pub reliable: Plane,
    /// How the background moves, from the next frame back to the last; `None` where it shows nowhere.
    pub background: Option<PlaneMotion>,
    /// Median miss of the background's motion, in pixels.
    pub background_noise: f32,
}

impl Change {
    /// Measures the flow both ways.
    pub fn new(last: Arc<Picture>, next: Arc<Picture>, finest: Finest) -> Self {
        let flow = |from: &Picture, to: &Picture| {
            Arc::new(flow_between(&from.pyramid, &to.pyramid, finest))
        };
        let (forward, backward) = rayon::join(|| flow(&last, &next), || flow(&next, &last));
        Self::of_flows((last, next), forward, backward)
    }

    /// Of the flow from the last frame to the next, and back.
    pub fn of_flows(
        (last, next): (Arc<Picture>, Arc<Picture>),
        forward: Arc<Flow>,
        backward: Arc<Flow>,
    ) -> Self {
        let reliable = Plane::from_fn(next.width, next.height, |x, y| {
            let vector = backward.at(x, y);
            let miss = (vector + forward.sample(Vec2::new(x as f32, y as f32) + vector)).length();
            (-(miss / (1.0 + 0.1 * vector.length())).powi(2)).exp()
        });
        Self {
            last,
            next,
            forward,
            backward,
            reliable,
            background: None,
            background_noise: 0.0,
        }
    }

    /// Finds the background's motion from pixels that no object is expected near.
    pub fn find_background(&mut self, expected: &[&Plane]) {
        let (width, height) = (self.next.width, self.next.height);
        let mut hidden = Region::empty(width as u32, height as u32);
        for plane in expected {
            hidden
                .inside
                .iter_mut()
                .zip(&plane.values)
                .for_each(|(hidden, &value)| *hidden |= value > 0.2);
        }
        let hidden = hidden.dilated(4.0);
        let open = |sure: f32| -> Vec<usize> {
            (0..width * height)
                .filter(|&at| !hidden.inside[at] && self.reliable.values[at] >= sure)
                .collect()
        };
        let mut open_places = open(0.5);
        if open_places.len() <= 200 {
            open_places = open(0.0);
        }
        if open_places.len() <= 200 {
            return;
        }
        let every = open_places.len().div_ceil(MOST_STEPS);
        let step = |&at: &usize| {
            let from = Vec2::new((at % width) as f32, (at / width) as f32);
            Step {
                from,
                to: from + self.backward.vectors[at],
            }
        };
        let steps: Vec<Step> = open_places.iter().step_by(every).map(step).collect();
        let centre = Vec2::new(width as f32, height as f32) / 2.0;
        self.background = PlaneMotion::of(&steps, centre, AGREES_PX);
        if let Some(motion) = self.background {
            let miss = |step: &Step| motion.displacement(step.from).distance(step.to - step.from);
            self.background_noise = median(steps.iter().map(miss));
        }
    }
}

/// The frame after the next with its mask, which it has from the anchor beyond it or is that anchor's.
pub(super) struct Beyond<'a> {
    /// From the next frame to it.
    pub change: &'a Change,
    pub mask: LabelMask,
    /// How much its mask counts beside the last frame's, 0–1.
    pub share: f32,
}

/// Objects carried from an anchor, frame after frame.
pub(super) struct Walk<'a> {
    options: &'a FlowOptions,
    objects: Vec<Object>,
    memory: Memory,
}

impl<'a> Walk<'a> {
    /// From an anchor's mask at the working size.
    pub fn new(options: &'a FlowOptions, picture: &Picture, mask: &LabelMask) -> Self {
        let mut labels: Vec<LabelId> = mask
            .ids
            .iter()
            .copied()
            .filter(|&id| id != LabelId::NONE)
            .collect();
        labels.sort_unstable();
        labels.dedup();
        let objects = labels
            .into_par_iter()
            .map(|id| Object::new(id, mask.region(id), picture))
            .collect();
        let mut walk = Self {
            options,
            objects,
            memory: Memory::default(),
        };
        walk.remember(picture, mask);
        walk
    }

    /// Takes the colours and cells of another anchor into account.
    pub fn learn(&mut self, picture: &Picture, mask: &LabelMask) {
        self.remember(picture, mask);
        for object in &mut self.objects {
            let region = mask.region(object.id);
            if !region.is_empty() {
                object.also_looks_like(picture, &region);
            }
        }
    }

    fn remember(&mut self, picture: &Picture, mask: &LabelMask) {
        if let Some(description) = &picture.description {
            self.memory.learn(description, mask);
        }
    }

    /// Carries all objects to the next frame; their mask there, at the working size. After a stop the walk is at no
    /// frame any more.
    pub fn advance(
        &mut self,
        mut change: Change,
        beyond: Option<&Beyond<'_>>,
        progress: &Progress,
    ) -> Result<WalkedFrame, Stopped> {
        let options = self.options;
        change.find_background(
            &self
                .objects
                .iter()
                .map(Object::expected)
                .collect::<Vec<_>>(),
        );
        let recalled = change
            .next
            .description
            .as_ref()
            .map(|description| self.memory.recall(description));
        let known = self.objects.par_iter_mut().map(|object| {
            progress.check()?;
            let prediction = object.predict(&change, options);
            let evidence = evidence(
                object,
                &prediction,
                &Sight {
                    change: &change,
                    beyond,
                    recalled: recalled.as_ref(),
                },
                options,
            );
            Ok((prediction, evidence))
        });
        let known: Vec<(Prediction, Evidence)> = known.collect::<Result<_, Stopped>>()?;
        let rivals = Rivals::new(
            &known,
            change.next.width * change.next.height,
            change.next.width,
        );
        let decided =
            self.objects
                .par_iter_mut()
                .zip(known)
                .enumerate()
                .map(|(place, (object, known))| {
                    progress.check()?;
                    let (prediction, mut evidence) = known;
                    rivals.contest(place, &mut evidence, change.next.width);
                    let mut mask = object.decide(&prediction, &evidence, &change.next, options);
                    rivals.withdraw(place, &mut mask);
                    object.settle(mask, &prediction, &evidence, &change, options);
                    Ok(())
                });
        decided.collect::<Result<(), Stopped>>()?;
        let next = &change.next;
        let mut mask = LabelMask::empty(next.width as u32, next.height as u32);
        for object in &self.objects {
            let region = object.mask();
            for (id, _) in mask
                .ids
                .iter_mut()
                .zip(&region.inside)
                .filter(|(_, inside)| **inside)
            {
                *id = object.id;
            }
        }
        let confidence = self
            .objects
            .iter()
            .map(|object| (object.id, object.confidence()))
            .collect();
        Ok(WalkedFrame { mask, confidence })
    }
}

/// By pixel the two best odds of any object and whose the best are.
struct Rivals {
    best: Vec<(f32, usize)>,
    second: Vec<f32>,
}

impl Rivals {
    fn new(known: &[(Prediction, Evidence)], pixels: usize, width: usize) -> Self {
        let mut rivals = Self {
            best: vec![(f32::NEG_INFINITY, usize::MAX); pixels],
            second: vec![f32::NEG_INFINITY; pixels],
        };
        for (object, (_, evidence)) in known.iter().enumerate() {
            for (at, &odds) in evidence.window.places(width).zip(&evidence.odds) {
                if odds > rivals.best[at].0 {
                    rivals.second[at] = rivals.best[at].0;
                    rivals.best[at] = (odds, object);
                } else {
                    rivals.second[at] = rivals.second[at].max(odds);
                }
            }
        }
        rivals
    }

    /// Lowers an object's odds by those of its strongest rival, where they are above 0.
    fn contest(&self, object: usize, evidence: &mut Evidence, width: usize) {
        let places: Vec<usize> = evidence.window.places(width).collect();
        for (at, odds) in places.into_iter().zip(&mut evidence.odds) {
            let rival = if self.best[at].1 == object {
                self.second[at]
            } else {
                self.best[at].0
            };
            *odds -= rival.max(0.0);
        }
    }

    /// Leaves the pixels to a rival for which more speaks.
    fn withdraw(&self, object: usize, mask: &mut Region) {
        for (inside, &(_, best)) in mask.inside.iter_mut().zip(&self.best) {
            *inside &= best == object;
        }
    }
}
