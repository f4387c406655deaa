use glam::{DVec2, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use super::DepthMap;
use ostra_geometry::{Camera, Pose, is_same_depth};

/// Maximum relative difference of depth on one surface.
///
/// Nothing is drawn between different surfaces.
const SAME_SURFACE: f32 = 0.03;

/// The camera that measured depth, if it differs from the image's camera.
///
/// [`super::FrameStore`] converts such depth to the image's camera on loading, so that the vote,
/// the trackers and the window handle one camera per frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DepthCamera {
    /// Intrinsics for the depth as shown (rotated upright).
    pub intrinsics: Camera,
    /// Transform from this camera's axes to those of the image's camera, in world units.
    #[serde(rename = "picture_from_depth")] // the name in project files of format 1
    pub image_from_depth: Pose,
    /// Whether it was estimated together with the images' camera by comparing images with depth.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub estimated: bool,
}

impl DepthCamera {
    /// Returns the measured depth as seen by `picture`, the image's camera.
    ///
    /// Surfaces between neighbouring pixels are drawn as triangles, and nearer ones hide farther
    /// ones. Parts that only one of both cameras sees stay unknown.
    #[must_use]
    pub fn seen_by(&self, depth: &DepthMap, image: &Camera) -> DepthMap {
        let width = depth.width as usize;
        let corners: Vec<Corner> = (0..depth.depths.len())
            .map(|pixel| self.corner(depth, pixel, image))
            .collect();
        let mut seen = Canvas::new(image);
        let mut drawn = vec![false; corners.len()];
        for row in 1..depth.height as usize {
            for right in 1..width {
                let [a, b] = [(row - 1) * width + right - 1, (row - 1) * width + right];
                let [c, d] = [a + width, b + width];
                for triangle in [[a, b, c], [b, d, c]] {
                    let corners = triangle.map(|pixel| corners[pixel]);
                    if is_surface(&corners) {
                        seen.draw(&corners);
                        triangle.into_iter().for_each(|pixel| drawn[pixel] = true);
                    }
                }
            }
        }
        corners
            .iter()
            .zip(drawn)
            .filter(|(_, drawn)| !drawn)
            .for_each(|(alone, _)| seen.dot(alone));
        seen.finish()
    }

    fn corner(&self, depth: &DepthMap, pixel: usize, image: &Camera) -> Corner {
        let (x, y) = (pixel % depth.width as usize, pixel / depth.width as usize);
        let at_px = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        let along = f64::from(depth.depths[pixel]);
        let point = self
            .image_from_depth
            .transform(self.intrinsics.unproject(at_px).extend(1.0) * along);
        let seen = (along > 0.0).then(|| image.project(point)).flatten();
        seen.map_or(Corner::UNKNOWN, |at_px| Corner {
            at_px: at_px.as_vec2(),
            depth: point.z as f32,
        })
    }
}

/// Position of a pixel of the depth camera in the image.
#[derive(Clone, Copy)]
struct Corner {
    at_px: Vec2,
    /// Depth; 0 = unknown.
    depth: f32,
}

impl Corner {
    const UNKNOWN: Self = Self {
        at_px: Vec2::ZERO,
        depth: 0.0,
    };
}

fn is_surface(corners: &[Corner; 3]) -> bool {
    let depths = Vec3::from(corners.map(|corner| corner.depth));
    let nearest = depths.min_element();
    nearest > 0.0 && is_same_depth(depths.max_element(), nearest, SAME_SURFACE)
}

/// Nearest depth of each pixel so far; infinite = none.
struct Canvas {
    width: u32,
    height: u32,
    depths: Vec<f32>,
}

impl Canvas {
    fn new(camera: &Camera) -> Self {
        let (width, height) = (camera.width, camera.height);
        Self {
            width,
            height,
            depths: vec![f32::INFINITY; width as usize * height as usize],
        }
    }

    /// Draws a triangle over the pixels with centres inside it.
    ///
    /// Inverse depth is linear in an image.
    fn draw(&mut self, corners: &[Corner; 3]) {
        let [a, b, c] = corners.map(|corner| corner.at_px);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 {
            return;
        }
        let inverse = Vec3::from(corners.map(|corner| 1.0 / corner.depth));
        let size = Vec2::new(self.width as f32, self.height as f32);
        let first = (a.min(b).min(c) - 0.5).ceil().clamp(Vec2::ZERO, size);
        let end = (a.max(b).max(c) + 0.5).floor().clamp(Vec2::ZERO, size);
        for y in first.y as u32..end.y as u32 {
            for x in first.x as u32..end.x as u32 {
                let at = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
                let shares = Vec3::new(
                    (b - at).perp_dot(c - at),
                    (c - at).perp_dot(a - at),
                    (a - at).perp_dot(b - at),
                );
                let shares = shares / area;
                if shares.min_element() >= 0.0 {
                    self.put(x, y, 1.0 / shares.dot(inverse));
                }
            }
        }
    }

