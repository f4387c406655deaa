//! The camera of a view, with perspective or orthographic projection.

use glam::{Mat4, Vec2, Vec3, Vec4};

use ostra_cloud::select::Eye;
use ostra_geometry::{Camera, Pose};

/// How depth affects sizes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Projection {
    /// Sizes shrink with distance.
    #[default]
    Perspective,
    /// Sizes are those that perspective has at this depth.
    Orthographic {
        /// World units, above 0.
        depth: f32,
    },
}

/// A camera for drawing: OpenCV axes, centre of the top-left pixel at (0.5, 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewCamera {
    /// Rigid transform from world to camera space.
    pub camera_from_world: Mat4,
    /// Focal length in pixels.
    pub focal_px: f32,
    /// How depth affects sizes.
    pub projection: Projection,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Depth below which points are not drawn, in world units.
    ///
    /// It is negative in orthographic views, which also show points behind the camera.
    pub near: f32,
}

impl ViewCamera {
    /// Depth range of orthographic views in each direction, in multiples of their depth.
    pub(super) const REACH: f32 = 500.0;

    /// Returns pixel position and depth of a world point; `None` if it is nearer than `near`.
    #[must_use]
    pub fn project(&self, x_in_world: Vec3) -> Option<(Vec2, f32)> {
        let x = self.camera_from_world.transform_point3(x_in_world);
        if x.z < self.near {
            return None;
        }
        Some((x.truncate() * self.px_per_unit(x.z) + self.middle_px(), x.z))
    }

    /// Returns the number of pixels per world unit at a depth.
    #[must_use]
    pub fn px_per_unit(&self, depth: f32) -> f32 {
        match self.projection {
            Projection::Perspective => self.focal_px / depth,
            Projection::Orthographic { depth } => self.focal_px / depth,
        }
    }

    /// Returns how much farther `depth` is than `nearer`, as a share of the distance.
    ///
    /// The share is negative if `depth` is nearer.
    pub(super) fn farther_by(&self, depth: f32, nearer: f32) -> f32 {
        match self.projection {
            Projection::Perspective => (depth / nearer).ln(),
            Projection::Orthographic { depth: unit } => (depth - nearer) / unit,
        }
    }

    /// Returns the camera position in world space; an orthographic camera is far away.
    #[must_use]
    pub fn place(&self) -> Vec3 {
        let back = match self.projection {
            Projection::Perspective => 0.0,
            Projection::Orthographic { depth } => 1e4 * depth,
        };
        self.camera_from_world
            .inverse()
            .transform_point3(Vec3::NEG_Z * back)
    }

    /// Returns the world point at a pixel position and depth.
    #[must_use]
    pub fn unproject(&self, at_px: Vec2, depth: f32) -> Vec3 {
        let x = ((at_px - self.middle_px()) / self.px_per_unit(depth)).extend(depth);
        self.camera_from_world.inverse().transform_point3(x)
    }

    /// Returns `clip_from_world` for wgpu, with reversed depth.
    ///
    /// In perspective, `near` maps to 1 and infinity to 0, so that far scenes keep their precision.
    /// In orthographic views, depth runs from 1 to 0 over 500 times the target's depth in each
    /// direction.
    #[must_use]
    pub fn clip_from_world(&self) -> Mat4 {
        let (w, h) = (self.width.max(1) as f32, self.height.max(1) as f32);
        let (depth_row, w_row) = match self.projection {
            Projection::Perspective => (Vec2::new(0.0, self.near), Vec2::new(1.0, 0.0)),
            Projection::Orthographic { depth } => {
                let range = 2.0 * Self::REACH * depth;
                (
                    Vec2::new(-1.0, self.near + range) / range,
                    Vec2::new(0.0, 1.0),
                )
            }
        };
        let scale = self.px_per_unit(1.0);
        let clip_from_camera = Mat4::from_cols(
            Vec4::new(2.0 * scale / w, 0.0, 0.0, 0.0),
            Vec4::new(0.0, -2.0 * scale / h, 0.0, 0.0),
            Vec4::new(0.0, 0.0, depth_row.x, w_row.x),
            Vec4::new(0.0, 0.0, depth_row.y, w_row.y),
        );
        clip_from_camera * self.camera_from_world
    }

    fn middle_px(&self) -> Vec2 {
        Vec2::new(self.width as f32, self.height as f32) / 2.0
    }
}

/// Distance of the pinhole that replaces an orthographic camera, in multiples of its depth.
const FAR: f64 = 1e3;

