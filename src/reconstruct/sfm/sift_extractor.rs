use super::sift::{SiftOptions, extract_sift};
use super::{Descriptors, FeatureError, FeatureExtractor, Features};

/// SIFT with L1-root descriptors: needs no weights.
#[derive(Debug, Clone, Default)]
pub struct Sift {
    /// How features are found.
    pub options: SiftOptions,
}

impl FeatureExtractor for Sift {
    fn name(&self) -> &'static str {
        "sift"
    }

    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let found = extract_sift(grey, width, height, allowed, &self.options);
        Ok(Features {
            width: width as u32,
            height: height as u32,
            keypoints: found
                .keypoints
                .iter()
                .map(|keypoint| keypoint.at_px.as_dvec2())
                .collect(),
            scales_px: found
                .keypoints
                .iter()
                .map(|keypoint| keypoint.scale_px)
                .collect(),
            scores: Vec::new(),
            descriptors: Descriptors::Bytes {
                dim: 128,
                values: found.descriptors.into_flattened(),
            },
        })
    }
}
