use std::sync::Arc;

use glam::{Mat3, Vec2, Vec3};

use ostra_frames::DepthMap;
use ostra_geometry::{Camera, Distortion, Pose};

/// Where a frame was taken from, and through what.
#[derive(Debug, Clone, Copy)]
pub struct Stand {
    pub camera: Camera,
    pub camera_from_world: Pose,
}

/// A frame's camera and depth, with the ray of every pixel.
#[derive(Debug, Clone)]
pub struct Viewpoint {
    pub stand: Stand,
    pub depth: Arc<DepthMap>,
    /// The point on the plane z = 1 that each pixel sees, row by row.
    pub rays: Arc<Vec<Vec2>>,
}

impl Viewpoint {
    pub fn width(&self) -> usize {
        self.stand.camera.width as usize
    }

    pub fn height(&self) -> usize {
        self.stand.camera.height as usize
    }

    /// The point seen at a pixel, in camera space; `None` where depth or ray is unknown.
    pub fn point(&self, at: usize) -> Option<Vec3> {
        let depth = self.depth.depths[at];
        let point = (self.rays[at] * depth).extend(depth);
        (depth > 0.0 && point.is_finite()).then_some(point)
    }

    /// From camera space to world space.
    pub fn to_world(&self) -> impl Fn(Vec3) -> Vec3 + Sync {
        let pose = self.stand.camera_from_world.inverse();
        let (rotation, translation) = (
            Mat3::from_quat(pose.rotation.as_quat()),
            pose.translation.as_vec3(),
        );
        move |point| rotation * point + translation
    }

    /// The median of the known depths of a thinned grid; `None` without depth.
    pub fn median_depth(&self) -> Option<f32> {
        let mut known: Vec<f32> = self
            .depth
            .depths
            .iter()
            .step_by(61)
            .copied()
            .filter(|&d| d > 0.0)
            .collect();
        known.sort_by(f32::total_cmp);
        known.get(known.len() / 2).copied()
    }

    /// Points of a thinned grid of about `side`² pixels, in camera space.
    pub fn grid(&self, side: usize) -> Vec<Vec3> {
        let (width, height) = (self.width(), self.height());
        let columns = (width / (2 * side)..width).step_by((width / side).max(1));
        let rows = (height / (2 * side)..height).step_by((height / side).max(1));
        rows.flat_map(|y| columns.clone().map(move |x| y * width + x))
            .filter_map(|at| self.point(at))
            .collect()
    }
}

/// From one camera's space to another camera's pixels.
#[derive(Debug, Clone)]
pub struct Passage {
    rotation: Mat3,
    translation: Vec3,
    lens: Lens,
    size: Vec2,
}

#[derive(Debug, Clone)]
enum Lens {
    Pinhole { focal: Vec2, principal: Vec2 },
    Distorted(Camera),
}

impl Passage {
    pub fn new(from: &Stand, to: &Stand) -> Self {
        let pose = to
            .camera_from_world
            .compose(&from.camera_from_world.inverse());
        let camera = to.camera;
        let lens = match camera.distortion {
            Distortion::None => Lens::Pinhole {
                focal: camera.focal_px.as_vec2(),
                principal: camera.principal_px.as_vec2(),
            },
            _ => Lens::Distorted(camera),
        };
        Self {
            rotation: Mat3::from_quat(pose.rotation.as_quat()),
            translation: pose.translation.as_vec3(),
            lens,
            size: Vec2::new(camera.width as f32, camera.height as f32),
        }
    }

    /// The point in the other camera's space.
    pub fn transform(&self, point: Vec3) -> Vec3 {
        self.rotation * point + self.translation
    }

    /// A direction in the other camera's space.
    pub fn turn(&self, direction: Vec3) -> Vec3 {
        self.rotation * direction
    }

    /// Where a point of the other camera's space is seen, also beside the picture; `None` behind the camera.
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        if point.z <= 0.0 {
            return None;
        }
        match &self.lens {
            Lens::Pinhole { focal, principal } => {
                Some(point.truncate() / point.z * *focal + *principal)
            }
            Lens::Distorted(camera) => camera.project(point.as_dvec3()).map(glam::DVec2::as_vec2),
        }
    }

    /// [`Self::project`] within the picture only.
    pub fn pixel(&self, point: Vec3) -> Option<Vec2> {
        let at = self.project(point)?;
        (at.x >= 0.0 && at.y >= 0.0 && at.x < self.size.x && at.y < self.size.y).then_some(at)
    }
}
