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
