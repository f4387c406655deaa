//! Visibility of points in frames: projection, depth tolerance, and depth splatted from points.

use glam::{DVec2, Vec3};

use super::views::{Views, check_size};
use crate::SceneError;
use ostra_core::statistics::quantile;
use ostra_frames::{DepthMap, Frame};
use ostra_geometry::{DepthTolerance, PointProjection, PosedCamera};

/// The projection of a point into an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct PixelProjection {
    /// Position in pixels.
    at_px: DVec2,
    /// Column of the pixel that contains it.
    x: u32,
    /// Row of the pixel that contains it.
    y: u32,
    /// Depth along the optical axis, in world units.
    depth: f64,
}

/// Returns the camera of a frame at its pose, or `None` if either is unknown.
///
/// # Errors
///
/// Returns an error if the size of the camera differs from that of the frame's image.
pub(super) fn posed_view(frame: &Frame) -> Result<Option<PosedCamera>, SceneError> {
    let Some((camera, pose)) = frame.posed_camera() else {
        return Ok(None);
    };
    check_size(frame, "camera", camera.width, camera.height)?;
    Ok(Some(PosedCamera::new(camera, pose)))
}

/// Projects a point in world space; returns `None` behind the camera or outside the image.
#[inline]
pub(super) fn project_inside(view: &PosedCamera, x_in_world: Vec3) -> Option<PixelProjection> {
    let PointProjection { at_px, depth } = view.project(x_in_world.as_dvec3())?;
    let inside = at_px.x >= 0.0
        && at_px.y >= 0.0
        && at_px.x < f64::from(view.camera.width)
        && at_px.y < f64::from(view.camera.height);
    inside.then_some(PixelProjection {
        at_px,
        x: at_px.x as u32,
        y: at_px.y as u32,
        depth,
    })
}

/// Returns the pixel in which a depth map sees a point, if any.
///
/// This is normally the pixel that the point projects to. If that pixel has no depth, or one behind
/// the point, it is the nearest of the eight neighbours that agrees. Otherwise a depth or pose that
/// is off by a pixel at the edge of a thin part would hide the part from every view. If the pixel's
/// depth is in front of the point, the point is occluded.
pub(super) fn seen_at(
    depth: &DepthMap,
    point: &PixelProjection,
    tolerance: DepthTolerance,
) -> Option<(u32, u32)> {
    let allowed = tolerance.at(point.depth);
    // Unknown depth is 0 and never agrees.
    let (near, far) = (
        (point.depth - allowed).max(f64::MIN_POSITIVE) as f32,
        (point.depth + allowed) as f32,
    );
    let agrees = |x: u32, y: u32| (near..=far).contains(&depth.at(x, y));
    if agrees(point.x, point.y) {
        return Some((point.x, point.y));
    }
    let own = depth.at(point.x, point.y);
    if own > 0.0 && own < near {
        return None;
    }
    let columns = point.x.saturating_sub(1)..=(point.x + 1).min(depth.width - 1);
    let rows = point.y.saturating_sub(1)..=(point.y + 1).min(depth.height - 1);
    let mut nearest: Option<(f64, (u32, u32))> = None;
    for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
        if agrees(x, y) {
            let centre = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let distance = centre.distance_squared(point.at_px);
            if nearest.is_none_or(|(best, _)| distance < best) {
                nearest = Some((distance, (x, y)));
            }
        }
    }
    nearest.map(|(_, pixel)| pixel)
}

/// Maximum number of sampled frames.
const FRAMES: usize = 6;
/// Maximum number of sampled points per frame.
const POINTS: usize = 20_000;
/// Share of the depth above which a difference is another surface rather than noise.
const SAME_SURFACE: f64 = 0.05;
/// Share of the differences that must be within the tolerance.
const QUANTILE: f64 = 0.9;
/// Tolerance if there are too few measurements.
const UNKNOWN: f64 = 0.01;
/// Plausible range of the tolerance, given sensor noise and pose errors.
const RANGE: [f64; 2] = [0.001, 0.02];

