use rayon::prelude::*;

use super::paint::Paint;
use super::point_lod::{Disc, PointLod};
use super::{SceneStyle, Shot, ViewCamera};
use ostra_cloud::LabelledCloud;

/// Depth and colour of a pixel; opacity 0 means that nothing is drawn there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pixel {
    pub depth: f32,
    pub color: [u8; 4],
}

struct Splat {
    x: f32,
    y: f32,
    depth: f32,
    radius: f32,
    color: [u8; 4],
}

impl Pixel {
    pub(super) fn background([r, g, b]: [u8; 3]) -> Self {
        Self {
            depth: f32::INFINITY,
            color: [r, g, b, 0],
        }
    }
}

/// Returns whether something of this opacity (0–255) is drawn at a pixel.
///
/// An ordered dither (Bayer 1973) makes the result independent of the drawing order; blending would
/// have to draw points from back to front. GPU twin: `is_shown` in the shaders.
pub(super) fn is_shown(opacity: u8, x: usize, y: usize) -> bool {
    const THRESHOLDS: [[u32; 4]; 4] =
        [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
    u32::from(opacity) * 32 > (2 * THRESHOLDS[y % 4][x % 4] + 1) * 255
}

/// Draws a cloud on the CPU as round discs with a z-buffer and eye-dome lighting.
///
/// Source of the lighting: Boucheny, Visualisation scientifique de grands volumes de données, 2009.
/// The result is the same for any number of threads.
#[must_use]
pub fn draw_cloud(cloud: &LabelledCloud, camera: &ViewCamera, style: &SceneStyle) -> Shot {
    draw_arranged(cloud, &PointLod::of(&cloud.positions), camera, style)
}

/// Draws a cloud whose points are already arranged.
pub(super) fn draw_arranged(
    cloud: &LabelledCloud,
    point_lod: &PointLod,
    camera: &ViewCamera,
    style: &SceneStyle,
) -> Shot {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let splats = splats(cloud, point_lod, camera, style);
    let mut pixels = vec![Pixel::background(style.background); width * height];
    let band = 32 * width.max(1);
    let by_band = sort_into_bands(&splats, height.div_ceil(32));
    pixels
        .par_chunks_mut(band)
        .zip(by_band)
        .enumerate()
        .for_each(|(index, (rows, members))| {
            for member in members {
                draw_disc(rows, width, index * 32, &splats[member as usize]);
            }
        });
    let lit = |at: usize| edl(&pixels, camera, at, style.edl_strength);
    Shot::of_pixels(
        camera.width,
        camera.height,
        (0..width * height).into_par_iter().map(lit),
    )
}

fn splats(
    cloud: &LabelledCloud,
    point_lod: &PointLod,
    camera: &ViewCamera,
    style: &SceneStyle,
) -> Vec<Splat> {
    let (width, height) = (camera.width as f32, camera.height as f32);
    let paint = Paint::new(cloud, &style.appearance);
    let splat = |disc: Disc| {
        let position = cloud.positions[disc.index];
        let color = paint
            .color(cloud, disc.index)
            .map(|color| disc.shade(color))
            .filter(|_| style.clip.contains(position))?;
        let (px, depth) = camera.project(position)?;
        let radius =
            (disc.radius * camera.px_per_unit(depth)).clamp(style.point_px, style.most_px());
        let seen =
            px.x > -radius && px.y > -radius && px.x < width + radius && px.y < height + radius;
        seen.then_some(Splat {
            x: px.x,
            y: px.y,
            depth,
            radius,
            color,
        })
    };
    point_lod.discs().filter_map(splat).collect()
}

/// Returns, for each band of 32 rows, the splats that touch it, in their order.
fn sort_into_bands(splats: &[Splat], bands: usize) -> Vec<Vec<u32>> {
    let mut by_band = vec![Vec::new(); bands];
    for (index, splat) in splats.iter().enumerate() {
        let first = ((splat.y - splat.radius).max(0.0) / 32.0) as usize;
        let last = ((splat.y + splat.radius).max(0.0) / 32.0) as usize;
        for members in by_band.iter_mut().take(last + 1).skip(first) {
            members.push(index as u32);
        }
    }
    by_band
}

fn draw_disc(rows: &mut [Pixel], width: usize, top: usize, splat: &Splat) {
    let height = rows.len() / width;
    let span = |centre: f32, limit: usize, offset: f32| {
        let from = (centre - splat.radius - offset - 0.5).ceil().max(0.0) as usize;
        let to = ((centre + splat.radius - offset - 0.5).floor() + 1.0).max(0.0) as usize;
        from..to.min(limit)
    };
    for y in span(splat.y, height, top as f32) {
        for x in span(splat.x, width, 0.0) {
            let (dx, dy) = (x as f32 + 0.5 - splat.x, (y + top) as f32 + 0.5 - splat.y);
            let pixel = &mut rows[y * width + x];
            let is_inside = dx * dx + dy * dy <= splat.radius * splat.radius;
            if is_inside && splat.depth < pixel.depth && is_shown(splat.color[3], x, y + top) {
                *pixel = Pixel {
                    depth: splat.depth,
                    color: splat.color,
                };
            }
        }
    }
}

/// Darkens a pixel by how much farther it is than its neighbours.
///
/// Fainter neighbours cast no shade. Pixels with opacity 0 are background and lines, which are not
/// shaded. GPU twin: edl.wgsl.
fn edl(pixels: &[Pixel], camera: &ViewCamera, at: usize, strength: f32) -> [u8; 4] {
    let (width, height) = (camera.width as isize, camera.height as isize);
    let Pixel {
        depth,
        color: [r, g, b, opacity],
    } = pixels[at];
    if strength <= 0.0 || opacity == 0 {
        return [r, g, b, opacity];
    }
    let (x, y) = (at as isize % width, at as isize / width);
    let mut drop = 0.0;
    for (dx, dy) in [
        (-1, 0),
        (1, 0),
        (0, -1),
        (0, 1),
        (-1, -1),
        (1, -1),
        (-1, 1),
        (1, 1),
    ] {
        let (nx, ny) = (x + dx * 2, y + dy * 2);
        if nx >= 0 && ny >= 0 && nx < width && ny < height {
            let neighbour = pixels[(ny * width + nx) as usize];
            if neighbour.color[3] >= opacity {
                drop += (camera.farther_by(depth, neighbour.depth) * 100.0).max(0.0);
            }
        }
    }
    let light = (-drop * strength / 8.0).exp().clamp(0.25, 1.0);
    let [r, g, b] = [r, g, b].map(|channel| (f32::from(channel) * light).round() as u8);
    [r, g, b, opacity]
}
