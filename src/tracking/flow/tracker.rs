use std::collections::VecDeque;
use std::sync::Arc;

use super::change::{FlowCache, FrameChange};
use super::dis::Finest;
use super::evidence::FrameAhead;
use super::memory::DenseFeatures;
use super::objects::TrackedObjects;
use super::options::FlowOptions;
use super::tracked_image::{ImageCache, TrackedImage, enlarged_mask, reduced_mask, working_size};
use crate::propagate::{
    KeyframeUse, LookAhead, MaskPropagator, PassFrame, PassResult, Section, propagate,
};
use ostra_core::image::ImageSize;
use ostra_core::job::Progress;
use ostra_masks::{
    Direction, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker, WalkedFrame, merged,
};

/// Propagates masks through videos and photos without depth or network weights.
#[derive(Debug, Clone, Default)]
pub struct FlowTracker {
    /// Options of the propagation.
    pub options: FlowOptions,
    /// Computes image features by which object parts are recognized from the keyframes.
    pub features: Option<Arc<dyn DenseFeatures>>,
}

impl Tracker for FlowTracker {
    fn name(&self) -> &'static str {
        "flow"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        let make = |section: &Section| -> Box<dyn MaskPropagator + '_> {
            Box::new(FlowPropagator::new(self, request, section, progress))
        };
        propagate(request, KeyframeUse::Interval, emit, progress, &make)
    }
}

/// Number of steps of the first pass that are kept for the second; 15 MB each at 854×480.
///
/// This covers all steps between keyframes up to eight frames apart. The second pass needs the
/// latest steps of the first one first. Between keyframes four frames apart, the cache saves a
/// third of the time (`cargo bench --bench flow -- --every 4`).
const KEPT_STEPS: usize = 8;

/// Factor by which the second pass counts as nearer when two passes are merged.
///
/// The second pass has used the result of the first. Weights go by the square, so its outline has
/// nine times the weight.
const SECOND: f32 = 3.0;

/// Propagates masks through one interval, from both of its ends.
///
/// Between two keyframes, few frames are corrected and each should be precise. There, images are
/// larger, flow is measured at full resolution, and the mask of the frame ahead counts too, if it
/// is known.
struct FlowPropagator<'a> {
    options: &'a FlowOptions,
    progress: &'a Progress,
    size: ImageSize,
    is_between: bool,
    changes: FlowEstimator<'a>,
    objects: Option<TrackedObjects<'a>>,
    /// Images of the pass's keyframes, kept so that they are not computed again.
    keyframes: Vec<Arc<TrackedImage>>,
    /// Image that the current masks belong to.
    last: Option<Arc<TrackedImage>>,
    /// Flow from `last` to the frames after it, as far as it is measured.
    measured: VecDeque<FrameChange>,
    /// Error of the last measurement; reported when the next step is due.
    failed: Option<MaskError>,
}

/// Measures the optical flow between frames.
struct FlowEstimator<'a> {
    images: ImageCache<'a>,
    flows: FlowCache,
    finest: Finest,
}

impl FlowEstimator<'_> {
    fn change_to(
        &mut self,
        last: &Arc<TrackedImage>,
        frame: &PassFrame,
    ) -> Result<FrameChange, MaskError> {
        let next = self.images.get(frame)?;
        Ok(self.flows.change(last, &next, self.finest))
    }

    /// Measures the flow to the frame `place` frames ahead; `None` beyond the end of the pass.
    fn change_to_frame_ahead(
        &mut self,
        last: &Arc<TrackedImage>,
        ahead: &mut LookAhead<'_, '_>,
        place: usize,
    ) -> Result<Option<FrameChange>, MaskError> {
        let frame = ahead.frame(place)?;
        frame.map(|frame| self.change_to(last, &frame)).transpose()
    }
}

impl<'a> FlowPropagator<'a> {
    fn new(
        tracker: &'a FlowTracker,
        request: &TrackRequest,
        section: &Section,
        progress: &'a Progress,
    ) -> Self {
        let options = &tracker.options;
        let is_between = section.has_both_passes();
        let (most_side, finest, kept_steps) = if is_between {
            (options.most_side_between, Finest::Full, KEPT_STEPS)
        } else {
            (options.most_side, Finest::Half, 0)
        };
        let first = section.keyframes.keys().next();
        let of = first.map(|&frame| &request.frames[frame]);
        let size = of.map_or(ImageSize::new(1, 1), |of| {
            working_size(of.width, of.height, most_side)
        });
        Self {
            options,
            progress,
            size,
            is_between,
            changes: FlowEstimator {
                images: ImageCache::new(size, tracker.features.as_deref()),
                flows: FlowCache::keeping(kept_steps),
                finest,
            },
            objects: None,
            keyframes: Vec::new(),
            last: None,
            measured: VecDeque::new(),
            failed: None,
        }
    }

