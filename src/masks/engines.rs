use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::{LabelId, LabelMask, MaskError, Prompt, PxBox, Region};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameStore, Image};

/// Turns prompts into the pixels of an object.
pub trait Segmenter: Send + Sync {
    /// Returns the segmenter's name on the command line, e.g. `builtin`.
    fn name(&self) -> &'static str;

    /// Does all work on a frame that needs no prompt, such as features or an encoder.
    ///
    /// It runs ahead of the prompts in the background.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or an error of the engine.
    fn prepare(
        &self,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError>;

    /// Prepares a frame for an engine that also depends on the camera pose and neighbouring frames.
    ///
    /// The default calls [`Self::prepare`].
    ///
    /// # Errors
    /// As [`Self::prepare`].
    fn prepare_frame(
        &self,
        _frame: &Frame,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError> {
        self.prepare(image, depth, progress)
    }

    /// Describes what the answers depend on besides the frame's own pixels.
    ///
    /// A prepared frame is valid only for an equal basis.
    fn basis(&self) -> String {
        String::new()
    }
}

/// A frame prepared by a [`Segmenter`], ready to answer prompts quickly.
pub trait PreparedFrame: Send + Sync {
    /// Returns the object's pixels.
    ///
    /// The pixel of every include click is inside, and that of every exclude click is outside.
    ///
    /// # Errors
    /// [`MaskError::Request`] for an empty prompt or one outside the image; [`MaskError::Stopped`]
    /// for slow engines.
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        progress: &Progress,
    ) -> Result<Region, MaskError>;

    /// Returns objects found without a prompt, the most confident first.
    ///
    /// Returns `None` when the segmenter only answers prompts.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or an error of the engine.
    fn proposals(&self, _progress: &Progress) -> Result<Option<Vec<Proposal>>, MaskError> {
        Ok(None)
    }

    /// Returns which segmenter answers a request and why, if the frame chooses among several.
    fn source(&self, _request: &SegmentRequest<'_>) -> Option<AnswerSource> {
        None
    }

    /// Returns the memory used in bytes, for the cache of prepared frames.
    fn bytes(&self) -> usize;
}

/// The segmenter that answers a request, and why it was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AnswerSource {
    /// Name on the command line, e.g. `geometry`.
    pub segmenter: &'static str,
    /// Reason in a few words, e.g. `a solid object`.
    pub reason: &'static str,
}

/// An object found without a prompt.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Pixels of the object.
    pub region: Region,
    /// Box around the pixels.
    pub extent: PxBox,
    /// Confidence of the segmenter, 0–1.
    pub score: f32,
    /// Stability of the border when the threshold changes, 0–1.
    pub stability: f32,
}

/// Input of [`PreparedFrame::segment`].
#[derive(Debug, Clone, Copy)]
pub struct SegmentRequest<'a> {
    /// All clicks and boxes given for the object on this frame.
    pub prompt: &'a Prompt,
    /// Answer before the last click, which the new answer refines; `None` for the first click.
    pub previous: Option<&'a Region>,
    /// Pixels that belong to other labels and must not be taken.
    pub taken: Option<&'a Region>,
}

/// Finds the objects that a text prompt names.
pub trait TextGrounder: Send + Sync {
    /// Returns the grounder's name on the command line, e.g. `yolox`.
    fn name(&self) -> &'static str;

    /// Returns the phrases that the grounder knows; `None` when it accepts any text.
    fn vocabulary(&self) -> Option<&'static [&'static str]>;

    /// Returns a box around every object that a phrase names, the most confident first.
    ///
    /// # Errors
    /// [`MaskError::Request`] when there is no phrase, or when one is not in the vocabulary, which
    /// the message lists; [`MaskError::Stopped`], or an error of the network.
    fn ground(
        &self,
        image: &Image,
        request: &GroundRequest<'_>,
        progress: &Progress,
    ) -> Result<Vec<Grounded>, MaskError>;
}

/// Input of [`TextGrounder::ground`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundRequest<'a> {
    /// Text prompts to look for.
    pub phrases: &'a [String],
    /// Minimum score of a box, 0–1; `None` for the grounder's default.
    pub threshold: Option<f32>,
}

