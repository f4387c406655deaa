//! Which points a frame sees: projection, depth tolerance, and depth splatted from points.

use glam::{DMat3, DVec2, DVec3, Vec3};

use super::views::{Views, check_size};
use crate::SceneError;
use ostra_frames::{DepthMap, Frame};
use ostra_geometry::{Camera, Distortion};

/// A posed camera made ready to project many points.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) camera: Camera,
    /// Rotation of `camera_from_world`.
    pub(super) rotation: DMat3,
    /// Translation of `camera_from_world`.
    pub(super) translation: DVec3,
}

/// Where a point falls in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection {
    /// Position in pixels.
    at_px: DVec2,
    /// Column of the pixel that holds it.
    x: u32,
    /// Row of the pixel that holds it.
    y: u32,
    /// Depth along the optical axis.
    depth: f64,
}

impl View {
    /// The frame's view; `None` when its camera or pose is not known.
    pub(super) fn new(frame: &Frame) -> Result<Option<Self>, SceneError> {
        let Some((camera, pose)) = frame.posed_camera() else {
            return Ok(None);
        };
        check_size(frame, "camera", camera.width, camera.height)?;
        let rotation = DMat3::from_quat(pose.rotation);
        Ok(Some(Self {
            camera: *camera,
            rotation,
            translation: pose.translation,
        }))
    }

    /// The camera's place in the world.
    pub(super) fn centre(&self) -> DVec3 {
        self.rotation.transpose() * -self.translation
    }

    /// Projects a point of the world; `None` behind the camera or outside the picture.
    pub(super) fn project(&self, x_in_world: Vec3) -> Option<Projection> {
        let x_in_camera = self.rotation * x_in_world.as_dvec3() + self.translation;
        let at_px = if matches!(self.camera.distortion, Distortion::None) {
            if x_in_camera.z <= 0.0 {
                return None;
            }
            x_in_camera.truncate() / x_in_camera.z * self.camera.focal_px + self.camera.principal_px
        } else {
            self.camera.project(x_in_camera)?
        };
        let inside = at_px.x >= 0.0
            && at_px.y >= 0.0
            && at_px.x < f64::from(self.camera.width)
            && at_px.y < f64::from(self.camera.height);
        inside.then_some(Projection {
            at_px,
            x: at_px.x as u32,
            y: at_px.y as u32,
            depth: x_in_camera.z,
        })
    }

    /// Whether a ball may show in the picture. For lenses with distortion only what lies behind is excluded.
    pub(super) fn may_see(&self, centre: DVec3, radius: f64) -> bool {
        let c = self.rotation * centre + self.translation;
        if c.z + radius <= 0.0 {
            return false;
        }
        if !matches!(self.camera.distortion, Distortion::None) {
            return true;
        }
        let (focal, principal) = (self.camera.focal_px, self.camera.principal_px);
        let size = DVec2::new(f64::from(self.camera.width), f64::from(self.camera.height));
        // The four sides of the viewing pyramid as planes through the camera, normals inwards.
        let inside = |lateral: f64, focal: f64, towards: f64| {
            (focal * lateral + towards * c.z) / focal.hypot(towards) > -radius
        };
        inside(c.x, focal.x, principal.x)
            && inside(-c.x, focal.x, size.x - principal.x)
            && inside(c.y, focal.y, principal.y)
            && inside(-c.y, focal.y, size.y - principal.y)
    }
}

/// How far a point's depth may be from the depth map's at the same pixel for the point to be seen there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tolerance {
    /// In world units.
    pub(super) absolute: f64,
    /// As a share of the depth.
    pub(super) relative: f64,
}

impl Tolerance {
    fn at(self, depth: f64) -> f64 {
        self.absolute + self.relative * depth
    }
}

/// The pixel in which a depth map sees a point, if any.
///
/// That is the pixel the point falls into. Where that pixel has no depth or one behind the point, the nearest of the
/// eight around it that agrees: at the edge of a thin part, a depth or pose that is off by a pixel would otherwise hide
/// the part from every view. Where the pixel's depth is before the point, something hides it.
pub(super) fn seen_at(
    depth: &DepthMap,
    point: &Projection,
    tolerance: Tolerance,
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

/// The depth map that a cloud would give in a view: every point as a disc of `radius` world units that faces the camera,
/// the nearest wins. It hides the far side of a surface where a frame has no depth of its own.
pub(super) fn splat_depth(points: &[Vec3], view: &View, radius: f64) -> DepthMap {
    let (width, height) = (view.camera.width, view.camera.height);
    let mut map = DepthMap {
        width,
        height,
        depths: vec![f32::INFINITY; width as usize * height as usize],
    };
    let focal = view.camera.focal_px.max_element();
    for &point in points {
        let Some(at) = view.project(point) else {
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

/// Draws the pixels whose centres lie within `radius` of `at_px`, and always the one that holds it.
fn draw_disc(map: &mut DepthMap, at_px: DVec2, radius: f64, depth: f32) {
    // A point right before the camera would cover the whole picture.
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

    const TOLERANCE: Tolerance = Tolerance {
        absolute: 0.0,
        relative: 0.01,
    };

    /// Three by three pixels, all at depth 2 but the given ones.
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

    fn at(x: f64, y: f64, depth: f64) -> Projection {
        Projection {
            at_px: glam::DVec2::new(x, y),
            x: x as u32,
            y: y as u32,
            depth,
        }
    }

    #[test]
    fn own_pixel_first_then_the_nearest_that_agrees() {
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
    fn what_is_hidden_is_not_seen_past_the_edge_of_what_hides_it() {
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
