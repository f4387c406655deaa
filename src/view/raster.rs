use std::collections::BTreeSet;

use rayon::prelude::*;

use super::coloring::{LabelColors, point_color};
use super::points::spacing;
use super::{Coloring, ViewCamera};
use crate::frames::Image;
use crate::masks::LabelId;
use crate::scene::LabelledCloud;

/// How [`draw_cloud`] draws.
#[derive(Debug, Clone, PartialEq)]
pub struct RasterStyle {
    /// What point colours show.
    pub coloring: Coloring,
    /// Labels (with all below them) that are not drawn.
    pub hidden: BTreeSet<LabelId>,
    /// Smallest disc radius in pixels, above 0.
    pub point_px: f32,
    /// sRGB.
    pub background: [u8; 3],
    /// Strength of the eye-dome lighting, 0 = off.
    pub edl_strength: f32,
}

impl Default for RasterStyle {
    fn default() -> Self {
        Self {
            coloring: Coloring::Rgb,
            hidden: BTreeSet::new(),
            point_px: 0.8,
            background: [24, 26, 30],
            edl_strength: 0.8,
        }
    }
}

struct Splat {
    x: f32,
    y: f32,
    depth: f32,
    radius: f32,
    color: [u8; 3],
}

/// Draws a cloud on the CPU: round discs with a z-buffer, shaded by eye-dome lighting (Boucheny, Visualisation
/// scientifique de grands volumes de données, 2009). Equal for any number of threads.
#[must_use]
pub fn draw_cloud(cloud: &LabelledCloud, camera: &ViewCamera, style: &RasterStyle) -> Image {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let radius_world = spacing(cloud) * 0.75;
    let labels = LabelColors::new(&cloud.tree, &style.hidden);
    let splats: Vec<Splat> = (0..cloud.len())
        .into_par_iter()
        .filter_map(|index| {
            let color = point_color(cloud, index, style.coloring, &labels)?;
            let (px, depth) = camera.project(cloud.positions[index])?;
            let radius = (radius_world * camera.focal_px / depth).clamp(style.point_px, style.point_px.max(24.0));
            let seen =
                px.x > -radius && px.y > -radius && px.x < width as f32 + radius && px.y < height as f32 + radius;
            seen.then_some(Splat { x: px.x, y: px.y, depth, radius, color })
        })
        .collect();
    let mut pixels = vec![(f32::INFINITY, style.background); width * height];
    let band = 32 * width.max(1);
    let by_band = sort_into_bands(&splats, height.div_ceil(32));
    pixels.par_chunks_mut(band).zip(by_band).enumerate().for_each(|(index, (rows, members))| {
        for member in members {
            draw_disc(rows, width, index * 32, &splats[member as usize]);
        }
    });
    let shaded =
        (0..width * height).into_par_iter().map(|at| edl(&pixels, width, height, at, style.edl_strength)).collect();
    Image { width: camera.width, height: camera.height, pixels: shaded }
}

/// For each band of 32 rows the splats that touch it, in their order.
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

fn draw_disc(rows: &mut [(f32, [u8; 3])], width: usize, top: usize, splat: &Splat) {
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
            if dx * dx + dy * dy <= splat.radius * splat.radius && splat.depth < pixel.0 {
                *pixel = (splat.depth, splat.color);
            }
        }
    }
}

/// Darkens a pixel by how much farther it lies than its neighbours.
fn edl(pixels: &[(f32, [u8; 3])], width: usize, height: usize, at: usize, strength: f32) -> [u8; 3] {
    let (depth, color) = pixels[at];
    if strength <= 0.0 || depth.is_infinite() {
        return color;
    }
    let (x, y) = ((at % width) as isize, (at / width) as isize);
    let mut drop = 0.0;
    for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
        let (nx, ny) = (x + dx * 2, y + dy * 2);
        if nx >= 0 && ny >= 0 && (nx as usize) < width && (ny as usize) < height {
            let near = pixels[ny as usize * width + nx as usize].0;
            if near.is_finite() {
                drop += ((depth / near).ln() * 100.0).max(0.0);
            }
        }
    }
    let light = (-drop * strength / 8.0).exp().clamp(0.25, 1.0);
    color.map(|channel| (f32::from(channel) * light) as u8)
}
