use std::path::Path;

use glam::DVec2;

use super::keypoints::{DetectedKeypoint, NetworkImage, PreparedImage, load_only};
use crate::sfm::{Descriptors, FeatureError, FeatureExtractor, Features};
use ostra_compute::nn::{Network, NnError, Tensor};
use ostra_core::image::ImageSize;
use ostra_frames::Image;

/// Options of [`Aliked`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AlikedOptions {
    /// Maximum number of keypoints per image; the strongest are kept.
    pub most: usize,
    /// Images with a longer side are shrunk to this, in pixels.
    pub max_side: usize,
    /// Minimum score of a keypoint, 0–1.
    pub least_score: f32,
}

impl Default for AlikedOptions {
    /// Uses the values of COLMAP, for which the files were exported.
    fn default() -> Self {
        Self {
            most: 2048,
            max_side: 1600,
            least_score: 0.2,
        }
    }
}

/// Extracts keypoints and descriptors from colour images by a network, strongest first.
///
/// X. Zhao, X. Wu, W. Chen, P. C. Y. Chen, Q. Xu, Z. Li: "ALIKED: A Lighter Keypoint and Descriptor
/// Extraction Network via Deformable Transformation", IEEE T. Instrum. Meas. 2023.
#[derive(Debug)]
pub struct Aliked {
    network: Network,
    options: AlikedOptions,
}

/// Values per descriptor.
pub(super) const DIM: usize = 128;
/// The network takes sides that are multiples of this, in pixels.
pub(super) const MULTIPLE: usize = 32;
/// Radius around a keypoint that counts most for a descriptor, in pixels of the image that the
/// network sees.
const AROUND: f32 = 16.0;
/// With a mask, so many times the keypoints are requested, because the network does not know it.
const MASKED: usize = 4;

impl Aliked {
    /// Loads the network `aliked` from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, options: AlikedOptions) -> Result<Self, NnError> {
        Ok(Self::of_network(load_only(folder, "aliked")?, options))
    }

    /// Wraps a network with the interface of COLMAP's files.
    pub(super) fn of_network(network: Network, options: AlikedOptions) -> Self {
        Self { network, options }
    }

    /// Extracts features from red, green and blue values in 0–1; `grey` finds black bars.
    fn extract_planes(
        &self,
        grey: &[f32],
        planes: [&[f32]; 3],
        size: ImageSize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let AlikedOptions { most, max_side, .. } = self.options;
        let image = NetworkImage::new(grey, size, allowed, max_side, MULTIPLE);
        let (width, height) = (image.shown.width, image.shown.height);
        let requested = if allowed.is_some() {
            MASKED * most
        } else {
            most
        };
        // The network cannot return more keypoints than it sees pixels.
        let requested = requested.min(width * height);
        let shown = planes.map(|plane| PreparedImage::new(plane, size, max_side, MULTIPLE).grey);
        let found = self
            .run(shown.concat(), [width, height], requested)
            .map_err(|error| FeatureError::Network(error.to_string()))?;
        let keypoints = found.keypoints(image.shown.unpadded, [width, height]);
        let is_kept = |(_, keypoint): &(usize, DetectedKeypoint)| {
            keypoint.score >= self.options.least_score && image.allows(keypoint.at, AROUND)
        };
        let mut kept: Vec<(usize, DetectedKeypoint)> = keypoints.filter(is_kept).collect();
        kept.sort_by(|(_, a), (_, b)| b.score.total_cmp(&a.score));
        kept.truncate(most);
        let original = image.shown.original_from_here;
        let values = kept.iter().flat_map(|&(row, _)| found.descriptor(row));
        Ok(Features {
            width: size.width as u32,
            height: size.height as u32,
            keypoints: kept.iter().map(|(_, one)| one.at * original).collect(),
            scales_px: Vec::new(),
            orientations: Vec::new(),
            scores: kept.iter().map(|(_, one)| one.score).collect(),
            descriptors: Descriptors::Floats {
                dim: DIM,
                values: values.copied().collect(),
            },
        })
    }

    fn run(
        &self,
        planes: Vec<f32>,
        [width, height]: [usize; 2],
        requested: usize,
    ) -> Result<FoundKeypoints, NnError> {
        let image = Tensor::floats(&[1, 3, height, width], planes)?;
        let most = Tensor::integers(&[], vec![requested as i64])?;
        let least = Tensor::floats(&[], vec![self.options.least_score])?;
        let given = self.network.run(&[
            ("image", &image),
            ("max_keypoints", &most),
            ("min_score", &least),
        ])?;
        FoundKeypoints::new(given).map_err(|what| NnError::Mismatch {
            path: self.network.path().to_owned(),
            what,
        })
    }
}