/// An object that a phrase names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grounded {
    /// Index of the phrase in the request.
    pub phrase: usize,
    /// Box around the object, within the image.
    pub extent: PxBox,
    /// Confidence, 0–1.
    pub score: f32,
}

/// Direction in which masks are propagated from a keyframe.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    Default,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Every frame receives labels from keyframes on both sides.
    #[default]
    Both,
    /// From a keyframe to later frames.
    Forward,
    /// From a keyframe to earlier frames.
    Backward,
}

/// Input of a [`Tracker`], as snapshots of everything that it reads.
#[derive(Clone)]
pub struct TrackRequest {
    /// All frames of the project, in order.
    pub frames: Arc<Vec<Frame>>,
    /// Loads images and depth maps.
    pub store: Arc<FrameStore>,
    /// Masks of the keyframes by frame number, which stay fixed.
    ///
    /// Keyframes may lie outside the range. A label without pixels on a keyframe is unknown there,
    /// not absent.
    pub keyframes: BTreeMap<usize, Arc<LabelMask>>,
    /// First frame to track.
    pub from: usize,
    /// Last frame to track (inclusive).
    pub to: usize,
    /// Direction of propagation.
    pub direction: Direction,
    /// Labels to track; `None` for all labels on keyframes.
    ///
    /// A tracker may skip the work for other labels, but may also return them. The caller ignores
    /// labels that it did not request.
    pub labels: Option<BTreeSet<LabelId>>,
}

impl TrackRequest {
    /// Checks the range, the sizes of the masks, and that a keyframe has a label.
    ///
    /// # Errors
    /// [`MaskError::Request`] when the range or a keyframe is outside the project, when a mask does
    /// not have its frame's size, or when no keyframe has a labelled pixel.
    pub fn check(&self) -> Result<(), MaskError> {
        let count = self.frames.len();
        let last = self
            .keyframes
            .keys()
            .next_back()
            .copied()
            .unwrap_or(0)
            .max(self.to);
        if self.from > self.to || last >= count {
            let range = format!("frames {} to {last} are not all there", self.from.min(last));
            return Err(MaskError::Request(format!(
                "{range}; the project has {count}, counted from 0"
            )));
        }
        for (&frame, mask) in &self.keyframes {
            let frame = &self.frames[frame];
            if (mask.width, mask.height) != (frame.width, frame.height) {
                return Err(MaskError::Request(format!(
                    "the mask of {} is {}x{}, its image {}x{}; make the mask again",
                    frame.name, mask.width, mask.height, frame.width, frame.height
                )));
            }
        }
        if self
            .keyframes
            .values()
            .all(|mask| mask.ids.iter().all(|&id| id == LabelId::NONE))
        {
            return Err(MaskError::Request(
                "no frame has a mask to track; prompt or import one first".into(),
            ));
        }
        Ok(())
    }
}

/// Result of a [`Tracker`] for one frame.
#[derive(Debug, Clone)]
pub struct TrackedFrame {
    /// Frame number.
    pub frame: usize,
    /// Mask of the frame.
    pub mask: LabelMask,
    /// Confidence of the tracker for each label in the mask, 0–1.
    pub confidence: BTreeMap<LabelId, f32>,
    /// Whether a better result for this frame follows.
    ///
    /// Between two keyframes, the flow tracker reports the masks of its first pass at once. It
    /// replaces them where the second pass meets the first.
    pub preliminary: bool,
}

/// Propagates the masks of keyframes to the other frames.
pub trait Tracker: Send + Sync {
    /// Returns the tracker's name on the command line, e.g. `geometry`.
    fn name(&self) -> &'static str;

    /// Tracks the requested frames and returns warnings.
    ///
    /// Each finished frame is passed to `emit` at once, and again when a better result is found
    /// later. Keyframes are never emitted. Frames that cannot be tracked, for example without depth
    /// or camera, are skipped and named in the warnings.
    ///
    /// # Errors
    /// [`MaskError::Request`] when there is no keyframe or no frame that can be tracked;
    /// [`MaskError::Stopped`].
    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError>;
}
