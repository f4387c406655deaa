use super::{Projection, ViewCamera};
use ostra_cloud::select::Eye;
use ostra_geometry::{Camera, Pose};

/// Times the depth shown at which the pinhole stands that sees as an orthographic view does.
const FAR: f64 = 1e3;

impl ViewCamera {
    /// The same camera as one that can be written down; an orthographic one as a pinhole from far away.
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
        let camera = Camera::pinhole(self.width, self.height, focal, focal, middle[0], middle[1]);
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

    #[test]
    fn both_see_a_point_in_the_same_place() {
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
