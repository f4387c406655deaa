use std::f64::consts::{PI, TAU};
use std::path::Path;

use super::aliked::DIM;
use super::keypoints::{load_only, match_twice};
use crate::sfm::{Descriptors, FeatureError, FeatureMatcher, Features};
use ostra_compute::nn::{Network, NnError, Tensor};

/// Options of [`LightGlue`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightGlueOptions {
    /// Number of keypoints used per image. The first are taken, as extractors return the strongest
    /// first; time grows with the square.
    pub most: usize,
    /// Number of keypoints in a first pass, if there are more. If hardly any of these match, the
    /// images do not overlap and are not matched further.
    pub first_keypoints: usize,
    /// Minimum score of a match, 0–1.
    pub least_score: f32,
}

impl Default for LightGlueOptions {
    /// Uses the score of the authors and of COLMAP.
    ///
    /// The first pass has more keypoints than that of LighterGlue: images that differ much, for which
    /// this network is chosen, share few of the strongest ones.
    fn default() -> Self {
        Self {
            most: 2048,
            first_keypoints: 1024,
            least_score: 0.1,
        }
    }
}

/// Features that the weights of a [`LightGlue`] were trained for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LightGlueFeatures {
    /// Features of [`super::Aliked`].
    Aliked,
    /// Features of [`crate::sfm::Sift`], of which scale and orientation are used, too.
    Sift,
}

impl LightGlueFeatures {
    /// Returns the name of the network in the catalogue.
    fn network(self) -> &'static str {
        match self {
            Self::Aliked => "aliked-lightglue",
            Self::Sift => "sift-lightglue",
        }
    }
}

/// Matches keypoints by a network that sees all keypoints of both images.
///
/// Lindenberger, Sarlin, Pollefeys: "LightGlue: Local Feature Matching at Light Speed", ICCV 2023,
/// with the interface of the files that COLMAP publishes.
#[derive(Debug)]
pub struct LightGlue {
    network: Network,
    features: LightGlueFeatures,
    options: LightGlueOptions,
    /// Numbers of the outputs with the partners and their scores.
    outputs: [usize; 2],
}

