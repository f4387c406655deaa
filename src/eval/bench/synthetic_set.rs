use std::path::Path;

use anyhow::Result;

use super::data_sets::DataSet;
use crate::synthetic::{Scene, SceneOptions, ViewPath};
use ostra_core::job::Progress;

/// Images in a row of the path.
///
/// They are 2.4° apart. Neighbours overlap much, as in a video of which every tenth frame is used.
const PER_ROW: usize = 50;
/// Largest angle between neighbours of a row with few images, in degrees.
///
/// Four images 2.4° apart have too little parallax for a start; three that are this far apart have
/// enough.
const SPACING_DEG: f64 = 4.8;
/// Largest angle of all rows together, in degrees.
const ROWS_DEG: f64 = 40.0;
/// Angle by which the upper one of two cameras looks down more than the lower one, in degrees.
const BETWEEN_CAMERAS_DEG: f64 = 25.0;

/// A set of images to render of the synthetic plant, 640 × 480 pixels each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyntheticSet {
    /// Number of images.
    pub images: usize,
    /// Whether two cameras take them, one above the other, as of a plant on a turntable. Otherwise
    /// one camera takes them along a path.
    pub two_cameras: bool,
}

impl SyntheticSet {
    /// Returns the name in reports.
    #[must_use]
    pub fn name(self) -> String {
        let kind = if self.two_cameras {
            "two-cameras"
        } else {
            "synthetic"
        };
        format!("{kind}-{}", self.images)
    }

    /// Renders the images into a folder.
    ///
    /// A single camera goes to and fro, with one row for 50 images, so that more images also see more
    /// of the scene.
    ///
    /// # Errors
    /// Returns an error if the folder cannot be written.
    pub fn render(self, folder: &Path) -> Result<DataSet> {
        let scene = Scene::build(&self.scene())?;
        scene.write_photos(folder, &Progress::default())?;
        Ok(DataSet {
            name: self.name(),
            images: folder.join("color"),
            depth: None,
            truth: Some(folder.join("sparse")),
            every: 1,
            is_sequence: !self.two_cameras,
        })
    }

    fn scene(self) -> SceneOptions {
        let defaults = SceneOptions::default();
        let (rows, row_step_deg, path) = if self.two_cameras {
            (2, BETWEEN_CAMERAS_DEG, ViewPath::CameraPerRow)
        } else {
            let rows = self.images.div_ceil(PER_ROW).max(1);
            let step_deg = defaults.row_step_deg.min(ROWS_DEG / rows as f64);
            (rows, step_deg, ViewPath::ToAndFro)
        };
        let per_row = self.images.div_ceil(rows);
        SceneOptions {
            views: self.images,
            rows,
            row_step_deg,
            path,
            width: 640,
            height: 480,
            arc_deg: defaults
                .arc_deg
                .min(SPACING_DEG * per_row.saturating_sub(1) as f64),
            ..defaults
        }
    }
}

#[cfg(test)]
mod tests {
    use super::SyntheticSet;

    #[test]
    fn every_number_of_images_gives_a_valid_scene() {
        for two_cameras in [false, true] {
            for images in [3, 8, 50, 51, 1000, 2500, 5000] {
                let set = SyntheticSet {
                    images,
                    two_cameras,
                };
                set.scene().check().unwrap();
            }
        }
    }
}
