use glam::{DMat3, DQuat, DVec2, DVec3};

use super::layout::{Layout, Observation};
use super::lens::{INTRINSICS, Lens, ProjectedPoint};
use super::problem::{Bundle, BundleOptions, Loss, Refine};
use crate::blocks::{BLOCK, Column6};
use crate::{Camera, Pose};

/// Cameras and poses during the adjustment; the points are stored in the pieces.
#[derive(Debug, Clone)]
pub(super) struct CameraState {
    pub cameras: Vec<Camera>,
    pub poses: Vec<Pose>,
    lenses: Vec<Lens>,
    views: Vec<PreparedPose>,
    loss: Loss,
}

/// One image's pose, prepared for many points.
#[derive(Debug, Clone, Copy)]
struct PreparedPose {
    rotation: DMat3,
    translation: DVec3,
    camera: usize,
}

/// An observation at a state, with the inputs of its derivatives.
pub(super) struct Observed<'a> {
    /// `predicted − observed` in pixels, weighted.
    pub residual: DVec2,
    /// Point in camera space.
    pub x: DVec3,
    /// Derivatives of the weighted residual's x and y by the point in camera space.
    pub by_x: [DVec3; 2],
    /// Derivatives of the weighted residual's x and y by the point in world space.
    pub by_point: [DVec3; 2],
    /// Square root of the weight.
    weight: f64,
    seen: ProjectedPoint,
    lens: &'a Lens,
}

impl Observed<'_> {
    /// Derivatives of the weighted residual's x and y by the image's pose.
    ///
    /// The pose is parametrised as a rotation about the camera centre and a translation in camera
    /// space.
    #[inline(always)]
    pub fn by_pose(&self) -> [Column6; 2] {
        self.by_x.map(|d| {
            let turn = self.x.cross(d);
            [turn.x, turn.y, turn.z, d.x, d.y, d.z]
        })
    }

    /// Derivatives of the weighted residual's x and y by the refined intrinsics.
    ///
    /// They are blocks padded with zeros.
    #[inline(always)]
    pub fn by_intrinsics(&self) -> [[Column6; 2]; INTRINSICS / BLOCK] {
        let mut by = [DVec2::ZERO; INTRINSICS];
        self.lens.by_intrinsics(&self.seen, &mut by);
        std::array::from_fn(|block| {
            let of = |i: usize| self.weight * by[block * BLOCK + i];
            [
                std::array::from_fn(|i| of(i).x),
                std::array::from_fn(|i| of(i).y),
            ]
        })
    }
}

impl CameraState {
    pub fn new(bundle: &Bundle, options: &BundleOptions) -> Self {
        let refine = |camera: usize| {
            options
                .refine
                .get(camera)
                .copied()
                .unwrap_or(Refine::NOTHING)
        };
        let lenses = bundle
            .cameras
            .iter()
            .enumerate()
            .map(|(i, camera)| Lens::new(camera, refine(i)))
            .collect();
        let poses: Vec<Pose> = bundle
            .images
            .iter()
            .map(|image| image.camera_from_world)
            .collect();
        let views = bundle
            .images
            .iter()
            .zip(&poses)
            .map(|(image, pose)| view(pose, image.camera as usize))
            .collect();
        Self {
            cameras: bundle.cameras.clone(),
            poses,
            lenses,
            views,
            loss: options.loss,
        }
    }

    /// Returns the number of refined intrinsics of a camera.
    pub fn intrinsics(&self, camera: usize) -> usize {
        self.lenses[camera].intrinsics()
    }

    /// Returns the camera of an image.
    pub fn camera_of(&self, image: u32) -> usize {
        self.views[image as usize].camera
    }

    /// Returns the state after a step of all blocks.
    pub fn moved(&self, layout: &Layout, step: &[Column6]) -> Self {
        let mut moved = self.clone();
        for (image, block) in layout.poses.iter().enumerate() {
            let Some(block) = *block else { continue };
            moved.poses[image] = moved_pose(&self.poses[image], &step[block]);
            moved.views[image] = view(&moved.poses[image], self.views[image].camera);
        }
        for (camera, blocks) in layout.intrinsics.iter().enumerate() {
            if !blocks.is_empty() {
                let lens = &self.lenses[camera];
                moved.cameras[camera] =
                    lens.moved(&self.cameras[camera], step[blocks.clone()].as_flattened());
                moved.lenses[camera] = lens.of(&moved.cameras[camera]);
            }
        }
        moved
    }

    /// Returns whether a point is visible in the image at all.
    pub fn sees(&self, point: DVec3, image: u32) -> bool {
        let view = &self.views[image as usize];
        self.lenses[view.camera]
            .project(view.rotation * point + view.translation)
            .is_some()
    }

    /// Returns the loss of one observation in px².
    ///
    /// An observation behind its camera costs as much as an error of the image's diagonal, so that
    /// no step gains by moving it there.
    #[inline(always)]
    pub fn cost(&self, point: DVec3, observation: &Observation) -> f64 {
        let view = &self.views[observation.image as usize];
        let at_px = self.lenses[view.camera].project(view.rotation * point + view.translation);
        let squared = at_px.map_or_else(
            || {
                let camera = &self.cameras[view.camera];
                DVec2::new(f64::from(camera.width), f64::from(camera.height)).length_squared()
            },
            |at_px| at_px.distance_squared(observation.at_px),
        );
        self.loss.cost(squared)
    }

    /// Returns one observation with its derivatives; `None` if the point is not visible.
    #[inline(always)]
    pub fn observe(&self, point: DVec3, observation: &Observation) -> Option<Observed<'_>> {
        let view = &self.views[observation.image as usize];
        let lens = &self.lenses[view.camera];
        let x = view.rotation * point + view.translation;
        let seen = lens.see(x)?;
        let residual = seen.at_px - observation.at_px;
        let weight = self.loss.weight(residual.length_squared()).sqrt();
        let by_x = seen.by_point.map(|d| weight * d);
        let by_point = by_x.map(|d| {
            DVec3::new(
                view.rotation.x_axis.dot(d),
                view.rotation.y_axis.dot(d),
                view.rotation.z_axis.dot(d),
            )
        });
        Some(Observed {
            residual: weight * residual,
            x,
            by_x,
            by_point,
            weight,
            seen,
            lens,
        })
    }
}

fn view(pose: &Pose, camera: usize) -> PreparedPose {
    PreparedPose {
        rotation: DMat3::from_quat(pose.rotation),
        translation: pose.translation,
        camera,
    }
}

fn moved_pose(pose: &Pose, step: &Column6) -> Pose {
    let [a, b, c, x, y, z] = *step;
    let turn = Pose {
        rotation: DQuat::from_scaled_axis(DVec3::new(a, b, c)),
        translation: DVec3::new(x, y, z),
    };
    turn.compose(pose)
}