    /// Draws one pixel.
    fn dot(&mut self, corner: &Corner) {
        let inside = corner.at_px.cmpge(Vec2::ZERO).all()
            && corner
                .at_px
                .cmplt(Vec2::new(self.width as f32, self.height as f32))
                .all();
        if corner.depth > 0.0 && inside {
            self.put(corner.at_px.x as u32, corner.at_px.y as u32, corner.depth);
        }
    }

    fn put(&mut self, x: u32, y: u32, depth: f32) {
        let nearest = &mut self.depths[(y * self.width + x) as usize];
        *nearest = nearest.min(depth);
    }

    fn finish(self) -> DepthMap {
        let depths = self
            .depths
            .into_iter()
            .map(|depth| if depth.is_finite() { depth } else { 0.0 })
            .collect();
        DepthMap {
            width: self.width,
            height: self.height,
            depths,
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    fn depth_camera() -> DepthCamera {
        let rotation = DQuat::from_rotation_z(0.01);
        let image_from_depth = Pose {
            rotation,
            translation: DVec3::new(-0.025, 0.002, 0.003),
        };
        DepthCamera {
            intrinsics: Camera::pinhole(160, 120, [146.0, 146.0], [80.0, 60.0]),
            image_from_depth,
            estimated: false,
        }
    }

    fn image() -> Camera {
        Camera::pinhole(320, 240, [262.0, 264.0], [161.0, 118.0])
    }

    /// Returns the depth of the plane `normal · x = offset`, in the depth camera's axes.
    fn plane(camera: &Camera, normal: DVec3, offset: f64) -> DepthMap {
        let depth = |pixel: u32| {
            let at_px = DVec2::new(
                f64::from(pixel % camera.width) + 0.5,
                f64::from(pixel / camera.width) + 0.5,
            );
            (offset / normal.dot(camera.unproject(at_px).extend(1.0))) as f32
        };
        let (width, height) = (camera.width, camera.height);
        DepthMap {
            width,
            height,
            depths: (0..width * height).map(depth).collect(),
        }
    }

    #[test]
    fn slanted_wall_is_seen_at_its_position() {
        let camera = depth_camera();
        let (normal, offset) = (DVec3::new(0.3, -0.2, 1.0).normalize(), 1.5);
        let seen = camera.seen_by(&plane(&camera.intrinsics, normal, offset), &image());
        // The same plane in the image's axes.
        let turned = camera.image_from_depth.rotation * normal;
        let exact = plane(
            &image(),
            turned,
            offset + turned.dot(camera.image_from_depth.translation),
        );
        let mut known = 0;
        for (seen, exact) in seen
            .depths
            .iter()
            .zip(&exact.depths)
            .filter(|(seen, _)| **seen > 0.0)
        {
            known += 1;
            assert!((seen - exact).abs() < 1e-4 * exact, "{seen} is not {exact}");
        }
        assert!(
            known > 320 * 240 * 3 / 4,
            "{known} pixels known: the image sees a tenth farther to each side"
        );
        let middle = &seen.depths[60 * 320..180 * 320];
        let inner = middle.chunks(320).flat_map(|row| &row[60..260]);
        assert!(
            inner.into_iter().all(|&depth| depth > 0.0),
            "no holes between the larger pixels"
        );
    }

    #[test]
    fn near_surface_hides_far_one_and_the_rest_stays_unknown() {
        let camera = DepthCamera {
            image_from_depth: Pose {
                translation: DVec3::X * -0.1,
                ..Pose::IDENTITY
            },
            ..depth_camera()
        };
        let mut depth = plane(&camera.intrinsics, DVec3::Z, 2.0);
        // A bar 30 pixels wide, half as far away, from column 60.
        for (pixel, depth) in depth.depths.iter_mut().enumerate() {
            if (60..90).contains(&(pixel % 160)) {
                *depth = 1.0;
            }
        }
        let image = camera.intrinsics;
        let row = &camera.seen_by(&depth, &image).depths[60 * 160..61 * 160];
        // The wall moves by 7.3 pixels to the left, the bar by 14.6; depth behind its right side is
        // unknown.
        let is = |columns: std::ops::Range<usize>, wanted: f32| {
            columns.into_iter().all(|x| (row[x] - wanted).abs() < 1e-5)
        };
        assert!(
            is(0..45, 2.0) && is(46..74, 1.0) && is(76..82, 0.0) && is(84..151, 2.0),
            "{row:?}"
        );
    }

    #[test]
    fn same_camera_sees_the_same_and_keeps_isolated_pixels() {
        let intrinsics = depth_camera().intrinsics;
        let camera = DepthCamera {
            intrinsics,
            image_from_depth: Pose::IDENTITY,
            estimated: false,
        };
        let mut depth = plane(&intrinsics, DVec3::Z, 2.0);
        depth.depths[..40 * 160].fill(0.0);
        depth.depths[20 * 160 + 80] = 1.0;
        let seen = camera.seen_by(&depth, &intrinsics);
        assert!(
            seen.depths
                .iter()
                .zip(&depth.depths)
                .all(|(a, b)| (a - b).abs() < 1e-5)
        );
    }
}
