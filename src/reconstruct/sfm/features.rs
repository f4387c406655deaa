use glam::DVec2;
use ostra_frames::Image;

/// Descriptors of keypoints: one row of `dim` values per keypoint, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum Descriptors {
    /// Bytes whose rows have about the same length (SIFT: 128 values, length about 512).
    Bytes {
        /// Values per keypoint.
        dim: usize,
        /// `keypoints · dim` values.
        values: Vec<u8>,
    },
    /// Rows of length 1.
    Floats {
        /// Values per keypoint.
        dim: usize,
        /// `keypoints · dim` values.
        values: Vec<f32>,
    },
}

impl Descriptors {
    /// Returns the number of values per keypoint.
    #[must_use]
    pub fn dim(&self) -> usize {
        match *self {
            Self::Bytes { dim, .. } | Self::Floats { dim, .. } => dim,
        }
    }

    /// Returns the number of described keypoints.
    #[must_use]
    pub fn len(&self) -> usize {
        let values = match self {
            Self::Bytes { values, .. } => values.len(),
            Self::Floats { values, .. } => values.len(),
        };
        values / self.dim().max(1)
    }

    /// Returns the values if they are bytes.
    #[must_use]
    pub fn as_bytes(&self) -> Option<&[u8]> {
        match self {
            Self::Bytes { values, .. } => Some(values),
            Self::Floats { .. } => None,
        }
    }

    /// Returns the values if they are floats.
    #[must_use]
    pub fn as_floats(&self) -> Option<&[f32]> {
        match self {
            Self::Floats { values, .. } => Some(values),
            Self::Bytes { .. } => None,
        }
    }

    /// Frees all values; no keypoint is described any more.
    pub(super) fn clear(&mut self) {
        match self {
            Self::Bytes { values, .. } => *values = Vec::new(),
            Self::Floats { values, .. } => *values = Vec::new(),
        }
    }

    /// Returns whether no keypoint is described.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Features that an extractor found in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Positions in pixels of the image as shown; the centre of the top-left pixel is at (0.5, 0.5).
    pub keypoints: Vec<DVec2>,
    /// Radius of each keypoint in pixels; empty if the extractor gives none.
    pub scales_px: Vec<f32>,
    /// Direction of each keypoint in radians, 0–2π, from the x axis towards the y axis (down);
    /// empty if the extractor gives none.
    pub orientations: Vec<f32>,
    /// Confidence of each keypoint, 0–1; empty if the extractor gives none.
    pub scores: Vec<f32>,
    /// One row per keypoint.
    pub descriptors: Descriptors,
}

impl Features {
    /// Returns the features with these indices, in the order given.
    #[must_use]
    pub fn select(&self, keep: &[u32]) -> Self {
        fn some<T: Copy>(values: &[T], dim: usize, keep: &[u32]) -> Vec<T> {
            let row = |&at: &u32| {
                values
                    .chunks_exact(dim.max(1))
                    .nth(at as usize)
                    .unwrap_or_default()
            };
            keep.iter().flat_map(row).copied().collect()
        }
        let dim = self.descriptors.dim();
        Self {
            keypoints: some(&self.keypoints, 1, keep),
            scales_px: some(&self.scales_px, 1, keep),
            orientations: some(&self.orientations, 1, keep),
            scores: some(&self.scores, 1, keep),
            descriptors: match &self.descriptors {
                Descriptors::Bytes { values, .. } => Descriptors::Bytes {
                    dim,
                    values: some(values, dim, keep),
                },
                Descriptors::Floats { values, .. } => Descriptors::Floats {
                    dim,
                    values: some(values, dim, keep),
                },
            },
            ..*self
        }
    }
}

/// Finds keypoints that can be found again in other images of the same scene.
pub trait FeatureExtractor: Send + Sync {
    /// Short name for menus and reports.
    fn name(&self) -> &'static str;