impl LightGlue {
    /// Loads the network `aliked-lightglue` or `sift-lightglue` from a folder of networks.
    ///
    /// # Errors
    /// Fails if it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(
        folder: &Path,
        features: LightGlueFeatures,
        options: LightGlueOptions,
    ) -> Result<Self, NnError> {
        Self::of_network(load_only(folder, features.network())?, features, options)
    }

    /// Wraps a network with the interface of COLMAP's files.
    pub(super) fn of_network(
        network: Network,
        features: LightGlueFeatures,
        options: LightGlueOptions,
    ) -> Result<Self, NnError> {
        let outputs = &network.signature().outputs;
        let number = |name: &str| {
            let number = outputs.iter().position(|port| port.name == name);
            number.ok_or_else(|| NnError::Mismatch {
                path: network.path().to_owned(),
                what: format!("has no output `{name}`"),
            })
        };
        let outputs = [number("matches0")?, number("mscores0")?];
        Ok(Self {
            network,
            features,
            options,
            outputs,
        })
    }

    /// Matches the first `most` keypoints of both images.
    fn matched(&self, both: [&Features; 2], most: usize) -> Result<Vec<(u32, u32)>, FeatureError> {
        let Some([partners, scores]) = self.partners(both, most)? else {
            return Ok(Vec::new());
        };
        let second_count = both[1].keypoints.len().min(most);
        let least = self.options.least_score;
        Ok(accepted(&partners, scores.as_floats(), least, second_count))
    }

    /// Returns the partners of the first `most` keypoints of the first image among those of the
    /// second one, and their scores; none if an image has no keypoints.
    pub(super) fn partners(
        &self,
        both: [&Features; 2],
        most: usize,
    ) -> Result<Option<[Tensor; 2]>, FeatureError> {
        let [first, second] = both.map(|features| self.fed(features, most));
        let (first, second) = (first?, second?);
        let counts = [&first, &second].map(|fed| fed.keypoints.shape()[1]);
        if counts.contains(&0) {
            return Ok(None);
        }
        let given = self.run(&first, &second).map_err(|error| failed(&error))?;
        let [partners, scores] = self.outputs.map(|number| given[number].clone());
        if scores.shape() != [counts[0]] || partners.shape() != [counts[0]] {
            return Err(FeatureError::Network(format!(
                "LightGlue gives {:?} partners and {:?} scores of {} keypoints",
                partners.shape(),
                scores.shape(),
                counts[0]
            )));
        }
        Ok(Some([partners, scores]))
    }

    fn run(&self, first: &FedFeatures, second: &FedFeatures) -> Result<Vec<Tensor>, NnError> {
        let mut inputs = vec![
            ("kpts0", &first.keypoints),
            ("kpts1", &second.keypoints),
            ("desc0", &first.descriptors),
            ("desc1", &second.descriptors),
            ("image_size0", &first.image_size),
            ("image_size1", &second.image_size),
        ];
        if let (Some(first), Some(second)) = (&first.shapes, &second.shapes) {
            inputs.extend([
                ("scales0", &first[0]),
                ("scales1", &second[0]),
                ("oris0", &first[1]),
                ("oris1", &second[1]),
            ]);
        }
        self.network.run(&inputs)
    }

    /// Returns the first `most` keypoints as the network takes them.
    fn fed(&self, features: &Features, most: usize) -> Result<FedFeatures, FeatureError> {
        let count = features.keypoints.len().min(most);
        let (descriptors, shapes) = match self.features {
            LightGlueFeatures::Aliked => (aliked_descriptors(features, count)?, None),
            LightGlueFeatures::Sift => {
                let (descriptors, shapes) = sift_inputs(features, count)?;
                (descriptors, Some(shapes))
            }
        };
        let floats =
            |shape: &[usize], values| Tensor::floats(shape, values).map_err(|e| failed(&e));
        let size = vec![features.width as f32, features.height as f32];
        let shapes = shapes.map(|shapes| shapes.map(|values| floats(&[1, count], values)));
        Ok(FedFeatures {
            keypoints: floats(&[1, count, 2], positions(features, count))?,
            descriptors: floats(&[1, count, DIM], descriptors)?,
            image_size: floats(&[1, 2], size)?,
            shapes: match shapes {
                Some([scales, orientations]) => Some([scales?, orientations?]),
                None => None,
            },
        })
    }
}

/// Features of one image as the network takes them.
struct FedFeatures {
    /// Positions in pixels, `[1, keypoints, 2]`.
    keypoints: Tensor,
    /// `[1, keypoints, 128]`
    descriptors: Tensor,
    /// Width and height, `[1, 2]`; the network centres and scales the positions by them.
    image_size: Tensor,
    /// Scales in pixels and orientations in radians, `[1, keypoints]` each; only of SIFT.
    shapes: Option<[Tensor; 2]>,
}

fn failed(error: &NnError) -> FeatureError {
    FeatureError::Network(error.to_string())
}

/// Returns positions relative to the centre of the top-left pixel, x and y in turn.
pub(super) fn positions(features: &Features, count: usize) -> Vec<f32> {
    let keypoints = &features.keypoints[..count];
    keypoints
        .iter()
        .flat_map(|at| [at.x - 0.5, at.y - 0.5])
        .map(|value| value as f32)
        .collect()
}

fn aliked_descriptors(features: &Features, count: usize) -> Result<Vec<f32>, FeatureError> {
    match &features.descriptors {
        Descriptors::Floats { dim: DIM, values } => Ok(values[..count * DIM].to_vec()),
        _ => Err(FeatureError::Kinds(
            "'aliked-lightglue' matches the descriptors of ALIKED only".to_owned(),
        )),
    }
}

