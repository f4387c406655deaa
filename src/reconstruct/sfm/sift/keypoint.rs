//! Keypoints, the options of their finding, and the strongest of them.

use std::cmp::Ordering;

use glam::Vec2;

/// A place that looks the same at every distance and turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SiftKeypoint {
    /// Position in pixels of the original picture; centre of the top-left pixel at (0.5, 0.5).
    pub at_px: Vec2,
    /// Standard deviation of the Gaussian that it was found at, in pixels of the original picture.
    pub scale_px: f32,
    /// Direction of the strongest gradient in radians, 0..2π, from the x axis towards the y axis (down).
    pub angle: f32,
}

/// Keypoints of one picture and how their surroundings look.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SiftFeatures {
    /// The strongest first.
    pub keypoints: Vec<SiftKeypoint>,
    /// One per keypoint: 4 × 4 cells × 8 directions, square roots of shares that sum to 1, times 512.
    pub descriptors: Vec<[u8; 128]>,
}

/// How [`extract_sift`](super::extract_sift) looks for keypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct SiftOptions {
    /// Most features told per picture; the strongest stay (those of the highest contrast).
    pub max_features: usize,
    /// Where the finest octave lies: -1 = the picture doubled, 0 = as it is, 1 = halved.
    pub first_octave: i32,
    /// Octaves, from the first one on; each halves the one before. At least 1.
    pub octaves: usize,
    /// Scales per octave, 1..=8.
    pub scales: usize,
    /// Least contrast of a keypoint: its difference of Gaussians, in grey of 0..1.
    pub peak_threshold: f32,
    /// Largest ratio of the two principal curvatures; more is an edge.
    pub edge_threshold: f32,
    /// Most orientations, and so features, per keypoint; the strongest stay.
    pub max_orientations: usize,
    /// Longest side worked on, in pixels: larger pictures are shrunk first, positions are told in the original's pixels.
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

/// A feature with what it is chosen by.
#[derive(Debug, Clone)]
pub(super) struct Feature {
    /// Where it is.
    pub keypoint: SiftKeypoint,
    /// Contrast of its peak, in grey.
    pub strength: f32,
    /// How its surroundings look.
    pub descriptor: [u8; 128],
}

/// The strongest features so far. Strong ones are found again more often and more exactly than large ones.
#[derive(Debug)]
pub(super) struct Strongest {
    most: usize,
    least: f32,
    features: Vec<Feature>,
}

impl Strongest {
    /// None yet, `most` at the end.
    pub fn new(most: usize) -> Self {
        Self {
            most,
            least: 0.0,
            features: Vec::new(),
        }
    }

    /// What is weaker will not be among the strongest.
    pub fn least_strength(&self) -> f32 {
        self.least
    }

    /// Adds features and drops the weakest where there are too many.
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

    /// All that stayed, the strongest first.
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

/// An order without ties, so that the same features stay in whatever order they came.
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
