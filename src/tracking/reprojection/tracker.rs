use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::depth_view::DepthViews;
use super::keyframe_views::KeyframeViews;
use super::options::ReprojectionOptions;
use ostra_cloud::fuse::naming;
use ostra_core::job::Progress;
use ostra_masks::{MaskError, TrackRequest, TrackedFrame, Tracker, WalkedFrame};

/// A tracker that re-projects masks between frames of a static scene.
///
/// The frames need depth and cameras. The label of a surface in a keyframe applies in every frame
/// that sees the surface, whatever frames lie in between. The authors of the OSTRA method (Xu,
/// Zhao, Tang, Gan, *A One Stop 3D Target Reconstruction and multilevel Segmentation Method*) name
/// this as their next step.
#[derive(Debug, Clone, Copy, Default)]
pub struct GeometryTracker {
    /// Options of the re-projection.
    pub options: ReprojectionOptions,
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
        let views = DepthViews::new(&request.frames, &request.store);
        let run = ReprojectionRun::new(&self.options, request, &views, progress)?;
        let missed = run.transfer_all(emit)?;
        Ok(run.warnings(&missed))
    }
}

/// One run of the tracker over a request.
pub struct ReprojectionRun<'a> {
    request: &'a TrackRequest,
    views: &'a DepthViews<'a>,
    progress: &'a Progress,
    keyframe_views: KeyframeViews<'a>,
    /// Frames that get a mask.
    targets: Vec<usize>,
    /// Keyframes and frames without depth or camera.
    left_out: Vec<usize>,
    done: AtomicUsize,
}

impl<'a> ReprojectionRun<'a> {
    /// Checks the request and prepares the run.
    pub fn new(
        options: &'a ReprojectionOptions,
        request: &'a TrackRequest,
        views: &'a DepthViews<'a>,
        progress: &'a Progress,
    ) -> Result<Self, MaskError> {
        request.check()?;
        let mut keyframe_views = KeyframeViews::new(options, request, views);
        check_keyframes(&keyframe_views)?;
        let others =
            (request.from..=request.to).filter(|frame| !request.keyframes.contains_key(frame));
        let (targets, without): (Vec<usize>, Vec<usize>) = others
            .filter(|&frame| keyframe_views.reach(frame))
            .partition(|&frame| keyframe_views.can_give_evidence_for(frame));
        let mut left_out = std::mem::take(&mut keyframe_views.left_out);
        left_out.extend(without);
        if targets.is_empty() {
            return Err(MaskError::Request(format!(
                "no frame from {} to {} other than the keyframes has depth and a camera for re-projection; add or reconstruct both first, or track with 'flow'",
                request.from, request.to
            )));
        }
        let done = AtomicUsize::new(0);
        Ok(Self {
            request,
            views,
            progress,
            keyframe_views,
            targets,
            left_out,
            done,
        })
    }

    /// Re-projects masks to all targets and emits them in order.
    ///
    /// Finished masks are emitted even if a later target fails. Returns the targets without a mask
    /// because they, or all keyframes with evidence for them, cannot be read.
    ///
    /// # Errors
    /// Returns the reading error if no target gets a mask, or [`MaskError::Stopped`].
    pub fn transfer_all(
        &self,
        emit: &mut dyn FnMut(TrackedFrame),
    ) -> Result<Vec<usize>, MaskError> {
        let mut missed = Vec::new();
        for chunk in self.targets.chunks(4 * rayon::current_num_threads()) {
            let answers: Vec<Result<Option<TrackedFrame>, MaskError>> = chunk
                .par_iter()
                .map(|&frame| self.transfer_to(frame))
                .collect();
            let mut failed = None;
            for (&frame, answer) in chunk.iter().zip(answers) {
                match answer {
                    Ok(Some(tracked)) => emit(tracked),
                    Ok(None) => missed.push(frame),
                    Err(error) => failed = failed.or(Some(error)),
                }
            }
            failed.map_or(Ok(()), Err)?;
        }
        match (missed.len() == self.targets.len())
            .then(|| self.views.failure())
            .flatten()
        {
            Some(error) => Err(error),
            None => Ok(missed),
        }
    }

    /// Returns lines that name skipped frames, unreadable frames and readable `missed` frames.
    pub fn warnings(&self, missed: &[usize]) -> Vec<String> {
        let name = |&frame: &usize| self.request.frames[frame].name.as_str();
        let left_out: Vec<&str> = self.left_out.iter().map(name).collect();
        let silent: Vec<&str> = missed
            .iter()
            .filter(|&&frame| !self.views.is_unread(frame))
            .map(name)
            .collect();
        let lines = [
            naming(
                [
                    "was left out, as it has no depth or no camera",
                    "were left out, as they have no depth or no camera",
                ],
                &left_out,
            ),
            self.views.warning(),
            naming(
                [
                    "got no mask, as no frame that shows the same and has a mask can be read",
                    "got no mask, as no frame that shows the same and has a mask can be read",
                ],
                &silent,
            ),
        ];
        lines.into_iter().flatten().collect()
    }

    /// Re-projects masks to one frame.
    ///
    /// Returns `None` if the frame, or all keyframes with evidence for it, cannot be read.
    fn transfer_to(&self, frame: usize) -> Result<Option<TrackedFrame>, MaskError> {
        let transferred = match self.keyframe_views.evidence_for(frame, self.progress)? {
            Some(votes) => self
                .keyframe_views
                .transfer_to(frame, &votes, self.progress)?,
            None => None,
        };
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.progress.step(done, self.targets.len())?;
        let tracked = |WalkedFrame { mask, confidence }| TrackedFrame {
            frame,
            mask,
            confidence,
            preliminary: false,
        };
        Ok(transferred.map(tracked))
    }
}

fn check_keyframes(keyframe_views: &KeyframeViews<'_>) -> Result<(), MaskError> {
    if keyframe_views.have_no_labels() {
        return Err(MaskError::Request(
            "the geometry tracker needs depth and a camera on a frame with a mask; \
             give them (--depth, --cameras) or choose another tracker"
                .into(),
        ));
    }
    Ok(())
}
