use glam::{DVec2, DVec3};

use crate::{Camera, Pose};

/// What is adjusted: cameras, where each picture was taken, points, and where the points were seen.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Bundle {
    /// Intrinsics; several images may share one.
    pub cameras: Vec<Camera>,
    /// The pictures' poses.
    pub images: Vec<BundleImage>,
    /// In world space.
    pub points: Vec<DVec3>,
    /// In any order.
    pub observations: Vec<BundleObservation>,
}

/// One picture of a [`Bundle`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleImage {
    /// Index of its camera.
    pub camera: u32,
    /// World space to camera space.
    pub camera_from_world: Pose,
}

/// One point seen in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleObservation {
    /// Index of the image.
    pub image: u32,
    /// Index of the point.
    pub point: u32,
    /// Where it was seen, in pixels.
    pub at_px: DVec2,
}