/// Measures how far frame depths lie from points fused from all of them, as a share of the depth.
///
/// Only the part beyond `absolute` world units counts. It covers sensor noise, pose errors and the
/// effect of averaging. Exact depths allow a much stricter tolerance than those of a sensor, which
/// then separates a stem from the leaf right in front of it.
pub(super) fn measured_tolerance(
    points: &[Vec3],
    views: &dyn Views,
    frames: &[usize],
    absolute: f64,
) -> Result<f64, SceneError> {
    let mut differences: Vec<f64> = Vec::new();
    for &index in frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1)) {
        let (Some(view), Some(depth)) = (posed_view(&views.frames()[index])?, views.depth(index)?)
        else {
            continue;
        };
        for &point in points.iter().step_by(points.len().div_ceil(POINTS).max(1)) {
            let Some(at) = project_inside(&view, point) else {
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
    let share = quantile(&mut differences, QUANTILE);
    Ok(share.map_or(UNKNOWN, |share| share.clamp(RANGE[0], RANGE[1])))
}

/// Renders the depth map of a cloud in a view.
///
/// Every point is a disc of `radius` world units that faces the camera; the nearest disc wins. The
/// map hides the far side of a surface if a frame has no depth of its own.
pub(super) fn splat_depth(points: &[Vec3], view: &PosedCamera, radius: f64) -> DepthMap {
    let (width, height) = (view.camera.width, view.camera.height);
    let mut map = DepthMap {
        width,
        height,
        depths: vec![f32::INFINITY; width as usize * height as usize],
    };
    let focal = view.camera.focal_px.max_element();
    for &point in points {
        let Some(at) = project_inside(view, point) else {
            continue;
        };
        draw_disc(
            &mut map,
            at.at_px,
            radius * focal / at.depth,
            at.depth as f32,
        );
    }
    for depth in &mut map.depths {
        *depth = if depth.is_finite() { *depth } else { 0.0 };
    }
    map
}

/// Draws a disc into a depth map.
///
/// It covers the pixels whose centres lie within `radius` of `at_px`, and always the pixel that
/// contains `at_px`.
fn draw_disc(map: &mut DepthMap, at_px: DVec2, radius: f64, depth: f32) {
    // A point right in front of the camera would cover the whole image.
    let radius = radius.min(32.0);
    let range = |at: f64, size: u32| {
        let first = (at - radius).floor().max(0.0) as u32;
        let last = ((at + radius).floor() as u32).min(size - 1);
        first..=last
    };
    let own = (at_px.x as u32, at_px.y as u32);
    for y in range(at_px.y, map.height) {
        for x in range(at_px.x, map.width) {
            let centre = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            if (x, y) == own || centre.distance_squared(at_px) <= radius * radius {
                let there = &mut map.depths[y as usize * map.width as usize + x as usize];
                *there = there.min(depth);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE: DepthTolerance = DepthTolerance {
        absolute: 0.0,
        relative: 0.01,
    };

    /// Returns a map of three by three pixels, all at depth 2 except the given ones.
    fn map(others: &[(usize, f32)]) -> DepthMap {
        let mut depths = vec![2.0; 9];
        others
            .iter()
            .for_each(|&(index, depth)| depths[index] = depth);
        DepthMap {
            width: 3,
            height: 3,
            depths,
        }
    }

    fn at(x: f64, y: f64, depth: f64) -> PixelProjection {
        PixelProjection {
            at_px: glam::DVec2::new(x, y),
            x: x as u32,
            y: y as u32,
            depth,
        }
    }

    #[test]
    fn point_is_seen_in_its_own_pixel_or_the_nearest_that_agrees() {
        assert_eq!(
            seen_at(&map(&[]), &at(1.5, 1.5, 2.01), TOLERANCE),
            Some((1, 1))
        );
        assert_eq!(
            seen_at(&map(&[(3, 1.0), (5, 1.0)]), &at(1.6, 1.5, 1.0), TOLERANCE),
            Some((2, 1))
        );
        assert_eq!(
            seen_at(&map(&[(4, 0.0)]), &at(1.1, 1.4, 2.0), TOLERANCE),
            Some((0, 1))
        );
        assert_eq!(seen_at(&map(&[]), &at(1.5, 1.5, 1.0), TOLERANCE), None);
        assert_eq!(
            seen_at(&map(&[]), &at(2.9, 0.1, 2.0), TOLERANCE),
            Some((2, 0))
        );
    }

    #[test]
    fn occluded_point_is_not_seen_in_a_neighbouring_pixel() {
        assert_eq!(
            seen_at(&map(&[(4, 1.0)]), &at(1.5, 1.5, 2.0), TOLERANCE),
            None
        );
        assert_eq!(
            seen_at(&map(&[(4, 3.0)]), &at(1.5, 1.5, 2.0), TOLERANCE),
            Some((1, 0))
        );
    }
}
