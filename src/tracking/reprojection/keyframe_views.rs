use super::decide::decide;
use super::depth_view::{DepthView, DepthViews, PosedCamera};
use super::keyframe::{GivenKeyframe, KeyframeCache, keyframes_for, labels_of};
use super::options::{ReprojectionOptions, Tolerance};
use super::vote::{Question, Votes, ask};
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, MaskError, TrackRequest, WalkedFrame};

/// The keyframes of a request that have depth and a camera.
pub(crate) struct KeyframeViews<'a> {
    options: &'a ReprojectionOptions,
    views: &'a DepthViews<'a>,
    direction: Direction,
    keyframes: Vec<GivenKeyframe<'a>>,
    ready: KeyframeCache<'a>,
    /// Keyframes without depth or camera.
    pub left_out: Vec<usize>,
}

impl<'a> KeyframeViews<'a> {
    pub fn new(
        options: &'a ReprojectionOptions,
        request: &'a TrackRequest,
        views: &'a DepthViews<'a>,
    ) -> Self {
        let mut left_out = Vec::new();
        let mut keyframes = Vec::new();
        for (&frame, mask) in &request.keyframes {
            match views.posed_camera(frame) {
                Some(posed) => keyframes.push(GivenKeyframe {
                    frame,
                    posed,
                    labels: labels_of(mask),
                    mask,
                }),
                None => left_out.push(frame),
            }
        }
        let ready = KeyframeCache::new(views, options);
        Self {
            options,
            views,
            direction: request.direction,
            keyframes,
            ready,
            left_out,
        }
    }

    /// Returns whether no keyframe shows any label.
    pub fn have_no_labels(&self) -> bool {
        self.keyframes
            .iter()
            .all(|keyframe| keyframe.labels.is_empty())
    }

    /// Returns whether a keyframe can pass its mask to a frame in the request's direction.
    pub fn reach(&self, frame: usize) -> bool {
        self.keyframes
            .iter()
            .any(|keyframe| reaches(self.direction, keyframe.frame, frame))
    }

    /// Returns whether the frame has depth and a camera and [`Self::reach`] holds.
    pub fn can_give_evidence_for(&self, frame: usize) -> bool {
        self.reach(frame) && self.views.posed_camera(frame).is_some()
    }

    /// Collects the keyframes' votes on a frame that has depth and a camera.
    ///
    /// Returns `None` if the depth of the frame, or of all keyframes selected for it, cannot be
    /// read.
    ///
    /// # Errors
    /// [`MaskError::Request`] if camera and image differ in size, or [`MaskError::Stopped`].
    pub fn evidence_for(
        &self,
        frame: usize,
        progress: &Progress,
    ) -> Result<Option<ReprojectedLabels>, MaskError> {
        let Some(target) = self.views.load(frame)? else {
            return Ok(None);
        };
        let mut votes = Votes {
            width: target.width(),
            height: target.height(),
            of_keyframes: Vec::new(),
        };
        let mut depths = target.depth.depths.clone();
        let allowed = |a: &&GivenKeyframe<'_>| reaches(self.direction, a.frame, frame);
        let allowed: Vec<&GivenKeyframe<'_>> = self.keyframes.iter().filter(allowed).collect();
        let posed_cameras: Vec<(PosedCamera, &[LabelId])> = allowed
            .iter()
            .map(|a| (a.posed, a.labels.as_slice()))
            .collect();
        let chosen = keyframes_for(&target, &posed_cameras, self.options.keyframes);
        for &place in &chosen {
            let Some(keyframe) = self.ready.get(allowed[place], progress)? else {
                continue;
            };
            let question = Question {
                keyframe: &keyframe,
                target: &target,
                tolerance: Tolerance::measured(&target, &keyframe.view, self.options),
                options: self.options,
                progress,
            };
            let view_labels = ask(&question, &mut depths)?;
            votes.of_keyframes.push((keyframe, view_labels));
        }
        let is_silent = votes.of_keyframes.is_empty() && !chosen.is_empty();
        Ok((!is_silent).then_some(ReprojectedLabels {
            target,
            depths,
            votes,
        }))
    }

    /// Computes the mask of a frame from the votes, its image and its depth.
    ///
    /// Also returns the confidence of each label, 0–1. Returns `None` if the image cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Stopped`] if the user stops the job.
    pub fn transfer_to(
        &self,
        frame: usize,
        evidence: &ReprojectedLabels,
        progress: &Progress,
    ) -> Result<Option<WalkedFrame>, MaskError> {
        let Some(image) = self.views.image(frame)? else {
            return Ok(None);
        };
        let seen = (&evidence.target, evidence.depths.as_slice());
        let (mask, confidence) = decide(&evidence.votes, seen, &image, self.options, progress)?;
        Ok(Some(WalkedFrame { mask, confidence }))
    }
}

/// Returns whether masks may pass from a keyframe to a frame.
fn reaches(direction: Direction, keyframe: usize, frame: usize) -> bool {
    match direction {
        Direction::Both => true,
        Direction::Forward => keyframe < frame,
        Direction::Backward => keyframe > frame,
    }
}

/// Votes of the keyframes on a frame.
#[derive(Debug)]
pub(crate) struct ReprojectedLabels {
    /// The frame.
    pub target: DepthView,
    /// Depths of the frame, with holes filled from keyframes.
    pub depths: Vec<f32>,
    pub votes: Votes,
}

impl ReprojectedLabels {
    /// Returns the label that the keyframes agree on at a pixel; 0 is background.
    ///
    /// Only keyframes with a surface at the frame's depth vote. The label must win at least `share`
    /// of their weights, which must sum to at least `weight`. Returns `None` if no label does, or
    /// if the frame has no depth. Background counts only by the keyframes that have evidence about
    /// `held`, the pixel's current label.
    pub fn verdict(&self, pixel: usize, held: LabelId, share: f32, weight: f32) -> Option<LabelId> {
        if self.target.depth.depths[pixel] <= 0.0 {
            return None;
        }
        let is_confident = |label: LabelId, shown: LabelId| {
            let [own, all] = self.votes.at(pixel, label, shown);
            all >= weight && own >= share * all
        };
        let seen = self
            .votes
            .of_keyframes
            .iter()
            .filter_map(|(_, view_labels)| Some(view_labels.at(pixel)?.0));
        let named = seen
            .filter(|&label| label != LabelId::NONE)
            .find(|&label| is_confident(label, label));
        named.or_else(|| is_confident(held, LabelId::NONE).then_some(LabelId::NONE))
    }

    /// Returns whether something new has appeared at a pixel.
    ///
    /// This is the case if a keyframe sees through the pixel's surface, and none has a surface at
    /// that place.
    pub fn is_new(&self, pixel: usize) -> bool {
        let view_labels = || {
            self.votes
                .of_keyframes
                .iter()
                .map(|(_, view_labels)| view_labels)
        };
        view_labels().any(|seen| seen.is_through(pixel))
            && view_labels().all(|seen| seen.at(pixel).is_none())
    }
}
