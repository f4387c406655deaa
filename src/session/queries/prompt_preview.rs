use std::sync::Arc;

use crate::PromptRequest;
use crate::prepared::PreparedFrames;
use crate::query::QueryKey;
use ostra_core::job::Progress;
use ostra_frames::FrameStore;
use ostra_masks::{LabelId, LabelMask, RunMask, Segmenter};
use ostra_project::Project;
use ostra_project::prompt::PromptMeaning;

/// A prompt that was not sent yet.
impl QueryKey for PromptRequest {
    const TITLE: &'static str = "preview prompt";

    /// Work on another prompt continues, because it prepares the frame for all prompts.
    fn is_obsolete(&self, _wanted: &Self) -> bool {
        false
    }
}

/// Tools that answer a prompt.
pub(crate) struct PromptTools {
    pub(crate) segmenter: Arc<dyn Segmenter>,
    pub(crate) prepared: Arc<PreparedFrames>,
    pub(crate) store: Arc<FrameStore>,
}

/// Returns the pixels that a prompt would select, as a mask of its label.
///
/// Returns `None` if the prompt cannot be answered. The error is reported when the prompt is sent.
pub(crate) fn preview_prompt(
    project: &Project,
    request: &PromptRequest,
    tools: &PromptTools,
    progress: &Progress,
) -> Option<Arc<RunMask>> {
    let frame = project.frames.get(request.frame)?;
    let segmenter = tools.segmenter.as_ref();
    let ready = tools
        .prepared
        .get(segmenter, frame, &tools.store, progress)
        .ok()?;
    let meaning = PromptMeaning::new(project, request).ok()?;
    let image = tools.store.image(frame).ok()?;
    let region = meaning.segment(ready.as_ref(), &image, progress).ok()?;
    let id = |&inside: &bool| if inside { request.label } else { LabelId::NONE };
    let ids = region.inside.iter().map(id).collect();
    Some(Arc::new(RunMask::encode(&LabelMask {
        width: region.width,
        height: region.height,
        ids,
    })))
}
