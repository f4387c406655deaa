use std::path::Path;

use super::glance::look_twice;
use super::keypoints::load_only;
use super::transport::Transport;
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};
use ostra_compute::nn::{Network, NnError, Tensor};

/// Settings of [`SuperGlue`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SuperGlueOptions {
    /// Keypoints of a picture that are looked at, the first (an extractor gives the strongest first); time grows
    /// with its square.
    pub most: usize,
    /// Keypoints that are looked at before, where there are more: pictures of which hardly any of these match do not
    /// overlap and are not looked at further.
    pub first_look: usize,
    /// Least share of a keypoint that goes to its partner, 0..1.
    pub least_share: f64,
}

impl Default for SuperGlueOptions {
    /// The share as the authors publish.
    fn default() -> Self {
        Self {
            most: 1024,
            first_look: 512,
            least_share: 0.2,
        }
    }
}

/// Matches the keypoints of [`super::SuperPoint`] by a network that looks at both pictures as wholes.
///
/// Sarlin, DeTone, Malisiewicz, Rabinovich: "SuperGlue: Learning Feature Matching with Graph Neural Networks", CVPR 2020.
#[derive(Debug)]
pub struct SuperGlue {
    network: Network,
    options: SuperGlueOptions,
}

/// Rounds of the transport, as the authors publish.
const ROUNDS: usize = 100;
/// Share of the longer side to which positions are scaled.
const SCALE: f64 = 0.7;

impl SuperGlue {
    /// The network of this name (`superglue-indoor`, `superglue-outdoor`) of a folder of networks.
    ///
    /// # Errors
    /// When it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, name: &str, options: SuperGlueOptions) -> Result<Self, NnError> {
        Ok(Self::of_network(load_only(folder, name)?, options))
    }

    pub(super) fn of_network(network: Network, options: SuperGlueOptions) -> Self {
        Self { network, options }
    }

    /// How well each two of the first `most` keypoints agree, `[1, first, second]`, and the agreement with nobody; `None`
    /// where a picture has no keypoints.
    pub(super) fn agreement(
        &self,
        both: [&Features; 2],
        most: usize,
    ) -> Result<Option<(Tensor, f32)>, FeatureError> {
        let [first, second] = both.map(|features| fed(features, most));
        let ([at0, sure0, look0], [at1, sure1, look1]) = (first?, second?);
        let (rows, columns) = (sure0.shape()[1], sure1.shape()[1]);
        if rows == 0 || columns == 0 {
            return Ok(None);
        }
        let given = [
            ("keypoints0", &at0),
            ("scores0", &sure0),
            ("descriptors0", &look0),
            ("keypoints1", &at1),
            ("scores1", &sure1),
            ("descriptors1", &look1),
        ];
        let answer = self.network.run(&given).map_err(|error| failed(&error))?;
        match <[Tensor; 2]>::try_from(answer) {
            Ok([agreement, alone])
                if agreement.shape() == [1, rows, columns] && alone.shape() == [1] =>
            {
                let alone = alone.as_floats().first().copied().unwrap_or_default();
                Ok(Some((agreement, alone)))
            }
            _ => Err(FeatureError::Network(
                "SuperGlue gives something else than how keypoints agree".to_owned(),
            )),
        }
    }
}

fn failed(error: &NnError) -> FeatureError {
    FeatureError::Network(error.to_string())
}

/// Positions, scores and descriptors of the first `most` keypoints as the network takes them.
fn fed(features: &Features, most: usize) -> Result<[Tensor; 3], FeatureError> {
    let count = features.keypoints.len().min(most);
    let Descriptors::Floats { dim, values } = &features.descriptors else {
        return Err(FeatureError::Kinds(
            "SuperGlue matches the descriptors of SuperPoint only".to_owned(),
        ));
    };
    let size = glam::DVec2::new(f64::from(features.width), f64::from(features.height));
    // It was trained on positions that count from the centre of the first pixel.
    let placed = features.keypoints[..count]
        .iter()
        .map(|&at| (at - 0.5 - size / 2.0) / (SCALE * size.max_element()));
    let positions = placed.flat_map(|at| [at.x as f32, at.y as f32]).collect();
    let made = |shape: &[usize], values: Vec<f32>| {
        Tensor::floats(shape, values).map_err(|error| failed(&error))
    };
    Ok([
        made(&[1, count, 2], positions)?,
        made(&[1, count], features.scores[..count].to_vec())?,
        made(&[1, count, *dim], values[..count * dim].to_vec())?,
    ])
}

impl FeatureMatcher for SuperGlue {
    fn name(&self) -> &'static str {
        "superglue"
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        let SuperGlueOptions {
            most,
            first_look,
            least_share,
        } = self.options;
        look_twice([first, second], (first_look, most), |most| {
            let Some((agreement, alone)) = self.agreement([first, second], most)? else {
                return Ok(Vec::new());
            };
            let columns = agreement.shape()[2];
            Ok(Transport::new(agreement.as_floats(), columns, alone, ROUNDS).mutual(least_share))
        })
    }
}
