use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::check_mask::ConsistencyOptions;
use super::checked_pass::{CheckedFrame, CheckedPass, ConsistencyReport, FrameSink, Geometry};
use crate::reprojection::{DepthViews, KeyframeViews};
use ostra_core::job::{Progress, Stopped};
use ostra_masks::{
    Direction, LabelId, LabelMask, MaskError, RunMask, TrackRequest, TrackedFrame, Tracker,
    WalkedFrame, merged,
};

/// A tracker whose masks are checked against the keyframes' masks re-projected by geometry.
///
/// These are the positional relations that the authors of the OSTRA method (Xu, Zhao, Tang, Gan, *A
/// One Stop 3D Target Reconstruction and multilevel Segmentation Method*) propose as a constraint.
/// On frames with depth and a camera, the keyframes' label counts wherever they see the surface,
/// except for borders of a few pixels. An object that is mostly elsewhere (swapped with another,
/// drifted away, lost) is given to the tracker again on that frame. Geometry abstains where no
/// keyframe sees the frame's surface, for example where an object moved, and on frames without
/// depth or camera.
///
/// The tracker runs in one direction at a time. Each of its masks is compared with the keyframes'
/// labels in that frame, which are computed ahead, one frame per thread. If an object drifted, the
/// tracker is stopped by its own part of the job's `Progress`. It restarts with the corrected mask
/// as a keyframe of this pass alone. The passes are merged by `merged`, as those of the flow
/// tracker are.
pub struct ConsistencyTracker {
    /// The wrapped tracker.
    pub tracker: Box<dyn Tracker>,
    /// Options of the check.
    pub options: ConsistencyOptions,
}

