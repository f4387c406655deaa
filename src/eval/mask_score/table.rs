use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;
use serde::Serialize;

use super::boundary::boundary_f;
use ostra_core::job::Progress;
use ostra_masks::{LabelId, MaskError, RunMask};

/// The ground truth mask and the result of a frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FramePair {
    /// Name of the frame.
    pub name: String,
    /// The ground truth mask.
    pub truth: RunMask,
    /// The mask to score, of the same size.
    pub result: RunMask,
}

/// J and F of masks against the ground truth, 0–1.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct MaskScore {
    /// Region similarity (intersection over union): mean over labels of [`LabelScore::j`].
    pub j: f64,
    /// Boundary F-measure: mean over labels of [`LabelScore::f`].
    pub f: f64,
    /// Mean of `j` and `f`.
    pub jf: f64,
    /// Number of scored frames.
    pub frames: usize,
    /// Scores of every label of the ground truth, sorted by id.
    pub labels: Vec<LabelScore>,
    /// Warnings about files and labels that were left out, and about ambiguous values.
    pub warnings: Vec<String>,
}

/// Scores of one label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LabelScore {
    /// Id of the label.
    pub id: LabelId,
    /// Name of the label, if known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Mean of `j` over frames.
    pub j: f64,
    /// Mean of `f` over frames.
    pub f: f64,
    /// Scores of every frame, in order.
    pub frames: Vec<FrameScore>,
}

/// Scores of one label on one frame; both are 1 if neither ground truth nor result has the label.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameScore {
    /// Name of the frame.
    pub frame: String,
    /// Intersection over union.
    pub j: f64,
    /// Boundary F-measure.
    pub f: f64,
}

/// Scores `labels`: the mean over frames per label, then the mean over labels.
///
/// # Errors
/// Returns [`MaskError::Request`] if a pair differs in size, or without frames or labels. Returns
/// [`MaskError::Stopped`] if stopped.
pub fn score_pairs(
    pairs: &[FramePair],
    labels: &BTreeSet<LabelId>,
    progress: &Progress,
) -> Result<MaskScore, MaskError> {
    if pairs.is_empty() || labels.is_empty() {
        return Err(MaskError::Request(
            "there is no frame or label to score; check the ground-truth masks".into(),
        ));
    }
    let done = AtomicUsize::new(0);
    let score = |pair: &FramePair| -> Result<Vec<FrameScore>, MaskError> {
        progress.check()?;
        let scores = score_frame(pair, labels)?;
        progress.step(done.fetch_add(1, Ordering::Relaxed) + 1, pairs.len())?;
        Ok(scores)
    };
    // All results are collected first, so that the first error in frame order is returned.
    let results: Vec<Result<Vec<FrameScore>, MaskError>> = pairs.par_iter().map(score).collect();
    let per_frame: Vec<Vec<FrameScore>> = results.into_iter().collect::<Result<_, _>>()?;
    let scored = labels.iter().enumerate().map(|(at, &id)| {
        let frames: Vec<FrameScore> = per_frame.iter().map(|scores| scores[at].clone()).collect();
        let mean_over = |score: fn(&FrameScore) -> f64| mean(frames.iter().map(score));
        LabelScore {
            id,
            name: None,
            j: mean_over(|frame| frame.j),
            f: mean_over(|frame| frame.f),
            frames,
        }
    });
    let labels: Vec<LabelScore> = scored.collect();
    let (j, f) = (
        mean(labels.iter().map(|label| label.j)),
        mean(labels.iter().map(|label| label.f)),
    );
    Ok(MaskScore {
        j,
        f,
        jf: f64::midpoint(j, f),
        frames: pairs.len(),
        labels,
        warnings: Vec::new(),
    })
}

fn score_frame(pair: &FramePair, labels: &BTreeSet<LabelId>) -> Result<Vec<FrameScore>, MaskError> {
    let (truth, result) = (&pair.truth, &pair.result);
    if (truth.width, truth.height) != (result.width, result.height) {
        return Err(MaskError::Request(misfit(pair, result)));
    }
    let score = |&id: &LabelId| {
        let (truth, result) = (truth.region(id), result.region(id));
        FrameScore {
            frame: pair.name.clone(),
            j: truth.iou(&result),
            f: boundary_f(&truth, &result),
        }
    };
    Ok(labels.par_iter().map(score).collect())
}

/// Returns the message about a result whose size differs from that of the ground truth mask.
pub(super) fn misfit(FramePair { name, truth, .. }: &FramePair, result: &RunMask) -> String {
    format!(
        "{name}: the result is {}×{} pixels, the true mask {}×{}; save the result at the frame's size",
        result.width, result.height, truth.width, truth.height
    )
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mask(ids: [u16; 8]) -> RunMask {
        RunMask::new(4, 2, ids.map(|id| (LabelId(id), 1)).to_vec()).unwrap()
    }

    #[test]
    fn mean_over_frames_then_over_labels() {
        let pair = |truth, result| FramePair {
            name: "f".into(),
            truth: mask(truth),
            result: mask(result),
        };
        let pairs = [
            pair([1, 1, 0, 0, 2, 2, 2, 2], [1, 0, 0, 0, 2, 2, 2, 2]),
            pair([1, 1, 1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 1, 1, 0, 0]),
            pair([0; 8], [1, 0, 0, 0, 0, 0, 0, 0]),
        ];
        let score = score_pairs(&pairs, &[1, 2].map(LabelId).into(), &Progress::default()).unwrap();
        let expected_j = [(0.5 + 2.0 / 6.0 + 0.0) / 3.0, 1.0];
        for (label, expected) in score.labels.iter().zip(expected_j) {
            assert!((label.j - expected).abs() < 1e-12, "{label:?}");
        }
        assert!((score.j - (expected_j[0] + 1.0) / 2.0).abs() < 1e-12);
        assert!((score.jf - (score.j + score.f) / 2.0).abs() < 1e-12);
        assert!(
            score.labels[1]
                .frames
                .iter()
                .all(|frame| frame.f > 0.999 && frame.j > 0.999),
            "absent on both sides is 1"
        );
    }

    #[test]
    fn unscorable_pairs_are_rejected() {
        let small = RunMask::empty(3, 2);
        let pair = FramePair {
            name: "a/7".into(),
            truth: mask([1; 8]),
            result: small,
        };
        let error = score_pairs(&[pair], &[LabelId(1)].into(), &Progress::default())
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("a/7") && error.contains("3×2") && error.contains("4×2"),
            "{error}"
        );
        assert!(score_pairs(&[], &[LabelId(1)].into(), &Progress::default()).is_err());
    }
}
