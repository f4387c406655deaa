use std::path::Path;

use anyhow::Result;

use super::data_sets::DataSet;
use crate::synthetic::{Scene, SceneOptions};
use ostra_core::job::Progress;

/// Images in a row of the path.
///
/// They are 2.4° apart. Neighbours overlap much, as in a video of which every tenth frame is used.
const PER_ROW: usize = 50;
/// Largest angle between neighbours of a single row with few images, in degrees.
///
/// Four images 2.4° apart have too little parallax for a start; three that are this far apart have
/// enough.
const SPACING_DEG: f64 = 4.8;

/// Renders so many images of the synthetic plant along a path, 640 × 480 pixels, into a folder.
///
/// The path goes to and fro, with one row for 50 images, so that more images also see more of the
/// scene.
///
/// # Errors
/// Returns an error if the folder cannot be written.
pub fn render_set(images: usize, folder: &Path) -> Result<DataSet> {
    let defaults = SceneOptions::default();
    let rows = images.div_ceil(PER_ROW).max(1);
    let scene = Scene::build(&SceneOptions {
        views: images,
        rows,
        width: 640,
        height: 480,
        arc_deg: defaults
            .arc_deg
            .min(SPACING_DEG * images.saturating_sub(1) as f64),
        ..defaults
    })?;
    scene.write_photos(folder, &Progress::default())?;
    Ok(DataSet {
        name: format!("synthetic-{images}"),
        images: folder.join("color"),
        depth: None,
        truth: Some(folder.join("sparse")),
        every: 1,
        is_sequence: true,
    })
}
