use crate::{ResultEngine, TrackerId};
use std::sync::Arc;

use crate::{Edit, FrameMask, Marks, MaskOrigin, Project, ResultKind};
use ostra_frames::{DepthSource, Frame, FrameCamera};
use ostra_masks::{Label, LabelId};

impl Project {
    /// Returns the edits that mark as stale what depends on the data that `edit` changes.
    ///
    /// They are to be applied after it, in the same step. Stale results are kept. New frames make
    /// nothing stale.
    #[must_use]
    pub fn consequences(&self, edit: &Edit) -> Vec<Edit> {
        match edit {
            Edit::SetMask { frame, mask } => self.after_mask(*frame, mask.as_ref()),
            Edit::SetMarks { label, marks } => self.after_marks(*label, marks),
            Edit::SetLabel { id, label } => self.after_label(self.labels.get(*id), label.as_ref()),
            Edit::SetCamera { frame, camera } => self.after_camera(*frame, camera.as_ref()),
            Edit::SetDepth { frame, depth } => self.after_depth(*frame, depth),
            Edit::SetFrame { frame, value } => self.after_frame(*frame, value),
            Edit::SetPrompt { .. }
            | Edit::SetStale { .. }
            | Edit::SetOrigin { .. }
            | Edit::AddFrames { .. }
            | Edit::DropFrames { .. }
            | Edit::SetResult { .. } => Vec::new(),
        }
    }

    /// Returns the frames with tracked masks that a keyframe on `frame` influences.
    ///
    /// These are all of them if the tracking used geometry, and otherwise those up to the next
    /// keyframe on each side.
    #[must_use]
    pub fn reach(&self, frame: usize) -> Vec<usize> {
        let everywhere = self
            .results
            .get(&ResultKind::Tracking)
            .is_some_and(|record| record.engine == ResultEngine::Tracker(TrackerId::Geometry));
        if everywhere {
            return self
                .tracked(0, usize::MAX)
                .filter(|&number| number != frame)
                .collect();
        }
        let (first, last) = self.neighbour_keyframes(frame);
        self.tracked(first.unwrap_or(0), last.unwrap_or(usize::MAX))
            .filter(|&number| number != frame)
            .collect()
    }

    fn tracked(&self, first: usize, last: usize) -> impl Iterator<Item = usize> {
        let of = |mask: &FrameMask| mask.origin == MaskOrigin::Tracked;
        self.masks
            .range(first..=last)
            .filter(move |(_, mask)| of(mask))
            .map(|(&number, _)| number)
    }

    fn after_mask(&self, frame: usize, mask: Option<&FrameMask>) -> Vec<Edit> {
        let before = self.masks.get(&frame);
        let same_pixels = match (before, mask) {
            (Some(a), Some(b)) => Arc::ptr_eq(&a.runs, &b.runs) || a.runs == b.runs,
            (a, b) => a.is_none() && b.is_none(),
        };
        if same_pixels {
            return Vec::new();
        }
        let is_keyframe =
            |mask: Option<&FrameMask>| mask.is_some_and(|mask| mask.origin == MaskOrigin::Keyframe);
        let mut edits = Vec::new();
        if is_keyframe(before) || is_keyframe(mask) {
            edits.extend(self.stale_masks(self.reach(frame)));
        }
        edits.extend(self.stale_result(ResultKind::Cloud));
        edits
    }

    /// Hidden labels do not vote, so hiding or showing a label makes the cloud stale.
    fn after_marks(&self, label: LabelId, marks: &Marks) -> Vec<Edit> {
        let changed = self.marks_of(label).hidden != marks.hidden;
        if changed {
            self.stale_result(ResultKind::Cloud).into_iter().collect()
        } else {
            Vec::new()
        }
    }

    /// A cloud holds the names and parents of labels. Colours are looked up when drawing.
    fn after_label(&self, before: Option<&Label>, label: Option<&Label>) -> Vec<Edit> {
        let (Some(before), Some(label)) = (before, label) else {
            return Vec::new();
        };
        let changed = (&before.name, before.parent) != (&label.name, label.parent);
        if changed {
            self.stale_result(ResultKind::Cloud).into_iter().collect()
        } else {
            Vec::new()
        }
    }

    fn after_camera(&self, frame: usize, camera: Option<&FrameCamera>) -> Vec<Edit> {
        let before = self
            .frames
            .get(frame)
            .and_then(|frame| frame.camera.as_ref());
        if before == camera {
            Vec::new()
        } else {
            self.after_geometry()
        }
    }

    fn after_frame(&self, frame: usize, value: &Frame) -> Vec<Edit> {
        let shape = |frame: &Frame| (frame.width, frame.height, frame.camera);
        let same = |before: &Frame| {
            shape(before) == shape(value) && is_same_source(&before.depth, &value.depth)
        };
        if self.frames.get(frame).is_some_and(same) {
            Vec::new()
        } else {
            self.after_geometry()
        }
    }

    fn after_depth(&self, frame: usize, depth: &Option<DepthSource>) -> Vec<Edit> {
        let same = |before: &Frame| is_same_source(&before.depth, depth);
        if self.frames.get(frame).is_some_and(same) {
            Vec::new()
        } else {
            self.after_geometry()
        }
    }

    /// Returns the edits after a change of cameras or depths.
    ///
    /// Re-projected masks, depths made with the cameras, and the cloud become stale.
    fn after_geometry(&self) -> Vec<Edit> {
        let record = |kind| self.results.get(&kind);
        let mut edits = Vec::new();
        if record(ResultKind::Tracking)
            .is_some_and(|record| record.engine == ResultEngine::Tracker(TrackerId::Geometry))
        {
            edits.extend(self.stale_masks(self.tracked(0, usize::MAX).collect()));
        }
        if record(ResultKind::Depths).is_some_and(|record| record.engine != ResultEngine::Given) {
            edits.extend(self.stale_result(ResultKind::Depths));
        }
        edits.extend(self.stale_result(ResultKind::Cloud));
        edits
    }

    /// Marks tracked masks as stale, together with the tracking as a whole.
    fn stale_masks(&self, mut frames: Vec<usize>) -> Vec<Edit> {
        let any = !frames.is_empty();
        frames.retain(|frame| self.masks.get(frame).is_some_and(|mask| !mask.stale));
        let marks = (!frames.is_empty()).then_some(Edit::SetStale {
            frames,
            stale: true,
        });
        let record = any
            .then(|| self.stale_result(ResultKind::Tracking))
            .flatten();
        marks.into_iter().chain(record).collect()
    }

    fn stale_result(&self, kind: ResultKind) -> Option<Edit> {
        let record = self.results.get(&kind).filter(|record| !record.stale)?;
        Some(Edit::SetResult {
            kind,
            record: Some(crate::ResultRecord {
                stale: true,
                ..record.clone()
            }),
        })
    }
}

/// Returns whether two depth sources give the same depths.
///
/// Files of a sensor may have moved to another place.
fn is_same_source(before: &Option<DepthSource>, now: &Option<DepthSource>) -> bool {
    match (before, now) {
        (
            Some(DepthSource::Sensor {
                unit: before,
                camera: by,
                ..
            }),
            Some(DepthSource::Sensor {
                unit: now, camera, ..
            }),
        ) => (before, by) == (now, camera),
        (before, now) => before == now,
    }
}
