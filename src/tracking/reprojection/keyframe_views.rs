use super::decide::decide;
use super::depth_view::{CalibratedView, DepthViews};
use super::keyframe::{GivenKeyframe, KeyframeCache, keyframes_for, labels_of};
use super::options::{ReprojectionOptions, Tolerance};
use super::vote::{KeyframeVotes, ReprojectedLabels, VoteRequest, ask};
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
            match views.calibrated_view(frame) {
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
        self.reach(frame) && self.views.calibrated_view(frame).is_some()
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
        let mut votes = KeyframeVotes {
            width: target.width(),
            height: target.height(),
            of_keyframes: Vec::new(),
        };
        let mut depths = target.depth.depths.clone();
        let allowed = |a: &&GivenKeyframe<'_>| reaches(self.direction, a.frame, frame);
        let allowed: Vec<&GivenKeyframe<'_>> = self.keyframes.iter().filter(allowed).collect();
        let calibrated: Vec<(CalibratedView, &[LabelId])> = allowed
            .iter()
            .map(|a| (a.posed, a.labels.as_slice()))
            .collect();
        let chosen = keyframes_for(&target, &calibrated, self.options.keyframes);
        for &place in &chosen {
            let Some(keyframe) = self.ready.get(allowed[place], progress)? else {
                continue;
            };
            let request = VoteRequest {
                keyframe: &keyframe,
                target: &target,
                tolerance: Tolerance::measured(&target, &keyframe.view, self.options),
                options: self.options,
                progress,
            };
            let view_labels = ask(&request, &mut depths)?;
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
        let (mask, confidence) = decide(evidence, &image, self.options, progress)?;
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
