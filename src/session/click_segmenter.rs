use std::sync::Arc;

use anyhow::Result;

use crate::prepared::Prompting;
use crate::{PromptRequest, engines};
use ostra_frames::{Frame, FrameStore};
use ostra_masks::graph_cut::BuiltinSegmenter;
use ostra_masks::{AnswerSource, Segmenter};
use ostra_project::SegmenterId;
use ostra_tracking::supervoxels::{BOX, unfit};

/// Reason for the built-in segmenter while a frame is prepared for geometry.
const NOT_READY: &str = "the frame is still being prepared for geometry";

/// The segmenter that answers a click on a frame at once.
pub(crate) struct ClickSegmenter {
    pub(crate) segmenter: Arc<dyn Segmenter>,
    /// The reason, if `auto` was requested and chose before the click was answered.
    pub(crate) reason: Option<&'static str>,
    /// Whether the frame allows several segmenters, one of which is chosen for each click.
    pub(crate) chooses: bool,
}

impl ClickSegmenter {
    fn known(segmenter: Arc<dyn Segmenter>, reason: Option<&'static str>) -> Self {
        Self {
            segmenter,
            reason,
            chooses: false,
        }
    }

    /// Returns whether geometry would be chosen once the frame is prepared for it.
    pub(crate) fn is_early(&self) -> bool {
        self.reason == Some(NOT_READY)
    }

    /// Returns the segmenter of an answer and the reason for it, if `auto` was requested.
    ///
    /// `found` is the choice for the click itself.
    pub(crate) fn source(&self, found: Option<AnswerSource>) -> Option<AnswerSource> {
        let known = |reason| AnswerSource {
            segmenter: self.segmenter.name(),
            reason,
        };
        found.or(self.reason.map(known))
    }
}

impl Prompting {
    /// Returns the segmenter for a prompt on a frame.
    ///
    /// While a job prepares the frame (`is_working`), clicks do not wait for geometry. Boxes never
    /// do, because it does not answer them.
    ///
    /// # Errors
    ///
    /// Returns an error if the segmenter is not installed.
    pub(crate) fn for_clicks(
        &mut self,
        request: &PromptRequest,
        frames: &Arc<Vec<Frame>>,
        frame: &Frame,
        store: &Arc<FrameStore>,
        is_working: bool,
    ) -> Result<ClickSegmenter> {
        let (id, geometry) = (request.segmenter, self.geometry_for(frames, store));
        let Some(fitting) = engines::fitting_segmenter(id, &geometry) else {
            let installed = (id == SegmenterId::Auto).then_some("it is installed");
            let segmenter = engines::segmenter(id, geometry)?;
            return Ok(ClickSegmenter::known(segmenter, installed));
        };
        let is_boxed = !request.prompt.boxes.is_empty();
        if let Some(reason) = unfit(frames, frame).or(is_boxed.then_some(BOX)) {
            return Ok(ClickSegmenter::known(
                Arc::new(BuiltinSegmenter),
                Some(reason),
            ));
        }
        let is_being_prepared = is_working
            && self
                .preparing
                .as_ref()
                .is_some_and(|preparation| preparation.is_of(frames, &frame.name));
        let is_early = is_being_prepared && self.prepared.ready(&fitting, frame).is_none();
        Ok(ClickSegmenter {
            segmenter: if is_early {
                Arc::new(BuiltinSegmenter)
            } else {
                Arc::new(fitting)
            },
            reason: is_early.then_some(NOT_READY),
            chooses: true,
        })
    }
}
