use std::path::Path;

use anyhow::Result;

use ostra_core::job::Progress;
use ostra_masks::{MaskScore, ScoreOptions, score_masks};

/// Scores a folder of mask files against a folder of true ones.
///
/// # Errors
/// As [`score_masks`].
pub fn evaluate_masks(truth: &Path, result: &Path, options: &ScoreOptions) -> Result<MaskScore> {
    Ok(score_masks(truth, result, options, &Progress::default())?)
}
