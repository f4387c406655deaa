use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, Distortion, Pose};

/// The measurements of one frame, ready to be added to a volume.
///
/// The image has no lens distortion and is pixel-aligned with the depths.
pub(super) struct FrameMeasurements {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) focal: Vec2,
    pub(super) principal: Vec2,
    pub(super) pixels: Vec<SurfacePixel>,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

/// The surface seen by one pixel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SurfacePixel {
    /// Depth along the optical axis, in world units; 0 if there is no valid depth.
    pub(super) depth: f32,
    /// Distance from the tangent plane of the surface per unit of depth in front of it, 0–1.
    pub(super) slant: f32,
    /// Squared cosine between the ray and the surface normal, 0–1.
    ///
    /// `sight` is the same in steps of 1/255.
    pub(super) weight: f32,
    pub(super) sight: u8,
    /// Normal of the surface in world space, towards the camera.
    pub(super) normal: Facing,
    pub(super) color: [u8; 3],
    /// Whether voxels are allocated near this pixel.
    pub(super) wanted: bool,
}

/// A unit vector in steps of 1/127.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Facing([i8; 3]);

impl Facing {
    /// No direction.
    pub(super) const NONE: Self = Self([0; 3]);
    /// Maximum dot product of the normals on two sides of a thin object: a cosine of −0.3.
    pub(super) const SAME_SIDE: i32 = -(127 * 127 * 3 / 10);

    fn new(unit: Vec3) -> Self {
        Self(unit.to_array().map(|along| (along * 127.0) as i8))
    }

    /// Returns the cosine in steps of 1/127².
    pub(super) fn dot(self, other: Self) -> i32 {
        let product = |axis: usize| i32::from(self.0[axis]) * i32::from(other.0[axis]);
        product(0) + product(1) + product(2)
    }
}

/// Minimum cosine of the viewing angle; surfaces seen at a flatter angle are clamped to it.
const FLATTEST: f32 = 0.1;

/// Number of pixels on each side for estimating the slope of a surface.
///
/// With a single pixel, sensor noise would tilt the surface at random.
const REACH: usize = 3;

/// Weight factor of a pixel whose neighbours on both sides along one axis are another surface.
///
/// Such a pixel is at a rim, where the continuation of the surface is unknown.
const AT_A_RIM: f32 = 0.1;

/// The decoded parts of a frame, all of one size.
pub(super) struct DepthFrame<'a> {
    pub(super) camera: &'a Camera,
    pub(super) pose: &'a Pose,
    pub(super) depth: &'a DepthMap,
    pub(super) image: &'a Image,
}

impl FrameMeasurements {
    /// Prepares a frame.
    ///
    /// `wanted` returns whether voxels are allocated near a pixel of the frame. `pixels` reuses the
    /// memory of an earlier frame.
    pub(super) fn new(
        frame: &DepthFrame<'_>,
        edge_tolerance: f32,
        wanted: impl Fn(usize) -> bool + Sync,
        mut pixels: Vec<SurfacePixel>,
    ) -> Self {
        let (camera, pose) = (frame.camera, frame.pose);
        let straight = straightened(camera);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (focal, principal) = (straight.focal_px.as_vec2(), straight.principal_px.as_vec2());
        let sources = (straight != *camera).then(|| pixels_seen(&straight, camera));
        let source = |at: usize| sources.as_ref().map_or(Some(at), |sources| sources[at]);
        let inverse: Vec<f32> = (0..width * height)
            .into_par_iter()
            .map(|at| source(at).map_or(0.0, |from| frame.depth.depths[from]))
            .map(|depth| {
                if depth > 0.0 && depth.is_finite() {
                    1.0 / depth
                } else {
                    0.0
                }
            })
            .collect();
        let rotation = DMat3::from_quat(pose.rotation);
        let world_from_camera = rotation.transpose().as_mat3();
        let slopes = Slopes {
            width,
            height,
            inverse: &inverse,
            tolerance: edge_tolerance,
        };
        let pixel = |x: usize, y: usize| {
            let at = y * width + x;
            let (Some(from), Some((slope, certainty))) = (source(at), slopes.at(x, y)) else {
                return SurfacePixel::default();
            };
            let ray = (Vec2::new(x as f32, y as f32) + 0.5 - principal) / focal;
            // On a plane, the inverse depth is linear in the ray: n · (x, y, 1) = 1 / depth.
            let across = slope * focal;
            let normal = across.extend(inverse[at] - across.dot(ray));
            let slant = inverse[at] / normal.length();
            let facing = Facing::new(world_from_camera * -normal.normalize_or_zero());
            let weight = (slant / ray.extend(1.0).length())
                .clamp(FLATTEST, 1.0)
                .powi(2)
                * certainty;
            let (depth, slant) = (1.0 / inverse[at], slant.clamp(FLATTEST, 1.0));
            let (sight, color) = ((weight * 255.0) as u8, frame.image.pixels[from]);
            SurfacePixel {
                depth,
                slant,
                weight,
                sight,
                normal: facing,
                color,
                wanted: wanted(from),
            }
        };
        pixels.resize(width * height, SurfacePixel::default());
        pixels
            .par_chunks_mut(width.max(1))
            .enumerate()
            .for_each(|(y, row)| {
                row.iter_mut()
                    .enumerate()
                    .for_each(|(x, place)| *place = pixel(x, y));
            });
        Self {
            width,
            height,
            focal,
            principal,
            pixels,
            rotation,
            translation: pose.translation,
        }
    }
}

