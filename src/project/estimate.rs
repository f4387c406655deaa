use crate::{MaskOrigin, Project};

/// How good the masks probably are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Mean over labels and frames that have a mask of what the tracker made of itself, 0–1; an anchor counts 1.
    pub accuracy: f64,
    /// Frames with a mask.
    pub frames: usize,
}

impl Project {
    /// Estimates how good the masks are; `None` while no mask shows a label. `labels_on` says how many labels a frame
    /// shows.
    pub fn estimate(&self, labels_on: impl Fn(usize) -> usize) -> Option<Estimate> {
        let (mut sum, mut count) = (0.0, 0usize);
        for (&frame, mask) in &self.masks {
            match mask.origin {
                MaskOrigin::Anchor => {
                    let shown = labels_on(frame);
                    (sum, count) = (sum + shown as f64, count + shown);
                }
                MaskOrigin::Tracked => {
                    sum += mask
                        .confidence
                        .values()
                        .map(|&sure| f64::from(sure))
                        .sum::<f64>();
                    count += mask.confidence.len();
                }
            }
        }
        (count > 0).then(|| Estimate {
            accuracy: sum / count as f64,
            frames: self.masks.len(),
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Edit;
    use crate::testing::{anchor, project, tracked};

    #[test]
    fn anchors_are_sure_and_empty_masks_say_nothing() {
        let mut project = project();
        assert_eq!(project.estimate(|_| 1), None);
        for (frame, mask) in [anchor([1, 2, 0]), tracked([1, 0, 0]), anchor([0; 3])]
            .into_iter()
            .enumerate()
        {
            project
                .apply(Edit::SetMask {
                    frame,
                    mask: Some(mask),
                })
                .unwrap();
        }
        let estimate = project.estimate(|frame| [2, 1, 0][frame]).unwrap();
        assert!((estimate.accuracy - 0.9).abs() < 1e-6, "{estimate:?}");
        assert_eq!(estimate.frames, 3);
    }
}
