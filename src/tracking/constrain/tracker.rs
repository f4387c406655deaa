use std::collections::BTreeMap;
use std::sync::Arc;

use super::options::ConstrainOptions;
use super::run::Run;
use crate::carry::{Views, Witnesses};
use ostra_core::job::Progress;
use ostra_masks::{LabelId, LabelMask, MaskError, TrackRequest, TrackedFrame, Tracker};

/// Any tracker, its masks held against the anchors' masks carried through geometry: the positional relations that the
/// authors of the OSTRA method (Xu, Zhao, Tang, Gan, *A One Stop 3D Target Reconstruction and multilevel Segmentation
/// Method*) wish for to constrain it. Where a frame has depth and a camera and its surface is one that anchors see, their
/// label counts, but for borders of a few pixels; an object that is mostly elsewhere (swapped with another, drifted away,
/// lost) is given to the tracker anew on that frame. Geometry abstains where no anchor sees the frame's surface, as where
/// an object moved, and on frames without depth or camera.
pub struct ConstrainedTracker {
    /// The tracker.
    pub tracker: Box<dyn Tracker>,
    /// How its masks are held.
    pub options: ConstrainOptions,
}

impl Tracker for ConstrainedTracker {
    fn name(&self) -> &'static str {
        self.tracker.name()
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        progress: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        progress.stage("track")?;
        request.check()?;
        let carried = TrackRequest {
            anchors: chosen(request),
            ..request.clone()
        };
        let views = Views::new(&carried.frames, &carried.store);
        let witnesses = Witnesses::new(&self.options.carry, &carried, &views);
        check(request, &witnesses)?;
        let geometry = (&witnesses, &self.options);
        let mut lines = Run {
            tracker: &*self.tracker,
            request,
            geometry,
            progress,
        }
        .track(emit)?;
        lines.extend(views.warning());
        Ok(lines)
    }
}

/// The anchors' masks with the labels that are tracked only.
fn chosen(request: &TrackRequest) -> BTreeMap<usize, Arc<LabelMask>> {
    let Some(chosen) = &request.labels else {
        return request.anchors.clone();
    };
    let only = |mask: &LabelMask| {
        let ids = mask.ids.iter().map(|id| {
            if chosen.contains(id) {
                *id
            } else {
                LabelId::NONE
            }
        });
        LabelMask {
            ids: ids.collect(),
            ..*mask
        }
    };
    request
        .anchors
        .iter()
        .map(|(&frame, mask)| (frame, Arc::new(only(mask))))
        .collect()
}

/// Refuses what geometry can say nothing of.
fn check(request: &TrackRequest, witnesses: &Witnesses<'_>) -> Result<(), MaskError> {
    if witnesses.are_mute() {
        return Err(MaskError::Request(
            "masks can only be constrained where a frame with a mask has depth and a camera; give them (--depth, \
             --cameras, or reconstruct), or track without --constrain"
                .into(),
        ));
    }
    let mut targets =
        (request.from..=request.to).filter(|frame| !request.anchors.contains_key(frame));
    if !targets.any(|frame| witnesses.can_tell_of(frame)) {
        return Err(MaskError::Request(format!(
            "no frame from {} to {} besides the anchors has depth and a camera by which its mask could be constrained; \
             give them, or track without --constrain",
            request.from, request.to
        )));
    }
    Ok(())
}