    /// Measures the flow to `frame` and, between keyframes, from there to the frame after it.
    fn measure(
        &mut self,
        last: &Arc<TrackedImage>,
        frame: &PassFrame,
        ahead: &mut LookAhead<'_, '_>,
    ) -> Result<FrameChange, MaskError> {
        let change = match self.measured.pop_front() {
            Some(change) => change,
            None => self.changes.change_to(last, frame)?,
        };
        if self.is_between && self.measured.is_empty() {
            let next = self.changes.change_to_frame_ahead(&change.next, ahead, 0)?;
            self.measured.extend(next);
        }
        Ok(change)
    }
}

/// Returns the frame ahead with its mask, if that is known; `change` leads to it.
fn frame_ahead<'c>(
    change: &'c FrameChange,
    ahead: &mut LookAhead<'_, '_>,
) -> Result<Option<FrameAhead<'c>>, MaskError> {
    let known = ahead.frame(0)?.and_then(|frame| ahead.mask(frame.index));
    let size = ImageSize::new(change.next.width, change.next.height);
    Ok(known.map(|known| FrameAhead {
        change,
        mask: reduced_mask(&known.mask, size),
        share: known.share,
    }))
}

impl MaskPropagator for FlowPropagator<'_> {
    fn start_pass(&mut self, direction: Direction) {
        if direction == Direction::Backward {
            self.changes.flows.keep_no_more();
        }
        self.objects = None;
        self.keyframes.clear();
        self.last = None;
        self.measured.clear();
        self.failed = None;
    }

    fn add_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError> {
        let image = self.changes.images.get(frame)?;
        let mask = reduced_mask(mask, self.size);
        self.objects = Some(TrackedObjects::new(self.options, &image, &mask));
        self.keyframes.push(Arc::clone(&image));
        self.last = Some(image);
        Ok(())
    }

    fn add_far_keyframe(&mut self, frame: &PassFrame, mask: &LabelMask) -> Result<(), MaskError> {
        let image = self.changes.images.get(frame)?;
        if let Some(objects) = &mut self.objects {
            objects.learn(&image, &reduced_mask(mask, self.size));
        }
        self.keyframes.push(image);
        Ok(())
    }

    fn transfer_to(
        &mut self,
        frame: &PassFrame,
        ahead: &mut LookAhead<'_, '_>,
    ) -> Result<PassResult, MaskError> {
        if let Some(error) = self.failed.take() {
            return Err(error);
        }
        let (Some(mut objects), Some(last)) = (self.objects.take(), self.last.take()) else {
            return Err(MaskError::Request(
                "there is no mask to track; prompt or import one first".into(),
            ));
        };
        let change = self.measure(&last, frame, ahead)?;
        let next = Arc::clone(&change.next);
        let farthest = self.measured.back().map_or(&next, |change| &change.next);
        let farthest = Arc::clone(farthest);
        let place = self.measured.len();
        let frame_ahead = match self.measured.front() {
            Some(change) => frame_ahead(change, ahead)?,
            None => None,
        };
        let (progress, changes) = (self.progress, &mut self.changes);
        let (answer, further) = rayon::join(
            || objects.advance(change, frame_ahead.as_ref(), progress),
            || changes.change_to_frame_ahead(&farthest, ahead, place),
        );
        let answer = answer?;
        match further {
            Ok(further) => self.measured.extend(further),
            Err(error) => self.failed = Some(error),
        }
        self.objects = Some(objects);
        self.last = Some(next);
        Ok(answer)
    }

    fn merge(&self, first: &PassResult, second: &PassResult, nearness: f32) -> PassResult {
        let walked = |answer: &PassResult| WalkedFrame {
            mask: answer.mask.clone(),
            confidence: answer.confidence.clone(),
        };
        let nearness = nearness / (nearness + SECOND * (1.0 - nearness));
        let WalkedFrame { mask, confidence } = merged(&walked(first), &walked(second), nearness);
        PassResult {
            known: confidence.keys().copied().collect(),
            mask,
            confidence,
            probabilities: None,
        }
    }

    fn mask_of_frame(&self, answer: &PassResult, width: u32, height: u32) -> LabelMask {
        enlarged_mask(&answer.mask, width, height)
    }
}
