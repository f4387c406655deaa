use std::path::Path;

use super::keypoints::{load_only, match_twice};
use super::xfeat::DIM;
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};
use ostra_compute::nn::{Network, NnError, Tensor};

/// Options of [`LighterGlue`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LighterGlueOptions {
    /// Number of keypoints used per image. The first are taken, as extractors return the strongest
    /// first; time grows with the square.
    pub most: usize,
    /// Number of keypoints in a first pass, if there are more. If hardly any of these match, the
    /// images do not overlap and are not matched further.
    pub first_keypoints: usize,
    /// Minimum score of a match, 0–1.
    pub least_score: f32,
}

impl Default for LighterGlueOptions {
    fn default() -> Self {
        Self {
            most: 1024,
            first_keypoints: 512,
            least_score: 0.1,
        }
    }
}

/// Matches keypoints of [`super::XFeat`] by a network that sees all keypoints of both images.
///
/// Lindenberger, Sarlin, Pollefeys: "LightGlue: Local Feature Matching at Light Speed", ICCV 2023,
/// in the smaller form that the authors of XFeat trained.
#[derive(Debug)]
pub struct LighterGlue {
    network: Network,
    options: LighterGlueOptions,
}

impl LighterGlue {
    /// Loads the network `lighterglue` from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, options: LighterGlueOptions) -> Result<Self, NnError> {
        Ok(Self {
            network: load_only(folder, "lighterglue")?,
            options,
        })
    }

    /// Matches the first `most` keypoints of both images.
    fn matched(&self, both: [&Features; 2], most: usize) -> Result<Vec<(u32, u32)>, FeatureError> {
        let [first, second] = both.map(|features| fed(features, most));
        let (first, second) = (first?, second?);
        let counts = [&first, &second].map(|fed| fed[0].shape()[1]);
        if counts.contains(&0) {
            return Ok(Vec::new());
        }
        let given = self
            .run(&first, &second)
            .map_err(|error| FeatureError::Network(error.to_string()))?;
        let [pairs, scores] = given.as_slice() else {
            return Err(FeatureError::Network(
                "LighterGlue gives no matches and scores".to_owned(),
            ));
        };
        let pairs = pairs.as_integers().chunks_exact(2).zip(scores.as_floats());
        let confidence = pairs.filter(|&(_, &score)| score > self.options.least_score);
        let within = |index: i64, count: usize| {
            u32::try_from(index)
                .ok()
                .filter(|&index| (index as usize) < count)
        };
        let known = confidence.filter_map(|(pair, _)| {
            Some((within(pair[0], counts[0])?, within(pair[1], counts[1])?))
        });
        let mut matches: Vec<(u32, u32)> = known.collect();
        matches.sort_unstable();
        Ok(matches)
    }

    fn run(&self, first: &[Tensor; 2], second: &[Tensor; 2]) -> Result<Vec<Tensor>, NnError> {
        self.network.run(&[
            ("kpts0", &first[0]),
            ("kpts1", &second[0]),
            ("desc0", &first[1]),
            ("desc1", &second[1]),
        ])
    }
}

/// Returns positions and descriptors of the first `most` keypoints as the network takes them.
fn fed(features: &Features, most: usize) -> Result<[Tensor; 2], FeatureError> {
    let Descriptors::Floats { dim: DIM, values } = &features.descriptors else {
        return Err(FeatureError::Kinds(
            "LighterGlue matches the descriptors of XFeat only".to_owned(),
        ));
    };
    let count = features.keypoints.len().min(most);
    let half = glam::DVec2::new(f64::from(features.width), f64::from(features.height)) / 2.0;
    let placed = features.keypoints[..count]
        .iter()
        .map(|&at| (at - half) / half.max_element());
    let positions = placed.flat_map(|at| [at.x as f32, at.y as f32]).collect();
    let failed = |error: NnError| FeatureError::Network(error.to_string());
    let positions = Tensor::floats(&[1, count, 2], positions).map_err(failed)?;
    let described =
        Tensor::floats(&[1, count, DIM], values[..count * DIM].to_vec()).map_err(failed)?;
    Ok([positions, described])
}

impl FeatureMatcher for LighterGlue {
    fn name(&self) -> &'static str {
        "lighterglue"
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        let LighterGlueOptions {
            most,
            first_keypoints,
            ..
        } = self.options;
        match_twice([first, second], first_keypoints, most, |most| {
            self.matched([first, second], most)
        })
    }
}
