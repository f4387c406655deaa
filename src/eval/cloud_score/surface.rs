use serde::{Deserialize, Serialize};

/// How well two surfaces cover each other at one distance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SurfaceScore {
    /// The distance, in cloud units.
    pub within: f64,
    /// Share of the truth points that have a result point within the distance.
    pub completeness: f64,
    /// Share of the result points that have a truth point within the distance.
    pub accuracy: f64,
    /// Harmonic mean of both.
    pub f_score: f64,
    /// Of the result points that a camera sees within a pixel of its picture of a truth point that it sees, the share
    /// that is within the distance of it in depth; `None` where there are none.
    pub in_depth: Option<f64>,
}

/// Scores the surface from the distances of truth points to the result and of result points to the truth, and from the
/// differences in depth where cameras see both.
pub(super) fn score_surface(
    within: f64,
    to_result: &[(usize, f32)],
    to_truth: &[(usize, f32)],
    depth_differences: &[f32],
) -> SurfaceScore {
    let share = |distances: &[(usize, f32)]| {
        let near = distances
            .iter()
            .filter(|&&(_, distance)| f64::from(distance) <= within)
            .count();
        near as f64 / distances.len().max(1) as f64
    };
    let (completeness, accuracy) = (share(to_result), share(to_truth));
    let sum = completeness + accuracy;
    let f_score = if sum > 0.0 {
        2.0 * completeness * accuracy / sum
    } else {
        0.0
    };
    let near = depth_differences
        .iter()
        .filter(|&&difference| f64::from(difference) <= within)
        .count();
    let in_depth =
        (!depth_differences.is_empty()).then(|| near as f64 / depth_differences.len() as f64);
    SurfaceScore {
        within,
        completeness,
        accuracy,
        f_score,
        in_depth,
    }
}
