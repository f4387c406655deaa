use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use super::durable;
use crate::scene::sfm::Outcome;

const FILE: &str = "outcomes.json";

/// Writes beside a sparse model what became of each frame when it was made.
///
/// # Errors
/// When the file cannot be written.
pub fn save_outcomes(folder: &Path, outcomes: &BTreeMap<usize, Outcome>) -> Result<()> {
    durable::replace(&folder.join(FILE), &serde_json::to_vec_pretty(outcomes)?)
}

/// What became of each frame, by number.
///
/// # Errors
/// When the file is gone or damaged.
pub fn load_outcomes(folder: &Path) -> Result<BTreeMap<usize, Outcome>> {
    let path = folder.join(FILE);
    let bytes = fs::read(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_slice(&bytes).with_context(|| format!("{}: is damaged; reconstruct again", path.display()))
}
