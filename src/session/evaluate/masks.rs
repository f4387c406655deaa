use std::path::Path;

use anyhow::Result;

use crate::engine::job::Progress;
use crate::masks::{MaskScore, ScoreOptions, score_masks};

/// Scores a folder of mask files against a folder of true ones.
///
/// # Errors
/// As [`score_masks`].
pub fn evaluate_masks(truth: &Path, result: &Path, options: &ScoreOptions) -> Result<MaskScore> {
    Ok(score_masks(truth, result, options, &Progress::default())?)
}