    /// Extracts features of a grey image (`width · height` values in 0–1, row by row).
    ///
    /// `allowed` has one value per pixel; features lie only where it is true, or anywhere without
    /// it.
    ///
    /// # Errors
    /// [`FeatureError::Network`] if a learned network fails.
    fn extract(
        &self,
        grey: &[f32],
        width: usize,
        height: usize,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError>;

    /// Frees memory that is kept for the next image.
    fn free_buffers(&self) {}

    /// Returns whether [`Self::extract_from_image`] uses the colours of an image.
    fn uses_color(&self) -> bool {
        false
    }

    /// Extracts features of a colour image.
    ///
    /// By default, only its luma is used.
    ///
    /// # Errors
    /// As [`Self::extract`].
    fn extract_from_image(
        &self,
        image: &Image,
        allowed: Option<&[bool]>,
    ) -> Result<Features, FeatureError> {
        let (width, height) = (image.width as usize, image.height as usize);
        self.extract(&image.luma(), width, height, allowed)
    }
}

/// Finds which keypoints of two images show the same point.
pub trait FeatureMatcher: Send + Sync {
    /// Short name for menus and reports.
    fn name(&self) -> &'static str;

    /// Returns pairs (index in `first`, index in `second`), one to one, ascending by the first index.
    ///
    /// # Errors
    /// [`FeatureError::Kinds`] if the two cannot be compared, [`FeatureError::Network`] if a
    /// network fails.
    fn matches(&self, first: &Features, second: &Features)
    -> Result<Vec<(u32, u32)>, FeatureError>;

    /// Returns the images of a set, by index, on which the matches of all its pairs depend.
    ///
    /// There are none if the matches of two images depend on these two alone.
    fn shared_images(&self, _images: &[&Features]) -> Vec<usize> {
        Vec::new()
    }

    /// Prepares matching within a set of images; pairs are then given by index into the set.
    ///
    /// Data that the images share is computed once, when it is first needed: the function must not
    /// start parallel jobs for that, because it is called in such jobs.
    ///
    /// # Errors
    /// As [`Self::matches`].
    fn of_set<'a>(&'a self, images: &'a [&'a Features]) -> Result<PairMatches<'a>, FeatureError> {
        Ok(Box::new(|first, second| {
            self.matches(images[first], images[second])
        }))
    }
}

/// Returns the matches of two images of a set, as [`FeatureMatcher::matches`].
pub type PairMatches<'a> =
    Box<dyn Fn(usize, usize) -> Result<Vec<(u32, u32)>, FeatureError> + Send + Sync + 'a>;

/// Reasons why features could not be extracted or matched.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FeatureError {
    /// A learned network failed.
    #[error("the feature network failed: {0}")]
    Network(String),
    /// Two images have descriptors of different kinds or sizes.
    #[error("{0}; extract the features of all images with the same extractor")]
    Kinds(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selected_features_keep_their_rows() {
        let features = Features {
            width: 9,
            height: 7,
            keypoints: vec![
                DVec2::new(1.0, 2.0),
                DVec2::new(3.0, 4.0),
                DVec2::new(5.0, 6.0),
            ],
            scales_px: vec![1.0, 2.0, 3.0],
            orientations: vec![0.1, 0.2, 0.3],
            scores: Vec::new(),
            descriptors: Descriptors::Bytes {
                dim: 2,
                values: vec![10, 11, 20, 21, 30, 31],
            },
        };
        let some = features.select(&[2, 0]);
        assert_eq!(
            (some.width, some.height, &some.scales_px[..]),
            (9, 7, &[3.0, 1.0][..])
        );
        assert_eq!(
            some.keypoints,
            [features.keypoints[2], features.keypoints[0]]
        );
        assert_eq!(some.orientations, [0.3, 0.1]);
        assert!(some.scores.is_empty());
        assert_eq!(some.descriptors.as_bytes(), Some(&[30, 31, 10, 11][..]));
    }
}
