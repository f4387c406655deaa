use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::model::{Look, Model};
use super::raster::{NOTHING, Raster};
use super::view::look_at;
use ostra_geometry::{Camera, Pose};

/// A lamp in front of the specimen to the upper left, with the shadows that it casts, and light from all sides.
#[derive(Debug, Clone)]
pub(super) struct Light {
    centre: DVec3,
    camera: Camera,
    light_from_world: Pose,
    /// Distance of the nearest surface from the lamp, row by row, metres.
    depths: Vec<f32>,
}

/// Brings the brightest posters just below white.
const EXPOSURE: f32 = 1.35;
/// Side of the shadow map in texels.
const SIDE: u32 = 1400;
/// A surface this far behind the nearest is still lit, metres.
const BIAS_M: f64 = 0.0025;

impl Light {
    pub(super) fn new(model: &Model, target: DVec3) -> Self {
        let centre = DVec3::new(-0.75, -1.35, 1.55);
        let focal = f64::from(SIDE) * (target - centre).length() / 0.75;
        let half = 0.5 * f64::from(SIDE);
        let camera = Camera::pinhole(SIDE, SIDE, focal, focal, half, half);
        let light_from_world = look_at(centre, target);
        let raster = Raster::new(model, &camera, &light_from_world);
        let bands: Vec<Vec<f32>> = (0..raster.band_count())
            .into_par_iter()
            .map(|band| {
                let hits = raster.hits(band, 1);
                let depth = |(&t, &z): (&u32, &f64)| if t == NOTHING { f32::MAX } else { z as f32 };
                hits.triangles.iter().zip(&hits.depths).map(depth).collect()
            })
            .collect();
        Self {
            centre,
            camera,
            light_from_world,
            depths: bands.concat(),
        }
    }

    /// Light on a surface point with unit normal `normal` (towards the viewer), as a factor on its reflectance, and
    /// the highlight towards the viewer.
    pub(super) fn on(&self, x: DVec3, normal: Vec3, to_viewer: Vec3, look: &Look) -> (f32, f32) {
        let to_light = (self.centre - x).as_vec3().normalize();
        let facing = normal.dot(to_light);
        let direct = if facing > 0.0 {
            facing
        } else {
            -facing * look.material.translucency()
        };
        let lit = if direct > 0.0 {
            self.lit_share(x + 0.0006 * f64::from(facing.signum()) * normal.as_dvec3())
        } else {
            0.0
        };
        let around = 0.36 + 0.12 * normal.z + 0.06 * normal.y.abs();
        let half_way = (to_light + to_viewer).normalize_or(normal);
        let highlight = if facing > 0.0 {
            lit * normal.dot(half_way).max(0.0).powi(24)
        } else {
            0.0
        };
        (
            EXPOSURE * (around + 0.62 * direct * lit),
            look.material.gloss() * highlight,
        )
    }

    /// 0 = in shadow … 1 = lit, smoothed over 2 × 2 texels; 1 outside the lamp's shadow map.
    fn lit_share(&self, x: DVec3) -> f32 {
        let x_in_light = self.light_from_world.transform(x);
        let Some(px) = self.camera.project(x_in_light).map(|px| px - 0.5) else {
            return 1.0;
        };
        let limit = f64::from(SIDE) - 2.0;
        if px.min_element() < 0.0 || px.max_element() >= limit {
            return 1.0;
        }
        let (column, row) = (px.x as usize, px.y as usize);
        let open = |dx: usize, dy: usize| {
            let nearest = f64::from(self.depths[(row + dy) * SIDE as usize + column + dx]);
            f32::from(u8::from(x_in_light.z < nearest + BIAS_M))
        };
        let f = px.fract().as_vec2();
        let top = open(0, 0) + (open(1, 0) - open(0, 0)) * f.x;
        let bottom = open(0, 1) + (open(1, 1) - open(0, 1)) * f.x;
        top + (bottom - top) * f.y
    }
}
