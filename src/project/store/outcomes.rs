use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::de::DeserializeOwned;

use super::durable;
use ostra_core::disk;
use ostra_reconstruct::rgbd::FrameLink;
use ostra_reconstruct::sfm::Outcome;

/// A larger file is damaged: one of a million frames takes half of it.
const MAX_BYTES: u64 = 512 << 20;

const OUTCOMES: &str = "outcomes.json";
const LINKS: &str = "links.json";

/// Writes beside a sparse model what became of each frame when it was made.
///
/// # Errors
/// When the file cannot be written.
pub fn save_outcomes(folder: &Path, outcomes: &BTreeMap<usize, Outcome>) -> Result<()> {
    durable::replace(
        &folder.join(OUTCOMES),
        &serde_json::to_vec_pretty(outcomes)?,
    )
}

/// Writes beside a sparse model what ties its frames together; nothing where there are no links.
///
/// # Errors
/// When the file cannot be written.
pub fn save_links(folder: &Path, links: &[FrameLink]) -> Result<()> {
    if links.is_empty() {
        Ok(())
    } else {
        durable::replace(&folder.join(LINKS), &serde_json::to_vec(links)?)
    }
}

/// What became of each frame, by number.
///
/// # Errors
/// When the file is gone or damaged.
pub fn load_outcomes(folder: &Path) -> Result<BTreeMap<usize, Outcome>> {
    load(&folder.join(OUTCOMES))
}

/// What ties the frames together; nothing where no file tells.
///
/// # Errors
/// When the file is damaged.
pub fn load_links(folder: &Path) -> Result<Vec<FrameLink>> {
    let path = folder.join(LINKS);
    if path.exists() {
        load(&path)
    } else {
        Ok(Vec::new())
    }
}

fn load<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = disk::read_regular_up_to(path, MAX_BYTES)
        .with_context(|| format!("{}: cannot be read", path.display()))?;
    serde_json::from_slice(&bytes)
        .with_context(|| format!("{}: is damaged; reconstruct again", path.display()))
}
