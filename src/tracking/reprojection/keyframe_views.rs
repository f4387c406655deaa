use super::decide::decide;
use super::depth_view::{DepthView, DepthViews, PosedCamera};
use super::keyframe::{GivenKeyframe, KeyframeCache, keyframes_for, labels_of};
use super::options::{ReprojectionOptions, Tolerance};
use super::vote::{Question, Votes, ask};
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, MaskError, TrackRequest, WalkedFrame};

/// The keyframes of a request that have depth and a camera: what they show, they show of the scene.
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
        for (&frame, mask) in &request.anchors {
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

    /// Whether none of them shows any label.
    pub fn have_no_labels(&self) -> bool {
        self.keyframes
            .iter()
            .all(|keyframe| keyframe.labels.is_empty())
    }

    /// Whether masks may go from one of them to a frame, in the request's direction.
    pub fn reach(&self, frame: usize) -> bool {
        self.keyframes
            .iter()
            .any(|keyframe| reaches(self.direction, keyframe.frame, frame))
    }

    /// Whether they can be asked of a frame: it has depth and a camera, and they [`Self::reach`] it.
    pub fn can_give_evidence_for(&self, frame: usize) -> bool {
        self.reach(frame) && self.views.posed_camera(frame).is_some()
    }

    /// What they say of a frame, which has depth and a camera; `None` where its depth cannot be read, or that of none that
    /// should be asked.
    ///
    /// # Errors
    /// [`MaskError::Request`] where camera and image differ in size; [`MaskError::Stopped`].
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

    /// The mask of a frame by what they say of it, along what its image and depth show; with how sure each label is, 0–1.
    /// `None` where the image cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Stopped`].
    pub fn carry_to(
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

/// Whether masks may go from a keyframe to a frame.
fn reaches(direction: Direction, keyframe: usize, frame: usize) -> bool {
    match direction {
        Direction::Both => true,
        Direction::Forward => keyframe < frame,
        Direction::Backward => keyframe > frame,
    }
}

/// What keyframes say of a frame.
#[derive(Debug)]
pub(crate) struct ReprojectedLabels {
    /// The frame.
    pub target: DepthView,
    /// Its depths, with what keyframes show in its holes.
    pub depths: Vec<f32>,
    pub votes: Votes,
}

impl ReprojectedLabels {
    /// The label of a pixel (0 = nothing) by the keyframes that have a surface where the frame has one: it wins at least
    /// `share` of their weights, which sum to at least `weight`. `None` where no label does, and where the frame has no
    /// depth. Nothing being there counts where the keyframes would know of the label `held` that the pixel has so far.
    pub fn verdict(&self, pixel: usize, held: LabelId, share: f32, weight: f32) -> Option<LabelId> {
        if self.target.depth.depths[pixel] <= 0.0 {
            return None;
        }
        let is_sure = |label: LabelId, shown: LabelId| {
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
            .find(|&label| is_sure(label, label));
        named.or_else(|| is_sure(held, LabelId::NONE).then_some(LabelId::NONE))
    }

    /// Whether a keyframe sees through the place of a pixel's surface, and none has it where the frame does: something came
    /// there.
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
