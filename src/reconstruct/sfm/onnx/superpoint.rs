use std::path::Path;

use glam::DVec2;

use super::heat::{CELL, Heat, Sampled, normalise};
use super::keypoints::{DetectedKeypoint, NetworkImage, load_only};
use crate::sfm::{FeatureError, FeatureExtractor, Features};
use ostra_compute::nn::{Network, NnError};
use ostra_core::image::ImageSize;

/// Options of [`SuperPoint`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuperPointOptions {
    /// Maximum number of keypoints per image; the strongest are kept.
    pub most: usize,
    /// Images with a longer side are shrunk to this, in pixels.
    pub max_side: usize,
    /// Minimum heat of a keypoint, 0–1.
    pub least_heat: f32,
    /// Minimum distance of keypoints: they are farther apart than this, in pixels.
    pub radius: usize,
}

impl Default for SuperPointOptions {
    /// Uses the heat and radius that the authors published.
    fn default() -> Self {
        Self {
            most: 4096,
            max_side: 1600,
            least_heat: 0.005,
            radius: 4,
        }
    }
}

/// Extracts keypoints and descriptors by a network, strongest first, at the centres of pixels.
///
/// DeTone, Malisiewicz, Rabinovich: "SuperPoint: Self-Supervised Interest Point Detection and
/// Description", CVPRW 2018.
#[derive(Debug)]
pub struct SuperPoint {
    network: Network,
    /// Values per descriptor.
    dim: usize,
    options: SuperPointOptions,
}

/// Rows and columns at the border of an image that have no keypoints.
const RIM: usize = 4;
/// Radius around a keypoint that counts most for a descriptor, in pixels of the image that the network sees.
const AROUND: f32 = 2.0 * CELL as f32;

impl SuperPoint {
    /// Loads the network `superpoint` from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, options: SuperPointOptions) -> Result<Self, NnError> {
        Self::of_network(load_only(folder, "superpoint")?, options)
    }

    /// Wraps a network that returns logits of keypoints, and descriptors of any number of values.
    pub(super) fn of_network(
        network: Network,
        options: SuperPointOptions,
    ) -> Result<Self, NnError> {
        let dim = network
            .signature()
            .outputs
            .get(1)
            .and_then(|port| port.shape.get(1).copied().flatten());
        let what = || "gives descriptors of no fixed size".to_owned();
        let dim = dim.ok_or_else(|| NnError::Mismatch {
            path: network.path().to_owned(),
            what: what(),
        })?;
        Ok(Self {
            network,
            dim,
            options,
        })
    }

    /// Returns the keypoints in the part of the heat that shows the image.
    fn found(&self, heat: &Heat, unpadded: ImageSize) -> Vec<DetectedKeypoint> {
        let ImageSize { width, height } = unpadded;
        let peaks = heat.separate(width, height, self.options.least_heat, self.options.radius);
        let is_inside =
            |&(x, y): &(usize, usize)| x >= RIM && y >= RIM && x + RIM < width && y + RIM < height;
        let at = |(x, y): (usize, usize)| DVec2::new(x as f64, y as f64) + 0.5;
        peaks
            .into_iter()
            .filter(is_inside)
            .map(|peak| DetectedKeypoint {
                at: at(peak),
                score: heat.at(peak.0, peak.1),
            })
            .collect()
    }
}

impl FeatureExtractor for SuperPoint {
    fn name(&self) -> &'static str {
        "superpoint"
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let image = NetworkImage::new(
            grey,
            ImageSize { width, height },
            allowed,
            self.options.max_side,
            CELL,
        );
        let (shown, planes) = (&image.shown, [CELL * CELL + 1, self.dim]);
        let (columns, rows) = (shown.width / CELL, shown.height / CELL);
        let [logits, described] = image
            .run(&self.network, "image", planes, CELL)
            .map_err(|error| FeatureError::Network(error.to_string()))?;
        let heat = Heat::from_logits(logits.as_floats(), columns, rows);
        let found = self.found(&heat, shown.unpadded);
        let found = image.strongest(found.into_iter(), self.options.most, AROUND);
        let described = Sampled::new(described.as_floats(), self.dim, columns, rows).normalised();
        let cells = DVec2::new(columns as f64, rows as f64);
        Ok(image.features(&found, self.dim, |at, row| {
            described.read_cells(cell_at(at, cells), row);
            normalise(row);
        }))
    }
}

/// Converts a position to cells the way the authors do and SuperGlue was trained on.
///
/// The first centre is exact; the last is off by 7/16 of a cell.
fn cell_at(at: DVec2, cells: DVec2) -> DVec2 {
    let cell = CELL as f64;
    (at - cell / 2.0) / (cells * cell - (cell + 1.0) / 2.0) * (cells - 1.0)
}