/// Returns the camera without its distortion; the image size stays the same.
fn straightened(camera: &Camera) -> Camera {
    Camera {
        distortion: Distortion::None,
        ..*camera
    }
}

/// Maps the pixels of the undistorted image to those of the original one.
///
/// Pixels outside the original image map to `None`.
fn pixels_seen(straight: &Camera, camera: &Camera) -> Vec<Option<usize>> {
    let seen = |at: usize| {
        let (x, y) = (at % camera.width as usize, at / camera.width as usize);
        let ray = straight.unproject(DVec2::new(x as f64 + 0.5, y as f64 + 0.5));
        let at_px = camera
            .project(ray.extend(1.0))
            .filter(|at_px| camera.contains(*at_px))?;
        Some(at_px.y as usize * camera.width as usize + at_px.x as usize)
    };
    (0..camera.width as usize * camera.height as usize)
        .into_par_iter()
        .map(seen)
        .collect()
}

/// Change of inverse depth from pixel to pixel.
struct Slopes<'a> {
    width: usize,
    height: usize,
    /// Inverse depth per pixel; 0 is unknown.
    inverse: &'a [f32],
    tolerance: f32,
}

impl Slopes<'_> {
    /// Returns the change for a step right and down over neighbours on the same surface.
    ///
    /// Also returns the certainty, 0–1. Returns `None` without such neighbours.
    fn at(&self, x: usize, y: usize) -> Option<(Vec2, f32)> {
        let at = y * self.width + x;
        if self.inverse[at] == 0.0 {
            return None;
        }
        let right = self.along(at, 1, [x, self.width - 1 - x]);
        let down = self.along(at, self.width, [y, self.height - 1 - y]);
        match (right, down) {
            (Some(right), Some(down)) => Some((Vec2::new(right, down), 1.0)),
            (None, None) => None,
            (right, down) => Some((
                Vec2::new(right.unwrap_or(0.0), down.unwrap_or(0.0)),
                AT_A_RIM,
            )),
        }
    }

    /// Returns the change per pixel along one axis.
    ///
    /// It is measured between the farthest neighbours on the same surface.
    ///
    /// `step` is the index offset of one pixel; `before` and `after` count the pixels on each side.
    fn along(&self, at: usize, step: usize, [before, after]: [usize; 2]) -> Option<f32> {
        let here = self.inverse[at];
        let is_same = |other: usize| (self.inverse[other] - here).abs() <= self.tolerance * here;
        let before = (1..=before.min(REACH))
            .take_while(|&steps| is_same(at - steps * step))
            .count();
        let after = (1..=after.min(REACH))
            .take_while(|&steps| is_same(at + steps * step))
            .count();
        let change = self.inverse[at + after * step] - self.inverse[at - before * step];
        (before + after > 0).then(|| change / (before + after) as f32)
    }
}
