use std::path::Path;

use anyhow::{Context, Result};

use crate::engine::job::Progress;
use crate::scene::LabelledCloud;
use crate::scene::measure::{MeasureOptions, measure, traits_csv};

/// Measures every label of a cloud and writes the table.
pub fn write(path: &Path, cloud: &LabelledCloud, level: Option<usize>, progress: &Progress) -> Result<()> {
    let rows = measure(cloud, &MeasureOptions { level, ..MeasureOptions::default() }, progress)?;
    super::make_folder_of(path)?;
    std::fs::write(path, traits_csv(&rows, "m"))
        .with_context(|| format!("{}: cannot be written; check permissions and free space", path.display()))
}
