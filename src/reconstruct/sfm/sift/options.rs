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
