use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

/// A point of a sparse model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparsePoint {
    /// In world units.
    pub position: DVec3,
    /// sRGB.
    pub color: [u8; 3],
    /// Mean reprojection error in pixels; `None` = unknown.
    pub error_px: Option<f64>,
}

/// A keypoint of a frame's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SparseKeypoint {
    /// In the picture as shown, centre of the top-left pixel at (0.5, 0.5).
    pub at_px: DVec2,
    /// Index of the point that it sees.
    pub point: Option<u32>,
}

/// The points of a sparse model and the keypoints that see them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SparsePoints {
    /// The points.
    pub points: Vec<SparsePoint>,
    /// By frame number, the keypoints of its picture; empty where they are not known.
    pub keypoints: BTreeMap<usize, Vec<SparseKeypoint>>,
}

impl SparsePoints {
    /// Points whose keypoints are not known.
    #[must_use]
    pub fn without_keypoints(points: Vec<SparsePoint>) -> Self {
        Self {
            points,
            keypoints: BTreeMap::new(),
        }
    }

    /// Per point the (frame, keypoint) pairs that see it, in that order.
    #[must_use]
    pub fn tracks(&self) -> Vec<Vec<(usize, u32)>> {
        let mut tracks = vec![Vec::new(); self.points.len()];
        for (&frame, keypoints) in &self.keypoints {
            for (index, keypoint) in keypoints.iter().enumerate() {
                if let Some(track) = keypoint
                    .point
                    .and_then(|point| tracks.get_mut(point as usize))
                {
                    track.push((frame, index as u32));
                }
            }
        }
        tracks
    }
}
