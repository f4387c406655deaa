use rayon::prelude::*;

use super::change::FrameChange;
use super::evidence::{FrameAhead, FrameEvidence, evidence};
use super::memory::FeatureMemory;
use super::object::{Evidence, Prediction, TrackedObject};
use super::options::FlowOptions;
use super::tracked_image::TrackedImage;
use crate::propagate::{PassResult, shown_labels};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::{LabelId, LabelMask, Region};

/// Objects tracked from a keyframe, frame by frame.
pub(super) struct TrackedObjects<'a> {
    options: &'a FlowOptions,
    objects: Vec<TrackedObject>,
    memory: FeatureMemory,
}

impl<'a> TrackedObjects<'a> {
    /// Starts from a keyframe's mask at the working size.
    pub fn new(options: &'a FlowOptions, image: &TrackedImage, mask: &LabelMask) -> Self {
        let labels: Vec<LabelId> = shown_labels(mask).into_iter().collect();
        let objects = labels
            .into_par_iter()
            .map(|id| TrackedObject::new(id, mask.region(id), image))
            .collect();
        let mut tracked = Self {
            options,
            objects,
            memory: FeatureMemory::default(),
        };
        tracked.remember(image, mask);
        tracked
    }

    /// Learns the colours and cells of another keyframe.
    pub fn learn(&mut self, image: &TrackedImage, mask: &LabelMask) {
        self.remember(image, mask);
        for object in &mut self.objects {
            let region = mask.region(object.id);
            if !region.is_empty() {
                object.add_appearance(image, &region);
            }
        }
    }

    fn remember(&mut self, image: &TrackedImage, mask: &LabelMask) {
        if let Some(feature_map) = &image.feature_map {
            self.memory.learn(feature_map, mask);
        }
    }

    /// Advances all objects to the next frame and returns their mask at the working size.
    ///
    /// After an error the objects are in an undefined state.
    pub fn advance(
        &mut self,
        mut change: FrameChange,
        beyond: Option<&FrameAhead<'_>>,
        progress: &Progress,
    ) -> Result<PassResult, Stopped> {
        let options = self.options;
        change.find_background(
            &self
                .objects
                .iter()
                .map(TrackedObject::expected)
                .collect::<Vec<_>>(),
        );
        let recalled = change
            .next
            .feature_map
            .as_ref()
            .map(|feature_map| self.memory.recall(feature_map));
        let known = self.objects.par_iter_mut().map(|object| {
            progress.check()?;
            let prediction = object.predict(&change, options);
            let evidence = evidence(
                object,
                &prediction,
                &FrameEvidence {
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
        Ok(PassResult {
            mask,
            confidence,
            known: self.objects.iter().map(|object| object.id).collect(),
            probabilities: None,
        })
    }
}

/// The two best odds per pixel, and the object with the best ones.
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

    /// Lowers an object's odds by those of its strongest rival, where they are positive.
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

    /// Removes the pixels for which another object has better odds.
    fn withdraw(&self, object: usize, mask: &mut Region) {
        for (inside, &(_, best)) in mask.inside.iter_mut().zip(&self.best) {
            *inside &= best == object;
        }
    }
}
