//! Pixels that are assigned to another label.

use super::*;

/// A tracker that first assigns a column of the blue object to the red one.
///
/// Afterwards it returns the ground truth.
struct Thief {
    truth: BTreeMap<usize, RunMask>,
}

impl Tracker for Thief {
    fn name(&self) -> &'static str {
        "thief"
    }

    fn track(
        &self,
        request: &TrackRequest,
        emit: &mut dyn FnMut(TrackedFrame),
        _: &Progress,
    ) -> Result<Vec<String>, MaskError> {
        for frame in
            (request.from..=request.to).filter(|frame| !request.keyframes.contains_key(frame))
        {
            let mut mask = self.truth[&frame].decode();
            let stolen = |at: usize| request.labels.is_none() && at % mask.width as usize == 52;
            let ids = mask.ids.iter().enumerate().map(|(at, &id)| match id {
                LabelId(2) if stolen(at) => LabelId(1),
                id => id,
            });
            mask.ids = ids.collect();
            emit(TrackedFrame {
                frame,
                mask,
                confidence: BTreeMap::new(),
                preliminary: false,
            });
        }
        Ok(Vec::new())
    }
}

#[test]
fn pixels_wrongly_assigned_to_another_label_are_corrected() {
    let folder = tempfile::tempdir().unwrap();
    let sequence = sequence(folder.path());
    let (thief, options) = (
        Thief {
            truth: sequence.truth.clone(),
        },
        InteractOptions::default(),
    );
    let report = interact(
        &sequence,
        &ByColor { whole: true },
        &thief,
        &options,
        &Progress::default(),
    )
    .unwrap();
    assert!(report.clicks == 2 && report.mean_iou > 0.99, "{report:?}");
    // The tracker left no frame poor, so no frame would be clicked again.
    assert_eq!(
        (report.failed_by_frame, report.share_of_reclicking()),
        (FrameByFrame::default(), None)
    );
}
