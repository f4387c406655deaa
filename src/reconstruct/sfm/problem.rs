use glam::DVec2;

use ostra_geometry::{Camera, Pose, TwoViewKind};

/// A keypoint of an image, by number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeypointId {
    /// Which image.
    pub image: u32,
    /// Which of its keypoints.
    pub index: u32,
}

/// How far a camera's intrinsics can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IntrinsicsSource {
    /// Known; they stay as they are.
    Given,
    /// The focal length is told by the picture file; all is refined.
    Exif,
    /// Nothing is known; the focal length is looked for, all is refined.
    Guessed,
}

/// A physical camera, shared by all images that it took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapCamera {
    /// Its intrinsics, or where their refinement starts.
    pub intrinsics: Camera,
    /// How far they can be trusted.
    pub source: IntrinsicsSource,
}

/// An image as the mapper sees it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapImage {
    /// Which of the cameras took it.
    pub camera: usize,
    /// Its keypoints in pixels.
    pub keypoints: Vec<DVec2>,
    /// `camera_from_world` where it is known and shall stay.
    pub given: Option<Pose>,
}

/// Two images whose matches agree with one geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct VerifiedPair {
    /// The two images, the lower number first.
    pub images: [u32; 2],
    /// Pairs of keypoints that agree.
    pub matches: Vec<[u32; 2]>,
    /// Which geometry explains them.
    pub kind: TwoViewKind,
    /// `second_from_first` with a translation of length 1, where it could be found.
    pub second_from_first: Option<Pose>,
    /// Median angle between the two rays of a match in radians.
    pub parallax: f64,
}

/// All that the mapper works on.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MapProblem {
    /// The cameras that took the images.
    pub cameras: Vec<MapCamera>,
    /// The images.
    pub images: Vec<MapImage>,
    /// Pairs of images that see the same.
    pub pairs: Vec<VerifiedPair>,
}