/// What the network returns.
struct FoundKeypoints {
    /// `[1, keypoints, 2]`, from −1 at the centre of the first pixel to 1 at that of the last one.
    places: Tensor,
    /// `[1, keypoints, 128]`
    descriptors: Tensor,
    /// `[1, keypoints]`
    scores: Tensor,
}

impl FoundKeypoints {
    /// Checks the shapes; the error states what is wrong.
    fn new(given: Vec<Tensor>) -> Result<Self, String> {
        let shapes: Vec<Vec<usize>> = given.iter().map(|one| one.shape().to_vec()).collect();
        let unexpected =
            || format!("gives {shapes:?} where [1, n, 2], [1, n, {DIM}] and [1, n] are expected");
        let [places, descriptors, scores] =
            <[Tensor; 3]>::try_from(given).map_err(|_| unexpected())?;
        let count = scores.as_floats().len();
        let is_right = places.shape() == [1, count, 2]
            && descriptors.shape() == [1, count, DIM]
            && scores.shape() == [1, count];
        is_right
            .then_some(Self {
                places,
                descriptors,
                scores,
            })
            .ok_or_else(unexpected)
    }

    /// Returns the keypoints that lie in the image and not in its repeated margin, with their
    /// numbers.
    fn keypoints(
        &self,
        unpadded: ImageSize,
        padded: [usize; 2],
    ) -> impl Iterator<Item = (usize, DetectedKeypoint)> + '_ {
        let places = self.places.as_floats().chunks_exact(2);
        let scores = self.scores.as_floats().iter();
        places
            .zip(scores)
            .enumerate()
            .filter_map(move |(number, (place, &score))| {
                let at = pixel_of(DVec2::new(place[0].into(), place[1].into()), padded);
                let is_inside = (0.0..unpadded.width as f64).contains(&at.x)
                    && (0.0..unpadded.height as f64).contains(&at.y);
                is_inside.then_some((number, DetectedKeypoint { at, score }))
            })
    }

    fn descriptor(&self, number: usize) -> &[f32] {
        &self.descriptors.as_floats()[number * DIM..(number + 1) * DIM]
    }
}

/// Returns the position in pixels of a position from −1 to 1; the centre of the top-left pixel is at
/// (0.5, 0.5).
///
/// −1 and 1 are the centres of the first and the last pixel of the padded image.
pub(super) fn pixel_of(place: DVec2, [width, height]: [usize; 2]) -> DVec2 {
    let last = DVec2::new(width as f64, height as f64) - 1.0;
    (place + 1.0) * 0.5 * last + 0.5
}

impl FeatureExtractor for Aliked {
    fn name(&self) -> &'static str {
        "aliked"
    }

    /// Extracts features of a grey image, which is given for all three colours.
    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        self.extract_planes(grey, [grey; 3], ImageSize { width, height }, allowed)
    }

    fn uses_color(&self) -> bool {
        true
    }

    fn extract_from_image(
        &self,
        image: &Image,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let plane = |channel: usize| -> Vec<f32> {
            let values = image.pixels.iter();
            values
                .map(|pixel| f32::from(pixel[channel]) / 255.0)
                .collect()
        };
        let [red, green, blue] = [0, 1, 2].map(plane);
        self.extract_planes(&image.luma(), [&red, &green, &blue], image.size(), allowed)
    }
}
