use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::{LabelId, LabelMask, MaskError, Prompt, PxBox, Region};
use ostra_core::job::Progress;
use ostra_frames::{DepthMap, Frame, FrameStore, Image};

/// Turns prompts into the pixels of an object.
pub trait Segmenter: Send + Sync {
    /// Its name on the command line, e.g. `builtin`.
    fn name(&self) -> &'static str;

    /// Does all the work on a frame that no prompt is needed for (features, encoder); run ahead in the background.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or what the engine says.
    fn prepare(
        &self,
        image: &Arc<Image>,
        depth: Option<&Arc<DepthMap>>,
        progress: &Progress,
    ) -> Result<Arc<dyn PreparedFrame>, MaskError>;

    /// The same for an engine to which it matters where the frame was taken from and what lies around it.
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

    /// What else than a frame's own pixels its answers rest on: a prepared frame is good for the same basis only.
    fn basis(&self) -> String {
        String::new()
    }
}

/// A frame made ready by a [`Segmenter`]; answers prompts quickly.
pub trait PreparedFrame: Send + Sync {
    /// The object's pixels. Every include click is inside, every exclude click outside.
    ///
    /// # Errors
    /// [`MaskError::Request`] for an empty prompt or one outside the picture; [`MaskError::Stopped`] where it takes long.
    fn segment(
        &self,
        request: &SegmentRequest<'_>,
        progress: &Progress,
    ) -> Result<Region, MaskError>;

    /// Things found without a prompt, the most confident first; `None` where the segmenter only answers prompts.
    ///
    /// # Errors
    /// [`MaskError::Stopped`], or what the engine says.
    fn proposals(&self, _progress: &Progress) -> Result<Option<Vec<Proposal>>, MaskError> {
        Ok(None)
    }

    /// Bytes held, for the cache of prepared frames.
    fn bytes(&self) -> usize;
}

/// A thing found without a prompt.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Its pixels.
    pub region: Region,
    /// Box around them.
    pub extent: PxBox,
    /// How sure the segmenter is, 0–1.
    pub score: f32,
    /// How little its border depends on a threshold, 0–1.
    pub stability: f32,
}

/// What is asked of a [`PreparedFrame`].
#[derive(Debug, Clone, Copy)]
pub struct SegmentRequest<'a> {
    /// All clicks and boxes given for the object on this frame.
    pub prompt: &'a Prompt,
    /// The answer before the last click, which the new one refines; none for the first.
    pub previous: Option<&'a Region>,
    /// Pixels that belong to other labels and may not be taken.
    pub taken: Option<&'a Region>,
}

/// Finds what words name.
pub trait TextGrounder: Send + Sync {
    /// Its name on the command line, e.g. `yolox`.
    fn name(&self) -> &'static str;

    /// The only words that it knows; `None` where any can be tried.
    fn vocabulary(&self) -> Option<&'static [&'static str]>;

    /// A box around everything that one of the phrases names, the surest first.
    ///
    /// # Errors
    /// [`MaskError::Request`] for no phrase, or one that is not in the vocabulary, which it tells;
    /// [`MaskError::Stopped`], or what the network says.
    fn ground(
        &self,
        image: &Image,
        request: &GroundRequest<'_>,
        progress: &Progress,
    ) -> Result<Vec<Grounded>, MaskError>;
}

/// What is asked of a [`TextGrounder`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundRequest<'a> {
    /// What to look for, in words.
    pub phrases: &'a [String],
    /// Least score of a box, 0–1; `None` = what suits the grounder.
    pub threshold: Option<f32>,
}

/// A thing that a phrase names.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grounded {
    /// Number of the phrase, from 0.
    pub phrase: usize,
    /// Box around the thing, within the picture.
    pub extent: PxBox,
    /// How sure it is, 0–1.
    pub score: f32,
}

/// Which way masks are carried from an anchor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Every frame takes from anchors on both sides.
    #[default]
    Both,
    /// From an anchor to later frames.
    Forward,
    /// From an anchor to earlier frames.
    Backward,
}

/// What a [`Tracker`] is given: snapshots of everything it reads.
#[derive(Clone)]
pub struct TrackRequest {
    /// All frames of the project, in order.
    pub frames: Arc<Vec<Frame>>,
    /// Where pictures and depths are loaded.
    pub store: Arc<FrameStore>,
    /// The masks that are held fixed, by frame number; they may lie outside the range. A label that such a mask does not show is
    /// unknown there, not absent.
    pub anchors: BTreeMap<usize, Arc<LabelMask>>,
    /// First frame to track.
    pub from: usize,
    /// Last frame to track (included).
    pub to: usize,
    /// Which way masks go.
    pub direction: Direction,
    /// Only these labels are wanted; `None` = all that anchors show. A tracker may spare the work for the others; it
    /// need not: who asks takes no more than was asked for.
    pub labels: Option<BTreeSet<LabelId>>,
}

impl TrackRequest {
    /// Refuses a range that is not there, a mask that does not fit its frame, and anchors that show nothing.
    ///
    /// # Errors
    /// [`MaskError::Request`].
    pub fn check(&self) -> Result<(), MaskError> {
        let count = self.frames.len();
        let last = self
            .anchors
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
        for (&frame, mask) in &self.anchors {
            let frame = &self.frames[frame];
            if (mask.width, mask.height) != (frame.width, frame.height) {
                return Err(MaskError::Request(format!(
                    "the mask of {} is {}x{}, its picture {}x{}; make the mask anew",
                    frame.name, mask.width, mask.height, frame.width, frame.height
                )));
            }
        }
        if self
            .anchors
            .values()
            .all(|mask| mask.ids.iter().all(|&id| id == LabelId::NONE))
        {
            return Err(MaskError::Request(
                "no frame has a mask to carry; prompt or import one first".into(),
            ));
        }
        Ok(())
    }
}

/// One frame's answer of a [`Tracker`].
#[derive(Debug, Clone)]
pub struct TrackedFrame {
    /// Frame number.
    pub frame: usize,
    /// Its mask.
    pub mask: LabelMask,
    /// Per label in the mask, how sure the tracker is, 0–1.
    pub confidence: BTreeMap<LabelId, f32>,
    /// A better answer for this frame is still to come: between two keyframes the flow tracker reports the masks of its first
    /// pass at once and replaces them where the second pass meets it.
    pub preliminary: bool,
}

/// Carries anchors' masks to the other frames.
pub trait Tracker: Send + Sync {
    /// Its name on the command line, e.g. `geometry`.
    fn name(&self) -> &'static str;

    /// Tracks; hands each finished frame to `emit` as soon as it is done, never an anchor; again when a better answer is
    /// found later. Frames that it cannot answer (no depth, no camera) are left out and named in the warnings returned.
    ///
    /// # Errors
    /// [`MaskError::Request`] when there is no anchor or no frame that can be answered; [`MaskError::Stopped`].
    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError>;
}
