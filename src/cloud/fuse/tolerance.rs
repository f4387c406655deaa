use glam::Vec3;

use super::source::Views;
use super::view::View;
use crate::SceneError;

/// Frames looked at.
const FRAMES: usize = 6;
/// Points looked at in each.
const POINTS: usize = 20_000;
/// Differences above this share of the depth are another surface, not noise.
const SAME_SURFACE: f64 = 0.05;
/// Share of the differences that must be within the tolerance.
const QUANTILE: f64 = 0.9;
/// Where too little can be measured.
const UNKNOWN: f64 = 0.01;
/// What is taken for possible of a sensor and of poses.
const RANGE: [f64; 2] = [0.001, 0.02];

/// How far, as a share of the depth, frames' depths lie from points made of them all, beyond `absolute` world units:
/// noise of the sensor, errors of poses, what averaging takes away. Exact depths can be held to much more strictly than
/// a sensor's, and then tell a stem from the leaf right before it.
pub(super) fn measured_tolerance(
    points: &[Vec3],
    views: &dyn Views,
    frames: &[usize],
    absolute: f64,
) -> Result<f64, SceneError> {
    let mut differences: Vec<f64> = Vec::new();
    for &index in frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1)) {
        let (Some(view), Some(depth)) = (View::new(&views.frames()[index])?, views.depth(index)?)
        else {
            continue;
        };
        for &point in points.iter().step_by(points.len().div_ceil(POINTS).max(1)) {
            let Some(at) = view.project(point) else {
                continue;
            };
            let there = depth
                .depths
                .get(at.y as usize * depth.width as usize + at.x as usize);
            let Some(&there) = there.filter(|&&there| there > 0.0) else {
                continue;
            };
            let difference = (f64::from(there) - at.depth).abs() - absolute;
            if difference <= SAME_SURFACE * at.depth {
                differences.push(difference.max(0.0) / at.depth);
            }
        }
    }
    if differences.len() < 100 {
        return Ok(UNKNOWN);
    }
    let place = (QUANTILE * differences.len() as f64) as usize;
    let (_, share, _) = differences.select_nth_unstable_by(place, f64::total_cmp);
    Ok(share.clamp(RANGE[0], RANGE[1]))
}