/// Descriptors, scales and orientations of SIFT features.
type SiftInputs = (Vec<f32>, [Vec<f32>; 2]);

/// Returns descriptors of length 1, scales and orientations as the network takes them.
pub(super) fn sift_inputs(features: &Features, count: usize) -> Result<SiftInputs, FeatureError> {
    let bytes = match &features.descriptors {
        Descriptors::Bytes { dim: DIM, values }
            if features.scales_px.len() == features.keypoints.len()
                && features.orientations.len() == features.keypoints.len() =>
        {
            values
        }
        _ => {
            return Err(FeatureError::Kinds(
                "'sift-lightglue' matches SIFT features with scales and orientations only"
                    .to_owned(),
            ));
        }
    };
    let rows = bytes.as_chunks::<DIM>().0.iter().take(count);
    Ok((
        rows.flat_map(sift_descriptor).collect(),
        [
            features.scales_px[..count].to_vec(),
            features.orientations[..count]
                .iter()
                .map(|&angle| within_half_turn(angle))
                .collect(),
        ],
    ))
}

/// Directions of a cell of a SIFT descriptor.
const DIRECTIONS: usize = 8;

/// Returns a descriptor of length 1 with the directions of each cell in the order of COLMAP.
///
/// COLMAP counts them from the keypoint's direction anticlockwise, this program clockwise. At
/// keypoints of pycolmap 4.2 on a photo, the mean cosine with its descriptors is 0.995 in this order,
/// and 0.73 without it.
fn sift_descriptor(bytes: &[u8; DIM]) -> [f32; DIM] {
    let square: u32 = bytes.iter().map(|&byte| u32::from(byte).pow(2)).sum();
    let length = (square as f32).sqrt().max(f32::MIN_POSITIVE);
    std::array::from_fn(|at| {
        let (cell, direction) = (at / DIRECTIONS, at % DIRECTIONS);
        let own = (DIRECTIONS - direction) % DIRECTIONS;
        f32::from(bytes[cell * DIRECTIONS + own]) / length
    })
}

/// Returns an angle in radians in −π–π, as COLMAP gives it.
fn within_half_turn(angle: f32) -> f32 {
    let angle = f64::from(angle).rem_euclid(TAU);
    (if angle > PI { angle - TAU } else { angle }) as f32
}

/// Returns the matches of at least a score, ascending by the first index, one to one.
///
/// `partners` has the number of the partner in the second image of each keypoint of the first one,
/// −1 without one. Exports differ in whether they are integers.
pub(super) fn accepted(
    partners: &Tensor,
    scores: &[f32],
    least_score: f32,
    second_count: usize,
) -> Vec<(u32, u32)> {
    let partners: Vec<i64> = match partners.as_integers() {
        [] => partners.as_floats().iter().map(|&at| at as i64).collect(),
        partners => partners.to_vec(),
    };
    let scored = (0..).zip(partners).zip(scores);
    let mut best: Vec<Option<(u32, f32)>> = vec![None; second_count];
    for ((first, second), &score) in scored {
        let Some(taken) = usize::try_from(second).ok().and_then(|at| best.get_mut(at)) else {
            continue;
        };
        if score >= least_score && taken.is_none_or(|(_, before)| score > before) {
            *taken = Some((first, score));
        }
    }
    let pairs = best.into_iter().zip(0..);
    let mut matches: Vec<(u32, u32)> = pairs
        .filter_map(|(taken, second)| Some((taken?.0, second)))
        .collect();
    matches.sort_unstable();
    matches
}

impl FeatureMatcher for LightGlue {
    fn name(&self) -> &'static str {
        self.features.network()
    }

    fn matches(
        &self,
        first: &Features,
        second: &Features,
    ) -> Result<Vec<(u32, u32)>, FeatureError> {
        let LightGlueOptions {
            most,
            first_keypoints,
            ..
        } = self.options;
        match_twice([first, second], first_keypoints, most, |most| {
            self.matched([first, second], most)
        })
    }
}
