use std::collections::BTreeMap;

use glam::Vec3;
use rayon::prelude::*;

use super::picture::Picture;
use crate::engine::job::{Progress, Stopped};
use crate::frames::FrameCamera;
use crate::frames::cameras::SparsePoints;

/// A truth point is a feature's point where it lies this near to it, in pixels, in so many of the pictures that show
/// the feature.
const SAME_PX: f64 = 1.0;
const SAME_IN: usize = 3;

/// The truth points that each camera shows to be seen, ascending: those at the point of a feature that pictures have
/// in common, in the pictures that have it. What lies hidden has no such feature, and nothing is taken from the result.
pub(super) fn seen_truth(
    truth: &[Vec3],
    cameras: &[FrameCamera],
    features: &SparsePoints,
    progress: &Progress,
) -> Result<Vec<Vec<u32>>, Stopped> {
    let positions: Vec<Vec3> = features.points.iter().map(|point| point.position.as_vec3()).collect();
    let meetings = |(number, camera): (usize, &FrameCamera)| {
        progress.check()?;
        let shown: Vec<u32> = features.keypoints.get(&number).into_iter().flatten().filter_map(|k| k.point).collect();
        Ok(meetings(truth, &positions, &shown, camera))
    };
    let by_camera: Vec<Vec<(u32, u32)>> = cameras.par_iter().enumerate().map(meetings).collect::<Result<_, _>>()?;
    let mut pictures: BTreeMap<(u32, u32), usize> = BTreeMap::new();
    by_camera.iter().flatten().for_each(|&pair| *pictures.entry(pair).or_default() += 1);
    let seen = |pairs: Vec<(u32, u32)>| {
        let same = pairs.iter().filter(|pair| pictures[pair] >= SAME_IN);
        let mut seen: Vec<u32> = same.map(|&(_, truth)| truth).collect();
        seen.sort_unstable();
        seen.dedup();
        seen
    };
    Ok(by_camera.into_iter().map(seen).collect())
}

/// The (feature point, truth point) pairs that lie near each other in a picture, each once.
fn meetings(truth: &[Vec3], positions: &[Vec3], shown: &[u32], camera: &FrameCamera) -> Vec<(u32, u32)> {
    let features: Vec<Vec3> = shown.iter().map(|&point| positions[point as usize]).collect();
    let truth = Picture::new(truth, camera);
    let near = |feature: super::picture::Dot| {
        let near = truth.around(feature.at_px, 1).filter(move |dot| dot.at_px.distance(feature.at_px) <= SAME_PX);
        near.map(move |dot| (shown[feature.index as usize], dot.index))
    };
    let mut pairs: Vec<(u32, u32)> = Picture::new(&features, camera).dots.iter().copied().flat_map(near).collect();
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
