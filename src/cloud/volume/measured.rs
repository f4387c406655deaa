use glam::{DMat3, DVec2, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, Distortion, Pose};

/// What one frame measured, ready to be added to a volume: a picture without lens distortion, pixel for pixel.
pub(super) struct Measured {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) focal: Vec2,
    pub(super) principal: Vec2,
    pub(super) pixels: Vec<Pixel>,
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

/// One pixel's part of the surface.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pixel {
    /// Along the optical axis, world units; 0 = nothing that counts.
    pub(super) depth: f32,
    /// Distance from the surface's tangent plane for one unit of depth before it, 0–1.
    pub(super) slant: f32,
    /// Squared cosine between the ray and the surface's normal, 0–1, and the same in steps of 1/255.
    pub(super) weight: f32,
    pub(super) sight: u8,
    /// Of the surface, in the world, towards the camera.
    pub(super) normal: Facing,
    pub(super) color: [u8; 3],
    /// Whether voxels are wanted here.
    pub(super) wanted: bool,
}

/// A unit vector in steps of 1/127.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Facing([i8; 3]);

impl Facing {
    /// No direction.
    pub(super) const NONE: Self = Self([0; 3]);
    /// Surfaces whose normals' product is up to this are two sides of something thin: a cosine of −0.3.
    pub(super) const SAME_SIDE: i32 = -(127 * 127 * 3 / 10);

    fn new(unit: Vec3) -> Self {
        Self(unit.to_array().map(|along| (along * 127.0) as i8))
    }

    /// Cosine in steps of 1/127².
    pub(super) fn dot(self, other: Self) -> i32 {
        let product = |axis: usize| i32::from(self.0[axis]) * i32::from(other.0[axis]);
        product(0) + product(1) + product(2)
    }
}

/// Surfaces seen flatter than this count as seen at it: a cosine.
const FLATTEST: f32 = 0.1;

/// Pixels on each side over which the slope of a surface is taken: a sensor's noise of one pixel would tilt it at random.
const REACH: usize = 3;

/// What a pixel counts whose neighbours on both sides are another surface: it stands at a rim, where nothing is known of
/// how the surface goes on.
const AT_A_RIM: f32 = 0.1;

impl Measured {
    /// `wanted`: whether voxels are made where a pixel of the frame sees something; `pixels` reuses the
    /// memory of an earlier frame.
    pub(super) fn new(
        (camera, pose): (&Camera, &Pose),
        depth: &DepthMap,
        image: &Image,
        edge_tolerance: f32,
        wanted: impl Fn(usize) -> bool + Sync,
        mut pixels: Vec<Pixel>,
    ) -> Self {
        let straight = straightened(camera);
        let (width, height) = (camera.width as usize, camera.height as usize);
        let (focal, principal) = (straight.focal_px.as_vec2(), straight.principal_px.as_vec2());
        let sources = (straight != *camera).then(|| pixels_seen(&straight, camera));
        let source = |at: usize| sources.as_ref().map_or(Some(at), |sources| sources[at]);
        let inverse: Vec<f32> = (0..width * height)
            .into_par_iter()
            .map(|at| source(at).map_or(0.0, |from| depth.depths[from]))
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
                return Pixel::default();
            };
            let ray = (Vec2::new(x as f32, y as f32) + 0.5 - principal) / focal;
            // On a plane the inverse depth is linear in the ray: n · (x, y, 1) = 1 / depth.
            let across = slope * focal;
            let normal = across.extend(inverse[at] - across.dot(ray));
            let slant = inverse[at] / normal.length();
            let facing = Facing::new(world_from_camera * -normal.normalize_or_zero());
            let weight = (slant / ray.extend(1.0).length())
                .clamp(FLATTEST, 1.0)
                .powi(2)
                * certainty;
            let (depth, slant) = (1.0 / inverse[at], slant.clamp(FLATTEST, 1.0));
            let (sight, color) = ((weight * 255.0) as u8, image.pixels[from]);
            Pixel {
                depth,
                slant,
                weight,
                sight,
                normal: facing,
                color,
                wanted: wanted(from),
            }
        };
        pixels.resize(width * height, Pixel::default());
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

/// The camera without its distortion; the picture keeps its size.
fn straightened(camera: &Camera) -> Camera {
    Camera {
        distortion: Distortion::None,
        ..*camera
    }
}

/// For each pixel of the straight picture the pixel of the real one that sees the same; `None` outside.
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

/// How inverse depths change from pixel to pixel.
struct Slopes<'a> {
    width: usize,
    height: usize,
    /// 0 = unknown.
    inverse: &'a [f32],
    tolerance: f32,
}

impl Slopes<'_> {
    /// The change for a step right and down, along the neighbours on the same surface, and how much it can be trusted, 0–1;
    /// `None` without such neighbours.
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

    /// The change for a step of so many pixels, of which there are as many before and after: between the farthest neighbours
    /// on the same surface.
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
