use glam::Vec3;
use rayon::prelude::*;

use super::bitmap::encoded;
use super::light::Light;
use super::model::Model;
use super::raster::{Facet, NOTHING, Raster, band_rows};
use super::view::{RenderedView, View};
use ostra_frames::{DepthMap, Image};
use ostra_masks::{LabelId, LabelMask};

/// Samples along each side of a pixel; odd, so that one lies at its centre.
const SAMPLES: u32 = 3;

/// Pixels of some rows.
struct Band {
    colors: Vec<[u8; 3]>,
    depths: Vec<f32>,
    labels: Vec<LabelId>,
}

/// Draws what a view sees: colour averaged over 3 × 3 samples a pixel, depth and label exact at its centre.
pub(super) fn render(model: &Model, light: &Light, view: &View) -> RenderedView {
    let raster = Raster::new(model, &view.camera, &view.camera_from_world);
    let painter = Painter {
        model,
        light,
        raster: &raster,
        view,
    };
    let bands: Vec<Band> = (0..raster.band_count())
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
    model: &'a Model,
    light: &'a Light,
    raster: &'a Raster<'a>,
    view: &'a View,
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
/// Enough of them where one part fills the pixel.
const CORNERS: [(u32, u32); 4] = [(0, 0), (2, 0), (0, 2), (2, 2)];

impl Painter<'_> {
    fn band(&self, band: usize) -> Band {
        let rows = band_rows(&self.view.camera, band);
        let hits = self.raster.hits(band, SAMPLES);
        let stride = (self.view.camera.width * SAMPLES) as usize;
        let mut out = Band {
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
                    .push(encoded(self.pixel(triangles, (column, rows.start + row))));
                let centre = hit((SAMPLES / 2, SAMPLES / 2));
                let triangle = hits.triangles[centre];
                let seen = triangle != NOTHING;
                out.depths.push(if seen {
                    hits.depths[centre] as f32
                } else {
                    0.0
                });
                out.labels.push(if seen {
                    self.model.look(triangle as usize).label
                } else {
                    LabelId::NONE
                });
            }
        }
        out
    }

    /// Linear RGB of a pixel whose samples show these triangles.
    fn pixel(&self, triangles: [u32; 9], (column, row): (u32, u32)) -> Vec3 {
        let part =
            |triangle: u32| (triangle != NOTHING).then(|| self.model.look_of[triangle as usize]);
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
                sum += self.shade(facet, triangle, (column * SAMPLES + x, row * SAMPLES + y));
            }
        }
        sum / shaded.len() as f32
    }

    /// Linear RGB of a sample.
    fn shade(&self, facet: &Facet, triangle: u32, sample: (u32, u32)) -> Vec3 {
        let model = self.model;
        let shares = facet.shares(self.raster.ray(sample, SAMPLES));
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
        let look = model.look(triangle as usize);
        let (light, highlight) = self.light.on(x, normal, to_viewer, look);
        look.albedo(uv, &model.bitmaps) * light + Vec3::splat(highlight)
    }
}
