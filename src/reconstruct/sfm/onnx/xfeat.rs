use std::path::Path;

use super::heat::{CELL, Heat, Sampled, normalise};
use super::keypoints::{DetectedKeypoint, NetworkImage, load_only};
use crate::sfm::{FeatureError, FeatureExtractor, Features};
use ostra_compute::nn::{Network, NnError};
use ostra_core::image::ImageSize;

/// Options of [`XFeat`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct XFeatOptions {
    /// Maximum number of keypoints per image; the strongest are kept.
    pub most: usize,
    /// Images with a longer side are shrunk to this, in pixels.
    pub max_side: usize,
    /// Minimum heat of a keypoint, 0–1.
    pub least_heat: f32,
}

impl Default for XFeatOptions {
    fn default() -> Self {
        Self {
            most: 4096,
            max_side: 1600,
            least_heat: 0.05,
        }
    }
}

/// Extracts keypoints and descriptors of 64 floats by a small network, strongest first.
///
/// Potje, Cadar, Araujo, Martins, Nascimento: "XFeat: Accelerated Features for Lightweight Image
/// Matching", CVPR 2024.
#[derive(Debug)]
pub struct XFeat {
    network: Network,
    options: XFeatOptions,
}

/// Values per descriptor.
pub const DIM: usize = 64;
/// The network halves the image five times.
const MULTIPLE: usize = 32;
/// Radius around a keypoint that counts most for a descriptor, in pixels of the image that the
/// network sees: two of its cells.
const AROUND: f32 = 2.0 * CELL as f32;

impl XFeat {
    /// Loads the network `xfeat` from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, options: XFeatOptions) -> Result<Self, NnError> {
        Ok(Self {
            network: load_only(folder, "xfeat")?,
            options,
        })
    }
}

impl FeatureExtractor for XFeat {
    fn name(&self) -> &'static str {
        "xfeat"
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
            MULTIPLE,
        );
        let (shown, planes) = (&image.shown, [DIM, CELL * CELL + 1, 1]);
        let (columns, rows) = (shown.width / CELL, shown.height / CELL);
        let [described, logits, reliability] = image
            .run(&self.network, "input", planes, CELL)
            .map_err(|error| FeatureError::Network(error.to_string()))?;
        let heat = Heat::from_logits(logits.as_floats(), columns, rows);
        let reliability = Sampled::new(reliability.as_floats(), 1, columns, rows);
        let peaks = heat.peaks(
            shown.unpadded.width,
            shown.unpadded.height,
            self.options.least_heat,
        );
        let found = peaks.into_iter().map(|(x, y)| {
            let at = heat.refined(x, y);
            let mut confidence = [0.0];
            reliability.read(at, &mut confidence);
            DetectedKeypoint {
                at,
                score: heat.at(x, y) * confidence[0],
            }
        });
        let found = image.strongest(found, self.options.most, AROUND);
        let described = Sampled::new(described.as_floats(), DIM, columns, rows).normalised();
        Ok(image.features(&found, DIM, |at, row| {
            described.read(at, row);
            normalise(row);
        }))
    }
}
