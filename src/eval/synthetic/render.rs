use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::material::encoded;
use super::model::{PartAppearance, SceneMesh};
use super::raster::{Facet, NOTHING, Raster, band_rows};
use super::view::{RenderedView, SyntheticView, look_at};
use ostra_frames::{DepthMap, Image};
use ostra_geometry::{Camera, Pose};
use ostra_masks::{LabelId, LabelMask};

/// Number of samples along each side of a pixel; odd, so that one is at its centre.
const SAMPLES: u32 = 3;

/// Pixels of some rows.
struct RowBand {
    colors: Vec<[u8; 3]>,
    depths: Vec<f32>,
    labels: Vec<LabelId>,
}

/// Renders a view.
///
/// Colour is the average of 3 × 3 samples per pixel. Depth and label are exact at the pixel centre.
pub(super) fn render(model: &SceneMesh, light: &Light, view: &SyntheticView) -> RenderedView {
    let raster = Raster::new(model, &view.camera, &view.camera_from_world);
    let painter = Painter {
        model,
        light,
        raster: &raster,
        view,
    };
    let bands: Vec<RowBand> = (0..raster.band_count())
        .into_par_iter()
        .map(|band| painter.band(band))
        .collect();
    let (width, height) = (view.camera.width, view.camera.height);
    let (mut colors, mut depths, mut labels) = (Vec::new(), Vec::new(), Vec::new());
    for band in bands {
        colors.extend(band.colors);
        depths.extend(band.depths);
        labels.extend(band.labels);
    }
    RenderedView {
        image: Image {
            width,
            height,
            pixels: colors,
        },
        depth: DepthMap {
            width,
            height,
            depths,
        },
        mask: LabelMask {
            width,
            height,
            ids: labels,
        },
        camera: view.frame_camera(),
    }
}

struct Painter<'a> {
    model: &'a SceneMesh,
    light: &'a Light,
    raster: &'a Raster<'a>,
    view: &'a SyntheticView,
}

/// The samples of a pixel (column, row).
const ALL: [(u32, u32); 9] = [
    (0, 0),
    (1, 0),
    (2, 0),
    (0, 1),
    (1, 1),
    (2, 1),
    (0, 2),
    (1, 2),
    (2, 2),
];
/// The samples that are shaded where one part fills the pixel.
const CORNERS: [(u32, u32); 4] = [(0, 0), (2, 0), (0, 2), (2, 2)];

impl Painter<'_> {
    fn band(&self, band: usize) -> RowBand {
        let rows = band_rows(&self.view.camera, band);
        let hits = self.raster.hits(band, SAMPLES);
        let stride = (self.view.camera.width * SAMPLES) as usize;
        let mut out = RowBand {
            colors: Vec::new(),
            depths: Vec::new(),
            labels: Vec::new(),
        };
        for row in 0..rows.len() as u32 {
            for column in 0..self.view.camera.width {
                let hit = |(x, y): (u32, u32)| {
                    (row * SAMPLES + y) as usize * stride + (column * SAMPLES + x) as usize
                };
                let triangles = ALL.map(|sample| hits.triangles[hit(sample)]);
                out.colors
                    .push(encoded(self.pixel(triangles, column, rows.start + row)));
                let centre = hit((SAMPLES / 2, SAMPLES / 2));
                let triangle = hits.triangles[centre];
                let seen = triangle != NOTHING;
                out.depths.push(if seen {
                    hits.depths[centre] as f32
                } else {
                    0.0
                });
                out.labels.push(if seen {
                    self.model.appearance(triangle as usize).label
                } else {
                    LabelId::NONE
                });
            }
        }
        out
    }

    /// Returns the linear RGB of a pixel whose samples hit these triangles.
    fn pixel(&self, triangles: [u32; 9], column: u32, row: u32) -> Vec3 {
        let part = |triangle: u32| {
            (triangle != NOTHING).then(|| self.model.appearance_of[triangle as usize])
        };
        let uniform = triangles
            .iter()
            .all(|&triangle| part(triangle) == part(triangles[0]));
        let shaded: &[(u32, u32)] = if uniform { &CORNERS } else { &ALL };
        let mut last: (u32, Option<Facet>) = (NOTHING, None);
        let mut sum = Vec3::ZERO;
        for &(x, y) in shaded {
            let triangle = triangles[(y * SAMPLES + x) as usize];
            if triangle != last.0 {
                last = (triangle, self.raster.facet(triangle));
            }
            if let Some(facet) = &last.1 {
                sum += self.shade(facet, triangle, column * SAMPLES + x, row * SAMPLES + y);
            }
        }
        sum / shaded.len() as f32
    }

    /// Returns the linear RGB of the sample at this column and row.
    fn shade(&self, facet: &Facet, triangle: u32, column: u32, row: u32) -> Vec3 {
        let model = self.model;
        let shares = facet.shares(self.raster.ray(column, row, SAMPLES));
        let corners = model.triangles[triangle as usize].map(|v| v as usize);
        let (mut x, mut normal, mut uv) = (glam::DVec3::ZERO, Vec3::ZERO, glam::Vec2::ZERO);
        for (corner, share) in corners.into_iter().zip(shares) {
            x += share * model.positions[corner];
            normal += share as f32 * model.normals[corner];
            uv += share as f32 * model.uv[corner];
        }
        let to_viewer = (self.raster.world_from_camera.translation - x)
            .as_vec3()
            .normalize_or(Vec3::Z);
        let normal = normal.normalize_or(to_viewer);
        let normal = if normal.dot(to_viewer) < 0.0 {
            -normal
        } else {
            normal
        };
        let appearance = model.appearance(triangle as usize);
        let (light, highlight) = self.light.on(x, normal, to_viewer, appearance);
        appearance.albedo(uv, &model.bitmaps) * light + Vec3::splat(highlight)
    }
}

/// A lamp to the upper left in front of the specimen, with shadows, and ambient light.
#[derive(Debug, Clone)]
pub(super) struct Light {
    centre: DVec3,
    camera: Camera,
    light_from_world: Pose,
    /// Distance of the nearest surface from the lamp, row by row, in metres.
    depths: Vec<f32>,
}

/// Exposure that renders the brightest posters just below white.
const EXPOSURE: f32 = 1.35;
/// Side length of the shadow map in texels.
const SIDE: u32 = 1400;
/// Distance behind the nearest surface up to which a surface is lit, in metres.
const BIAS_M: f64 = 0.0025;

impl Light {
    pub(super) fn new(model: &SceneMesh, target: DVec3) -> Self {
        let centre = DVec3::new(-0.75, -1.35, 1.55);
        let focal = f64::from(SIDE) * (target - centre).length() / 0.75;
        let half = 0.5 * f64::from(SIDE);
        let camera = Camera::pinhole(SIDE, SIDE, [focal, focal], [half, half]);
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

    /// Returns the light on a surface point and the highlight towards the viewer.
    ///
    /// The light is a factor on the reflectance. `normal` is a unit vector towards the viewer.
    pub(super) fn on(
        &self,
        x: DVec3,
        normal: Vec3,
        to_viewer: Vec3,
        appearance: &PartAppearance,
    ) -> (f32, f32) {
        let to_light = (self.centre - x).as_vec3().normalize();
        let facing = normal.dot(to_light);
        let direct = if facing > 0.0 {
            facing
        } else {
            -facing * appearance.material.translucency()
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
            appearance.material.gloss() * highlight,
        )
    }

    /// Returns 0 in shadow to 1 if lit, smoothed over 2 × 2 texels.
    ///
    /// Points outside the shadow map are lit.
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
