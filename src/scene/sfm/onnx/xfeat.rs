use std::path::Path;

use glam::DVec2;

use super::heat::{CELL, Heat};
use super::prepared::Prepared;
use super::sampled::{Sampled, normalise};
use crate::engine::nn::{Network, NnError, Tensor, load};
use crate::scene::sfm::sift::Content;
use crate::scene::sfm::{Descriptors, FeatureError, FeatureExtractor, Features};

/// Settings of [`XFeat`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct XFeatOptions {
    /// Most keypoints of a picture, the strongest.
    pub most: usize,
    /// Pictures with a longer side are shrunk to this, in pixels.
    pub max_side: usize,
    /// Least heat of a keypoint, 0..1.
    pub least_heat: f32,
}

impl Default for XFeatOptions {
    fn default() -> Self {
        Self { most: 4096, max_side: 1600, least_heat: 0.05 }
    }
}

/// Keypoints and descriptors of 64 floats from a small network, the strongest keypoints first.
///
/// Potje, Cadar, Araujo, Martins, Nascimento: "XFeat: Accelerated Features for Lightweight Image Matching", CVPR 2024.
#[derive(Debug)]
pub struct XFeat {
    network: Network,
    options: XFeatOptions,
}

/// Values of a descriptor.
pub const DIM: usize = 64;
/// Radius of the surroundings that count most for a descriptor, in pixels of the picture that the network sees: two of
/// its cells.
const AROUND: f32 = 2.0 * CELL as f32;

impl XFeat {
    /// The network `xfeat` of a folder of networks.
    ///
    /// # Errors
    /// When it is not installed there, does not load, or ONNX Runtime is missing.
    pub fn load(folder: &Path, options: XFeatOptions) -> Result<Self, NnError> {
        Ok(Self { network: load_only(folder, "xfeat")?, options })
    }

    fn run(&self, shown: &Prepared) -> Result<[Tensor; 3], NnError> {
        let input = Tensor::floats(&[1, 1, shown.height, shown.width], shown.grey.clone())?;
        let given = self.network.run(&[("input", &input)])?;
        let expected = [DIM, CELL * CELL + 1, 1].map(|planes| vec![1, planes, shown.height / CELL, shown.width / CELL]);
        let shapes: Vec<&[usize]> = given.iter().map(Tensor::shape).collect();
        if shapes != expected {
            let what = format!("gives {shapes:?} where {expected:?} are expected");
            return Err(NnError::Mismatch { path: self.network.path().to_owned(), what });
        }
        <[Tensor; 3]>::try_from(given).map_err(|_| NnError::Request("three outputs".to_owned()))
    }

    fn strongest(&self, heat: &Heat, reliability: &Sampled, shown: &Prepared, allowed: &Allowed<'_>) -> Vec<Found> {
        let peaks = heat.peaks(shown.shown_width, shown.shown_height, self.options.least_heat);
        let found = peaks.into_iter().map(|(x, y)| {
            let at = heat.refined(x, y);
            let mut sure = [0.0];
            reliability.read(at, &mut sure);
            Found { at, score: heat.at(x, y) * sure[0] }
        });
        let mut found: Vec<Found> = found.filter(|found| allowed.at(found.at * shown.original_from_here)).collect();
        // Stable: of equal scores the first, row by row.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(self.options.most);
        found
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
        let shown = Prepared::new(grey, width, height, self.options.max_side);
        let (columns, rows) = (shown.width / CELL, shown.height / CELL);
        let [described, logits, reliability] =
            self.run(&shown).map_err(|error| FeatureError::Network(error.to_string()))?;
        let heat = Heat::from_logits(logits.as_floats(), columns, rows);
        let reliability = Sampled::new(reliability.as_floats(), 1, columns, rows);
        let around = AROUND * shown.original_from_here.max_element() as f32;
        let allowed = Allowed { mask: allowed, width, height, content: Content::of(grey, width, height), around };
        let found = self.strongest(&heat, &reliability, &shown, &allowed);
        let described = Sampled::new(described.as_floats(), DIM, columns, rows).normalised();
        Ok(Features {
            width: width as u32,
            height: height as u32,
            keypoints: found.iter().map(|found| found.at * shown.original_from_here).collect(),
            scales_px: Vec::new(),
            scores: found.iter().map(|found| found.score).collect(),
            descriptors: Descriptors::Floats { dim: DIM, values: descriptors(&found, &described) },
        })
    }
}

struct Found {
    /// In pixels of the prepared picture.
    at: DVec2,
    score: f32,
}

struct Allowed<'a> {
    mask: Option<&'a [bool]>,
    width: usize,
    height: usize,
    content: Content,
    /// Radius of the surroundings that a keypoint is described by, in pixels of the picture.
    around: f32,
}

impl Allowed<'_> {
    fn at(&self, px: DVec2) -> bool {
        let (x, y) = ((px.x as usize).min(self.width - 1), (px.y as usize).min(self.height - 1));
        self.mask.is_none_or(|mask| mask[y * self.width + x]) && self.content.holds(px.as_vec2(), self.around)
    }
}

fn descriptors(found: &[Found], described: &Sampled) -> Vec<f32> {
    let mut values = vec![0.0; found.len() * DIM];
    for (found, row) in found.iter().zip(values.chunks_exact_mut(DIM)) {
        described.read(found.at, row);
        normalise(row);
    }
    values
}

/// The network of an entry that has one file.
pub fn load_only(folder: &Path, name: &str) -> Result<Network, NnError> {
    let missing = || NnError::Request(format!("the catalogue has no file for `{name}`"));
    load(folder, name)?.pop().ok_or_else(missing)
}
