use glam::DVec3;

use ostra_frames::Frame;
use ostra_frames::cameras::SparsePoints;

/// Share of the points that may lie nearer, and farther, than the range before its margin.
const OUTSIDE: f64 = 0.01;
/// The range goes on by this share of its ends.
const MARGIN: f64 = 0.25;
/// Points needed for a range.
const LEAST: usize = 5;

/// The sparse points that a frame sees, in its camera's axes: their z is above 0.
#[must_use]
pub fn seen_points(frame: &Frame, number: usize, sparse: &SparsePoints) -> Vec<DVec3> {
    let Some((_, pose)) = frame.posed_camera() else {
        return Vec::new();
    };
    let keypoints = sparse.keypoints.get(&number).into_iter().flatten();
    let points = keypoints.filter_map(|keypoint| {
        let point = sparse.points.get(keypoint.point? as usize)?;
        Some(pose.transform(point.position))
    });
    points
        .filter(|x_in_camera| x_in_camera.z > 0.0 && x_in_camera.is_finite())
        .collect()
}

/// Smallest and largest depth to search, from those of sparse points: all but the farthest off hundredth at either end,
/// and a margin. `None` for too few points.
#[must_use]
pub fn depth_range(points_in_camera: &[DVec3]) -> Option<[f64; 2]> {
    let mut depths: Vec<f64> = points_in_camera.iter().map(|x| x.z).collect();
    depths.sort_unstable_by(f64::total_cmp);
    let off = (OUTSIDE * depths.len() as f64) as usize;
    let (near, far) = (depths.get(off)?, depths.get(depths.len() - 1 - off)?);
    (depths.len() >= LEAST).then_some([near * (1.0 - MARGIN), far * (1.0 + MARGIN)])
}
