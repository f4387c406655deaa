use super::anchor::{GivenAnchor, ReadyAnchors, anchors_for, labels_of};
use super::decide::decide;
use super::options::{CarryOptions, Tolerance};
use super::viewpoint::{Stand, Viewpoint, Views};
use super::vote::{Votes, ask};
use ostra_core::job::Progress;
use ostra_masks::{Direction, LabelId, MaskError, TrackRequest, WalkedFrame};

/// The anchors of a request that have depth and a camera: what they show, they show of the scene.
pub(crate) struct Witnesses<'a> {
    options: &'a CarryOptions,
    views: &'a Views<'a>,
    direction: Direction,
    anchors: Vec<GivenAnchor<'a>>,
    ready: ReadyAnchors<'a>,
    /// Anchors without depth or camera.
    pub left_out: Vec<usize>,
}

impl<'a> Witnesses<'a> {
    pub fn new(options: &'a CarryOptions, request: &'a TrackRequest, views: &'a Views<'a>) -> Self {
        let mut left_out = Vec::new();
        let mut anchors = Vec::new();
        for (&frame, mask) in &request.anchors {
            match views.stand(frame) {
                Some(stand) => anchors.push(GivenAnchor {
                    frame,
                    stand,
                    labels: labels_of(mask),
                    mask,
                }),
                None => left_out.push(frame),
            }
        }
        let ready = ReadyAnchors::new(views, options);
        Self {
            options,
            views,
            direction: request.direction,
            anchors,
            ready,
            left_out,
        }
    }

    /// Whether none of them shows any label.
    pub fn are_mute(&self) -> bool {
        self.anchors.iter().all(|anchor| anchor.labels.is_empty())
    }

    /// Whether masks may go from one of them to a frame, in the request's direction.
    pub fn reach(&self, frame: usize) -> bool {
        self.anchors
            .iter()
            .any(|anchor| reaches(self.direction, anchor.frame, frame))
    }

    /// Whether they can be asked of a frame: it has depth and a camera, and they [`Self::reach`] it.
    pub fn can_tell_of(&self, frame: usize) -> bool {
        self.reach(frame) && self.views.stand(frame).is_some()
    }

    /// What they say of a frame, which has depth and a camera; `None` where its depth cannot be read, or that of none that
    /// should be asked.
    ///
    /// # Errors
    /// [`MaskError::Request`] where camera and picture differ in size; [`MaskError::Stopped`].
    pub fn tell_of(
        &self,
        frame: usize,
        progress: &Progress,
    ) -> Result<Option<Testimony>, MaskError> {
        let Some(target) = self.views.load(frame)? else {
            return Ok(None);
        };
        let mut votes = Votes {
            width: target.width(),
            height: target.height(),
            of_anchors: Vec::new(),
        };
        let mut depths = target.depth.depths.clone();
        let allowed = |a: &&GivenAnchor<'_>| reaches(self.direction, a.frame, frame);
        let allowed: Vec<&GivenAnchor<'_>> = self.anchors.iter().filter(allowed).collect();
        let stands: Vec<(Stand, &[LabelId])> = allowed
            .iter()
            .map(|a| (a.stand, a.labels.as_slice()))
            .collect();
        let chosen = anchors_for(&target, &stands, self.options.anchors);
        for &place in &chosen {
            let Some(anchor) = self.ready.get(allowed[place], progress)? else {
                continue;
            };
            let tolerance = Tolerance::measured(&target, &anchor.view, self.options);
            let sightings = ask(
                &anchor,
                &target,
                &tolerance,
                &mut depths,
                self.options,
                progress,
            )?;
            votes.of_anchors.push((anchor, sightings));
        }
        let is_silent = votes.of_anchors.is_empty() && !chosen.is_empty();
        Ok((!is_silent).then_some(Testimony {
            target,
            depths,
            votes,
        }))
    }

    /// The mask of a frame by what they say of it, along what its picture and depth show; with how sure each label is, 0–1.
    /// `None` where the picture cannot be read.
    ///
    /// # Errors
    /// [`MaskError::Stopped`].
    pub fn carry_to(
        &self,
        frame: usize,
        testimony: &Testimony,
        progress: &Progress,
    ) -> Result<Option<WalkedFrame>, MaskError> {
        let Some(image) = self.views.image(frame)? else {
            return Ok(None);
        };
        let seen = (&testimony.target, testimony.depths.as_slice());
        let (mask, confidence) = decide(&testimony.votes, seen, &image, self.options, progress)?;
        Ok(Some(WalkedFrame { mask, confidence }))
    }
}

/// Whether masks may go from an anchor to a frame.
fn reaches(direction: Direction, anchor: usize, frame: usize) -> bool {
    match direction {
        Direction::Both => true,
        Direction::Forward => anchor < frame,
        Direction::Backward => anchor > frame,
    }
}

/// What anchors say of a frame.
#[derive(Debug)]
pub(crate) struct Testimony {
    /// The frame.
    pub target: Viewpoint,
    /// Its depths, with what anchors show in its holes.
    pub depths: Vec<f32>,
    pub votes: Votes,
}

impl Testimony {
    /// The label of a pixel (0 = nothing) by the anchors that have a surface where the frame has one: it wins at least
    /// `share` of their weights, which sum to at least `weight`. `None` where no label does, and where the frame has no
    /// depth. Nothing being there counts where the anchors would know of the label `held` that the pixel has so far.
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
            .of_anchors
            .iter()
            .filter_map(|(_, sightings)| Some(sightings.at(pixel)?.0));
        let named = seen
            .filter(|&label| label != LabelId::NONE)
            .find(|&label| is_sure(label, label));
        named.or_else(|| is_sure(held, LabelId::NONE).then_some(LabelId::NONE))
    }

    /// Whether an anchor sees through the place of a pixel's surface, and none has it where the frame does: something came
    /// there.
    pub fn is_new(&self, pixel: usize) -> bool {
        let sightings = || self.votes.of_anchors.iter().map(|(_, sightings)| sightings);
        sightings().any(|seen| seen.is_through(pixel))
            && sightings().all(|seen| seen.at(pixel).is_none())
    }
}
