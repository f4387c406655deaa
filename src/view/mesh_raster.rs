use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::coloring::{LabelColors, point_color};
use super::{RasterStyle, ViewCamera};
use crate::frames::Image;
use crate::scene::LabelledMesh;

/// Rows that one task fills.
const BAND: usize = 32;
/// Light on a surface that is seen along itself; one seen from straight above has 1.
pub(super) const AMBIENT: f32 = 0.35;

/// A vertex as the camera sees it.
struct Corner {
    at_px: Vec2,
    depth: f32,
    color: Vec3,
    light: f32,
}

/// Draws a mesh on the CPU, lit from the camera, from both sides. A triangle's border between labels is drawn where it is
/// (see [`LabelledMesh::split_at_labels`]); hidden labels leave holes. Equal for any number of threads.
#[must_use]
pub fn draw_mesh(mesh: &LabelledMesh, camera: &ViewCamera, style: &RasterStyle) -> Image {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let labels = LabelColors::new(&mesh.vertices.tree, &style.hidden);
    let eye = camera.place();
    let corners: Vec<Option<Corner>> = (0..mesh.vertices.len())
        .into_par_iter()
        .map(|vertex| {
            let color = point_color(&mesh.vertices, vertex, style.coloring, &labels)?;
            let position = mesh.vertices.positions[vertex];
            let (at_px, depth) = camera.project(position)?;
            let facing = (eye - position).normalize_or_zero().dot(mesh.vertices.normals[vertex]).abs();
            let light = AMBIENT + (1.0 - AMBIENT) * facing;
            Some(Corner { at_px, depth, color: Vec3::from_array(color.map(f32::from)), light })
        })
        .collect();
    let bands = height.div_ceil(BAND);
    let mut by_band = vec![Vec::new(); bands];
    for triangle in &mesh.triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| corners[vertex as usize].as_ref()) else { continue };
        let rows = [a, b, c].map(|corner| corner.at_px.y);
        let (top, bottom) = (rows.into_iter().fold(f32::MAX, f32::min), rows.into_iter().fold(f32::MIN, f32::max));
        if bottom < 0.0 || top >= height as f32 {
            continue;
        }
        let last = (bottom as usize / BAND).min(bands - 1);
        by_band[top.max(0.0) as usize / BAND..=last].iter_mut().for_each(|members| members.push([a, b, c]));
    }
    let mut pixels = vec![(f32::INFINITY, style.background); width * height];
    pixels.par_chunks_mut(BAND * width.max(1)).zip(by_band).enumerate().for_each(|(band, (rows, members))| {
        for corners in members {
            draw_triangle(rows, width, band * BAND, corners);
        }
    });
    Image { width: camera.width, height: camera.height, pixels: pixels.into_iter().map(|(_, color)| color).collect() }
}

fn draw_triangle(rows: &mut [(f32, [u8; 3])], width: usize, top: usize, corners: [&Corner; 3]) {
    let [a, b, c] = corners.map(|corner| corner.at_px);
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let span = |values: [f32; 3], offset: usize, limit: usize| {
        let (low, high) = (values.into_iter().fold(f32::MAX, f32::min), values.into_iter().fold(f32::MIN, f32::max));
        let from = (low - offset as f32 - 0.5).ceil().max(0.0) as usize;
        let to = ((high - offset as f32 - 0.5).floor() + 1.0).max(0.0) as usize;
        from..to.min(limit)
    };
    for y in span([a.y, b.y, c.y], top, rows.len() / width) {
        for x in span([a.x, b.x, c.x], 0, width) {
            let at = Vec2::new(x as f32 + 0.5, (y + top) as f32 + 0.5);
            let shares = [(c - b).perp_dot(at - b), (a - c).perp_dot(at - c), (b - a).perp_dot(at - a)]
                .map(|share| share / area);
            if shares.iter().any(|share| *share < 0.0) {
                continue;
            }
            let mix = |value: fn(&Corner) -> f32| {
                shares.iter().zip(corners).map(|(share, corner)| share * value(corner)).sum::<f32>()
            };
            // Inverse depth is linear over the picture.
            let depth = 1.0 / mix(|corner| 1.0 / corner.depth);
            let pixel = &mut rows[y * width + x];
            if depth < pixel.0 {
                let color = shares.iter().zip(corners).map(|(share, corner)| corner.color * *share).sum::<Vec3>();
                *pixel = (depth, (color * mix(|corner| corner.light)).to_array().map(|channel| channel.round() as u8));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::masks::{Label, LabelId};
    use crate::scene::LabelledCloud;
    use crate::view::Coloring;

    /// A red square at z = 2 and, nearer, a green triangle over its lower left half, seen from the origin.
    fn scene() -> (LabelledMesh, ViewCamera) {
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 2.0));
        let near = [[-0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| Vec3::new(x, y, 1.0));
        let mut vertices = LabelledCloud::from_positions([&square[..], &near].concat());
        vertices.normals = vec![Vec3::NEG_Z; 7];
        vertices.labels = [1, 1, 1, 1, 2, 2, 2].map(LabelId).to_vec();
        for (id, color) in [(1, [200, 0, 0]), (2, [0, 200, 0])] {
            vertices.tree.set(Label { id: LabelId(id), name: id.to_string(), color, parent: None }).unwrap();
        }
        let mesh = LabelledMesh { vertices, triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6]] };
        let camera =
            ViewCamera { camera_from_world: glam::Mat4::IDENTITY, focal_px: 50.0, width: 80, height: 80, near: 0.01 };
        (mesh, camera)
    }

    #[test]
    fn the_nearer_triangle_hides_and_hidden_labels_do_not() {
        let (mesh, camera) = scene();
        let mut style = RasterStyle { coloring: Coloring::Label, ..RasterStyle::default() };
        let picture = draw_mesh(&mesh, &camera, &style);
        let at = |picture: &Image, x: usize, y: usize| picture.pixels[y * 80 + x];
        assert!(at(&picture, 30, 50)[1] > 150, "{:?}", at(&picture, 30, 50));
        assert!(at(&picture, 50, 30)[0] > 150 && at(&picture, 50, 30)[1] == 0);
        assert_eq!(at(&picture, 2, 2), style.background);
        // The square is 50 pixels wide: no cracks, no doubled pixels between its triangles.
        assert_eq!(picture.pixels.iter().filter(|&&color| color != style.background).count(), 50 * 50);
        style.hidden.insert(LabelId(2));
        assert!(at(&draw_mesh(&mesh, &camera, &style), 30, 50)[0] > 150);
    }
}
