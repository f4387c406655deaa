/// How a model is grown. Defaults follow Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapperOptions {
    /// Matches that the first pair must have.
    pub first_pair_matches: usize,
    /// Median angle between the rays of the first pair's matches, in radians.
    pub first_pair_parallax: f64,
    /// Reprojection error in pixels up to which a sighting supports a camera's pose.
    pub pose_error_px: f64,
    /// Sightings that must support a camera's pose.
    pub pose_inliers: usize,
    /// Share of an image's sightings that must support its pose.
    pub pose_inlier_share: f64,
    /// Reprojection error in pixels above which a sighting is dropped.
    pub max_error_px: f64,
    /// Smallest angle between two rays of a point, in radians.
    pub min_angle: f64,
    /// Images whose poses are adjusted with a new one.
    pub local_images: usize,
    /// Growth of images or points at which all is adjusted.
    pub global_growth: f64,
    /// Images below which a model is not kept.
    pub min_model_images: usize,
    /// Points below which a model is not kept.
    pub min_model_points: usize,
    /// Seed of all random choices.
    pub seed: u64,
}

impl Default for MapperOptions {
    fn default() -> Self {
        Self {
            first_pair_matches: 100,
            first_pair_parallax: 16f64.to_radians(),
            pose_error_px: 12.0,
            pose_inliers: 30,
            pose_inlier_share: 0.25,
            max_error_px: 4.0,
            min_angle: 1.5f64.to_radians(),
            local_images: 6,
            global_growth: 1.1,
            min_model_images: 2,
            min_model_points: 60,
            seed: 0,
        }
    }
}