impl ViewCamera {
    /// Returns the camera in a form that can be saved.
    ///
    /// An orthographic camera becomes a pinhole that is far away.
    #[must_use]
    pub fn eye(&self) -> Eye {
        let (mut focal, middle) = (
            f64::from(self.focal_px),
            [self.width, self.height].map(|side| f64::from(side) / 2.0),
        );
        let (_, rotation, mut translation) = self
            .camera_from_world
            .as_dmat4()
            .to_scale_rotation_translation();
        if let Projection::Orthographic { depth } = self.projection {
            focal *= FAR;
            translation.z += (FAR - 1.0) * f64::from(depth);
        }
        let camera = Camera::pinhole(self.width, self.height, [focal, focal], middle);
        Eye::Free {
            camera,
            camera_from_world: Pose {
                rotation,
                translation,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec2, Vec3};

    use super::*;
    use crate::{Bounds, Orbit};

    fn cameras() -> [ViewCamera; 2] {
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(1.0),
        };
        let orbit = Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y);
        [false, true].map(|orthographic| {
            Orbit {
                orthographic,
                ..orbit
            }
            .camera(640, 480)
        })
    }

    #[test]
    fn project_inverts_unproject() {
        for camera in cameras() {
            let x = camera.unproject(Vec2::new(100.0, 300.0), 2.0);
            let (px, depth) = camera.project(x).unwrap();
            assert!((px - Vec2::new(100.0, 300.0)).length() < 1e-2 && (depth - 2.0).abs() < 1e-4);
        }
    }

    #[test]
    fn clip_agrees_with_project() {
        for camera in cameras() {
            let x = Vec3::new(0.4, 0.3, -0.6);
            let (px, _) = camera.project(x).unwrap();
            let clip = camera.clip_from_world() * x.extend(1.0);
            let ndc = clip.truncate() / clip.w;
            let from_clip = Vec2::new((ndc.x + 1.0) * 320.0, (1.0 - ndc.y) * 240.0);
            assert!((px - from_clip).length() < 1e-2);
            assert!(ndc.z > 0.0 && ndc.z < 1.0);
        }
    }

    #[test]
    fn only_perspective_shrinks_with_depth_and_both_agree_at_the_target() {
        let [perspective, orthographic] = cameras();
        let size = |camera: &ViewCamera, depth: f32| {
            let [a, b] = [300.0, 340.0].map(|x| perspective.unproject(Vec2::new(x, 240.0), depth));
            camera
                .project(a)
                .unwrap()
                .0
                .distance(camera.project(b).unwrap().0)
        };
        let Projection::Orthographic { depth } = orthographic.projection else {
            panic!()
        };
        assert!((size(&perspective, depth) - size(&orthographic, depth)).abs() < 0.01);
        assert!((size(&orthographic, 2.0 * depth) / size(&orthographic, depth) - 2.0).abs() < 0.01);
        let behind = perspective.place() - perspective.unproject(Vec2::new(320.0, 240.0), depth);
        assert!(
            orthographic.project(perspective.place() + behind).is_some(),
            "nothing is too near"
        );
    }

    #[test]
    fn saved_camera_projects_points_to_the_same_pixel() {
        let bounds = Bounds {
            min: Vec3::splat(-1.0),
            max: Vec3::splat(1.0),
        };
        let view = Orbit::framing(&bounds, Vec3::new(0.3, 0.2, 1.0), Vec3::NEG_Y).camera(640, 480);
        let Eye::Free {
            camera,
            camera_from_world,
        } = view.eye()
        else {
            panic!("a camera of its own")
        };
        let x = Vec3::new(0.4, -0.3, 0.2);
        let at_px: DVec2 = camera
            .project(camera_from_world.transform(x.as_dvec3()))
            .unwrap();
        assert!(at_px.as_vec2().distance(view.project(x).unwrap().0) < 1e-2);
        let flat = ViewCamera {
            projection: Projection::Orthographic { depth: 3.0 },
            ..view
        };
        let Eye::Free {
            camera,
            camera_from_world,
        } = flat.eye()
        else {
            panic!("a camera of its own")
        };
        let at_px: DVec2 = camera
            .project(camera_from_world.transform(x.as_dvec3()))
            .unwrap();
        assert!(
            at_px.as_vec2().distance(flat.project(x).unwrap().0) < 0.5,
            "a pinhole from far away"
        );
    }
}
