//! Keypoints, the options of their detection, and the selection of the strongest.

use std::cmp::Ordering;

use glam::Vec2;

/// A keypoint: a position that is found again at other scales and rotations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftKeypoint {
    /// Position in pixels of the original image; the centre of the top-left pixel is at (0.5, 0.5).
    pub at_px: Vec2,
    /// Standard deviation of the Gaussian at which it was found, in pixels of the original image.
    pub scale_px: f32,
    /// Direction of the strongest gradient in radians, 0..2π, from the x axis towards the y axis (down).
    pub angle: f32,
}

/// Keypoints of one image with their descriptors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SiftFeatures {
    /// Strongest first.
    pub keypoints: Vec<SiftKeypoint>,
    /// One per keypoint: 4 × 4 cells × 8 directions, square roots of shares that sum to 1, times 512.
    pub descriptors: Vec<[u8; 128]>,
}

/// Options of [`extract_sift`](super::extract_sift).
#[derive(Debug, Clone, PartialEq)]
pub struct SiftOptions {
    /// Maximum number of features per image; those of the highest contrast are kept.
    pub max_features: usize,
    /// First octave: -1 = the doubled image, 0 = the image itself, 1 = the halved image.
    pub first_octave: i32,
    /// Number of octaves from the first one on, at least 1; each halves the one before.
    pub octaves: usize,
    /// Scales per octave, 1..=8.
    pub scales: usize,
    /// Minimum contrast of a keypoint: its difference of Gaussians, for grey in 0–1.
    pub peak_threshold: f32,
    /// Maximum ratio of the two principal curvatures; higher ratios are edges.
    pub edge_threshold: f32,
    /// Maximum number of orientations, and so features, per keypoint; the strongest are kept.
    pub max_orientations: usize,
    /// Longest processed side in pixels. Larger images are shrunk first; positions are given in pixels of the original.
    pub max_side: u32,
}

impl Default for SiftOptions {
    fn default() -> Self {
        Self {
            max_features: 8192,
            first_octave: -1,
            octaves: 4,
            scales: 3,
            peak_threshold: 0.02 / 3.0,
            edge_threshold: 10.0,
            max_orientations: 2,
            max_side: 3200,
        }
    }
}

/// A feature with the strength by which it is selected.
#[derive(Debug, Clone)]
pub(super) struct Feature {
    /// The keypoint.
    pub keypoint: SiftKeypoint,
    /// Contrast of its peak, in grey.
    pub strength: f32,
    /// Its descriptor.
    pub descriptor: [u8; 128],
}

/// The strongest features so far.
///
/// Strong features are found again more often and more precisely than large ones.
#[derive(Debug)]
pub(super) struct Strongest {
    most: usize,
    least: f32,
    features: Vec<Feature>,
}

impl Strongest {
    /// Creates an empty selection that keeps at most `most` features.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            least: 0.0,
            features: Vec::new(),
        }
    }

    /// Returns the strength below which features will not be among the strongest.
    pub fn least_strength(&self) -> f32 {
        self.least
    }

    /// Adds features and drops the weakest if there are too many.
    pub fn add(&mut self, features: Vec<Feature>) {
        self.features.extend(features);
        if self.most > 0 && self.features.len() > self.most {
            let (_, weakest, _) = self
                .features
                .select_nth_unstable_by(self.most - 1, stronger_first);
            self.least = weakest.strength;
        }
        self.features.truncate(self.most);
    }

    /// Returns the selected features, strongest first.
    pub fn into_features(mut self) -> SiftFeatures {
        self.features.sort_unstable_by(stronger_first);
        let (keypoints, descriptors) = self
            .features
            .into_iter()
            .map(|f| (f.keypoint, f.descriptor))
            .unzip();
        SiftFeatures {
            keypoints,
            descriptors,
        }
    }
}

/// Orders features without ties, so that the same ones are kept in whatever order they came.
fn stronger_first(a: &Feature, b: &Feature) -> Ordering {
    let place = |f: &Feature| {
        [
            f.keypoint.at_px.y,
            f.keypoint.at_px.x,
            f.keypoint.scale_px,
            f.keypoint.angle,
        ]
    };
    let places = place(a).into_iter().zip(place(b));
    b.strength.total_cmp(&a.strength).then_with(|| {
        places
            .map(|(a, b)| a.total_cmp(&b))
            .find(|&order| order != Ordering::Equal)
            .unwrap_or(Ordering::Equal)
    })
}
