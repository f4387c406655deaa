use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::picture::{Dot, Picture};
use ostra_core::job::{Progress, Stopped};
use ostra_frames::FrameCamera;
use ostra_frames::cameras::SparsePoints;

/// Pictures and what they have in common: what tells which points each camera sees.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FeatureViews {
    /// Cameras of the pictures, in the truth's space.
    pub cameras: Vec<FrameCamera>,
    /// Points of features with the keypoints that show them, by the camera's place in `cameras`.
    pub features: SparsePoints,
}

/// A truth point is a feature's point where it lies this near to it, in pixels of the reduced pictures, in all pictures
/// that show the feature.
const SAME_PX: f64 = 1.0;
/// So many pictures must show the feature, and from directions so far apart (radians): what lies two hundredths of the
/// depth farther behind is then a pixel or so aside in some of them.
const LEAST_PICTURES: usize = 3;
const LEAST_ANGLE: f64 = 0.0873;

impl FeatureViews {
    /// The truth points that each camera shows to be seen, ascending: those at the point of a feature that enough
    /// pictures have in common, in these pictures. What lies hidden has no such feature, and nothing is taken from the
    /// result.
    pub(super) fn seen_truth(
        &self,
        truth: &[Vec3],
        progress: &Progress,
    ) -> Result<Vec<Vec<u32>>, Stopped> {
        let tracks = self.tracks();
        let mut shown: Vec<Vec<u32>> = vec![Vec::new(); self.cameras.len()];
        for (feature, track) in tracks
            .iter()
            .enumerate()
            .filter(|(feature, track)| self.tells(*feature, track))
        {
            track
                .iter()
                .for_each(|&camera| shown[camera].push(feature as u32));
        }
        let meetings = |(shown, camera): (&Vec<u32>, &FrameCamera)| {
            progress.check()?;
            Ok(self.meetings(truth, shown, camera))
        };
        let by_camera: Vec<Vec<(u32, u32)>> = shown
            .par_iter()
            .zip(&self.cameras)
            .map(meetings)
            .collect::<Result<_, Stopped>>()?;
        let mut pictures: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        by_camera
            .iter()
            .flatten()
            .for_each(|&pair| *pictures.entry(pair).or_default() += 1);
        let seen = |pairs: Vec<(u32, u32)>| {
            let same = pairs
                .iter()
                .filter(|pair| pictures[pair] == tracks[pair.0 as usize].len());
            let mut seen: Vec<u32> = same.map(|&(_, truth)| truth).collect();
            seen.sort_unstable();
            seen.dedup();
            seen
        };
        Ok(by_camera.into_iter().map(seen).collect())
    }

    /// By feature the cameras that show it.
    fn tracks(&self) -> Vec<Vec<usize>> {
        let cameras = |track: Vec<(usize, u32)>| {
            let mut cameras: Vec<usize> = track.into_iter().map(|(camera, _)| camera).collect();
            cameras.retain(|&camera| camera < self.cameras.len());
            cameras.dedup();
            cameras
        };
        self.features.tracks().into_iter().map(cameras).collect()
    }

    /// Whether enough pictures show a feature, from directions far enough apart.
    fn tells(&self, feature: usize, track: &[usize]) -> bool {
        let position = self.features.points[feature].position;
        let poses = track
            .iter()
            .filter_map(|&camera| self.cameras[camera].camera_from_world);
        let rays: Vec<DVec3> = poses
            .map(|pose| (pose.centre() - position).normalize_or_zero())
            .collect();
        let far = |a: &DVec3| rays.iter().any(|b| a.angle_between(*b) >= LEAST_ANGLE);
        rays.len() >= LEAST_PICTURES && rays.iter().any(far)
    }

    /// The (feature, truth point) pairs that lie near each other in a picture, each once.
    fn meetings(&self, truth: &[Vec3], shown: &[u32], camera: &FrameCamera) -> Vec<(u32, u32)> {
        let positions: Vec<Vec3> = shown
            .iter()
            .map(|&feature| self.features.points[feature as usize].position.as_vec3())
            .collect();
        let truth = Picture::new(truth, camera);
        let near = |feature: Dot| {
            let near = truth
                .around(feature.at_px, 1)
                .filter(move |dot| dot.at_px.distance(feature.at_px) <= SAME_PX);
            near.map(move |dot| (shown[feature.index as usize], dot.index))
        };
        let mut pairs: Vec<(u32, u32)> = Picture::new(&positions, camera)
            .dots
            .iter()
            .copied()
            .flat_map(near)
            .collect();
        pairs.sort_unstable();
        pairs.dedup();
        pairs
    }
}
