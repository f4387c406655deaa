use super::options::CarryOptions;
use super::run::Run;
use super::views::Views;
use ostra_core::job::Progress;
use ostra_masks::{MaskError, TrackRequest, TrackedFrame, Tracker};

/// Carries masks between the frames of a static scene that have depth and cameras: what an anchor's mask says of a
/// surface, it says of it in every frame that sees it, whatever lies between them. The next step that the authors of the
/// OSTRA method (Xu, Zhao, Tang, Gan, *A One Stop 3D Target Reconstruction and multilevel Segmentation Method*) name.
#[derive(Debug, Clone, Copy, Default)]
pub struct GeometryTracker {
    /// How masks are carried.
    pub options: CarryOptions,
}

impl Tracker for GeometryTracker {
    fn name(&self) -> &'static str {
        "geometry"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        progress.stage("track")?;
        let views = Views::new(&request.frames, &request.store);
        let run = Run::new(&self.options, request, &views, progress)?;
        let missed = run.carry_all(emit)?;
        Ok(run.warnings(&missed))
    }
}