impl Tracker for ConsistencyTracker {
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
        let transferred = TrackRequest {
            keyframes: chosen(request),
            ..request.clone()
        };
        let views = DepthViews::new(&transferred.frames, &transferred.store);
        let keyframe_views = KeyframeViews::new(&self.options.transfer, &transferred, &views);
        check(request, &keyframe_views)?;
        let geometry = Geometry {
            keyframe_views: &keyframe_views,
            options: &self.options,
        };
        let mut lines = ConsistencyRun {
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

/// Returns the keyframes' masks, restricted to the labels that are tracked.
fn chosen(request: &TrackRequest) -> BTreeMap<usize, Arc<LabelMask>> {
    let Some(chosen) = &request.labels else {
        return request.keyframes.clone();
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
        .keyframes
        .iter()
        .map(|(&frame, mask)| (frame, Arc::new(only(mask))))
        .collect()
}

/// Rejects requests for which geometry gives no evidence.
fn check(request: &TrackRequest, keyframe_views: &KeyframeViews<'_>) -> Result<(), MaskError> {
    if keyframe_views.have_no_labels() {
        return Err(MaskError::Request(
            "masks can only be constrained where a frame with a mask has depth and a camera; give them (--depth, \
             --cameras, or reconstruct), or track without --constrain"
                .into(),
        ));
    }
    let mut targets =
        (request.from..=request.to).filter(|frame| !request.keyframes.contains_key(frame));
    if !targets.any(|frame| keyframe_views.can_give_evidence_for(frame)) {
        return Err(MaskError::Request(format!(
            "no frame from {} to {} other than the keyframes has depth and a camera to check its mask with; \
             give them, or track without --constrain",
            request.from, request.to
        )));
    }
    Ok(())
}

/// A tracking run of one or two passes; frames of both passes are merged.
pub struct ConsistencyRun<'a> {
    pub tracker: &'a dyn Tracker,
    pub request: &'a TrackRequest,
    pub geometry: Geometry<'a>,
    pub progress: &'a Progress,
}

/// A mask of the forward pass, kept for the backward pass.
struct KeptMask {
    runs: RunMask,
    confidence: BTreeMap<LabelId, f32>,
    steps: usize,
}

impl ConsistencyRun<'_> {
    /// Runs the passes; returns the report of the check and the tracker's warnings.
    pub fn track(&self, emit: &mut dyn FnMut(TrackedFrame)) -> Result<Vec<String>, MaskError> {
        let (forward, backward) = (
            self.targets(Direction::Forward),
            self.targets(Direction::Backward),
        );
        let total = forward.len() + backward.len();
        let (mut report, mut done) = (ConsistencyReport::default(), 0);
        let mut kept: BTreeMap<usize, KeptMask> = BTreeMap::new();
        let mut hand_on =
            |frame: usize, walked: WalkedFrame, preliminary: bool| -> Result<(), Stopped> {
                emit(TrackedFrame {
                    frame,
                    mask: walked.mask,
                    confidence: walked.confidence,
                    preliminary,
                });
                done += 1;
                self.progress.step(done.min(total), total)
            };
        let first = self.run_pass(
            Direction::Forward,
            &forward,
            &mut report,
            &mut |CheckedFrame {
                      frame,
                      walked,
                      steps,
                  }| {
                if backward.contains(&frame) {
                    let runs = RunMask::encode(&walked.mask);
                    kept.insert(
                        frame,
                        KeptMask {
                            runs,
                            confidence: walked.confidence.clone(),
                            steps,
                        },
                    );
                }
                hand_on(frame, walked, backward.contains(&frame))
            },
        );
        let first = unless_stopped(first)?;
        let second = self.run_pass(
            Direction::Backward,
            &backward,
            &mut report,
            &mut |CheckedFrame {
                      frame,
                      walked,
                      steps,
                  }| {
                let met = kept.remove(&frame).map(|kept| kept.met_by(&walked, steps));
                hand_on(frame, met.unwrap_or(walked), false)
            },
        );
        let second = unless_stopped(second)?;
        // Frames that the backward pass did not reach.
        for (
            frame,
            KeptMask {
                runs, confidence, ..
            },
        ) in kept
        {
            hand_on(
                frame,
                WalkedFrame {
                    mask: runs.decode(),
                    confidence,
                },
                false,
            )?;
        }
        let mut lines = report.lines(&self.request.frames);
        for ended in [first, second] {
            match ended {
                Err(error) if done == 0 => return Err(error),
                ended => lines.extend(ended.unwrap_or_else(|error| vec![error.to_string()])),
            }
        }
        Ok(lines)
    }

    /// Returns the requested frames that have a keyframe on the side the pass comes from.
    fn targets(&self, way: Direction) -> BTreeSet<usize> {
        let TrackRequest {
            keyframes,
            from,
            to,
            direction,
            ..
        } = self.request;
        let is_walked = *direction == Direction::Both || *direction == way;
        let is_reached = |frame: &usize| match way {
            Direction::Backward => keyframes.range(frame..).next().is_some(),
            _ => keyframes.range(..frame).next().is_some(),
        };
        let others = (*from..=*to).filter(|frame| is_walked && !keyframes.contains_key(frame));
        others.filter(is_reached).collect()
    }

    fn run_pass(
        &self,
        way: Direction,
        targets: &BTreeSet<usize>,
        report: &mut ConsistencyReport,
        sink: &mut FrameSink<'_>,
    ) -> Result<Vec<String>, MaskError> {
        if targets.is_empty() {
            return Ok(Vec::new());
        }
        let request = TrackRequest {
            direction: way,
            ..self.request.clone()
        };
        CheckedPass::new(
            self.tracker,
            request,
            targets.clone(),
            self.geometry,
            self.progress,
        )
        .follow(report, sink)
    }
}

/// Returns an error only for a stop; if one pass fails, the other may still succeed.
fn unless_stopped(
    ended: Result<Vec<String>, MaskError>,
) -> Result<Result<Vec<String>, MaskError>, Stopped> {
    match ended {
        Err(MaskError::Stopped(stopped)) => Err(stopped),
        ended => Ok(ended),
    }
}

impl KeptMask {
    /// Merges this mask with that of the other pass, `steps` after its start.
    fn met_by(self, other: &WalkedFrame, steps: usize) -> WalkedFrame {
        let nearness = steps as f32 / (steps + self.steps) as f32;
        merged(
            &WalkedFrame {
                mask: self.runs.decode(),
                confidence: self.confidence,
            },
            other,
            nearness,
        )
    }
}
