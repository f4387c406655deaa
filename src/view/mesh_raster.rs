use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

use super::paint::Paint;
use super::raster::{Pixel, is_shown};
use super::{Clip, Projection, SceneStyle, Shot, ViewCamera};
use ostra_cloud::LabelledMesh;

/// Number of rows per parallel task.
const BAND: usize = 32;
/// Brightness of a surface that is seen edge-on; a surface seen face-on has 1.
pub(super) const AMBIENT: f32 = 0.35;

/// A vertex projected into the image.
struct Corner {
    at_px: Vec2,
    depth: f32,
    /// sRGB and opacity, 0–255.
    color: Vec4,
    light: f32,
    /// Position in the clip cube.
    in_cube: Vec3,
}

/// Draws a mesh on the CPU; both sides of a triangle are lit from the camera.
///
/// Label borders are drawn along triangle edges (see [`LabelledMesh::split_at_labels`]), and hidden
/// labels leave holes. The result is the same for any number of threads.
#[must_use]
pub fn draw_mesh(mesh: &LabelledMesh, camera: &ViewCamera, style: &SceneStyle) -> Shot {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let corners = corners(mesh, camera, style);
    let bands = height.div_ceil(BAND);
    let mut by_band = vec![Vec::new(); bands];
    for triangle in &mesh.triangles {
        let [Some(a), Some(b), Some(c)] = triangle.map(|vertex| corners[vertex as usize].as_ref())
        else {
            continue;
        };
        let rows = [a, b, c].map(|corner| corner.at_px.y);
        let (top, bottom) = (
            rows.into_iter().fold(f32::MAX, f32::min),
            rows.into_iter().fold(f32::MIN, f32::max),
        );
        if bottom < 0.0 || top >= height as f32 {
            continue;
        }
        let last = (bottom as usize / BAND).min(bands - 1);
        by_band[top.max(0.0) as usize / BAND..=last]
            .iter_mut()
            .for_each(|members| members.push([a, b, c]));
    }
    let mut pixels = vec![Pixel::background(style.background); width * height];
    pixels
        .par_chunks_mut(BAND * width.max(1))
        .zip(by_band)
        .enumerate()
        .for_each(|(band, (rows, members))| {
            for corners in members {
                draw_triangle(rows, width, band * BAND, corners, camera.projection);
            }
        });
    Shot::of_pixels(
        camera.width,
        camera.height,
        pixels.into_par_iter().map(|pixel| pixel.color),
    )
}

fn corners(mesh: &LabelledMesh, camera: &ViewCamera, style: &SceneStyle) -> Vec<Option<Corner>> {
    let paint = Paint::new(&mesh.vertices, &style.appearance);
    let eye = camera.place();
    let corner = |vertex: usize| {
        let color = paint.color(&mesh.vertices, vertex)?;
        let position = mesh.vertices.positions[vertex];
        let (at_px, depth) = camera.project(position)?;
        let facing = (eye - position)
            .normalize_or_zero()
            .dot(mesh.vertices.normals[vertex])
            .abs();
        let light = AMBIENT + (1.0 - AMBIENT) * facing;
        let color = Vec4::from_array(color.map(f32::from));
        Some(Corner {
            at_px,
            depth,
            color,
            light,
            in_cube: style.clip.in_cube(position),
        })
    };
    (0..mesh.vertices.len())
        .into_par_iter()
        .map(corner)
        .collect()
}

fn draw_triangle(
    rows: &mut [Pixel],
    width: usize,
    top: usize,
    corners: [&Corner; 3],
    projection: Projection,
) {
    let [a, b, c] = corners.map(|corner| corner.at_px);
    let area = (b - a).perp_dot(c - a);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let span = |values: [f32; 3], offset: usize, limit: usize| {
        let (low, high) = (
            values.into_iter().fold(f32::MAX, f32::min),
            values.into_iter().fold(f32::MIN, f32::max),
        );
        let from = (low - offset as f32 - 0.5).ceil().max(0.0) as usize;
        let to = ((high - offset as f32 - 0.5).floor() + 1.0).max(0.0) as usize;
        from..to.min(limit)
    };
    for y in span([a.y, b.y, c.y], top, rows.len() / width) {
        for x in span([a.x, b.x, c.x], 0, width) {
            let at = Vec2::new(x as f32 + 0.5, (y + top) as f32 + 0.5);
            let shares = [
                (c - b).perp_dot(at - b),
                (a - c).perp_dot(at - c),
                (b - a).perp_dot(at - a),
            ]
            .map(|share| share / area);
            if shares.iter().any(|share| *share < 0.0) {
                continue;
            }
            let pixel = &mut rows[y * width + x];
            let share = Vec3::from_array(shares);
            let depth = depth_at(share, corners, projection);
            if depth < pixel.depth && is_unclipped(share, corners, depth, projection) {
                let mut color = corners[0].color * share.x
                    + corners[1].color * share.y
                    + corners[2].color * share.z;
                color *= share
                    .dot(Vec3::from_array(corners.map(|corner| corner.light)))
                    .min(1.0);
                let [r, g, b, _] = color.to_array().map(|channel| channel.round() as u8);
                let opacity = corners[0].color.w as u8;
                if is_shown(opacity, x, y + top) {
                    *pixel = Pixel {
                        depth,
                        color: [r, g, b, opacity],
                    };
                }
            }
        }
    }
}

/// Returns the depth at a position in a triangle.
///
/// In perspective, 1 / depth is linear over the image; in an orthographic view, depth itself is.
fn depth_at(share: Vec3, corners: [&Corner; 3], projection: Projection) -> f32 {
    let depths = Vec3::from_array(corners.map(|corner| corner.depth));
    match projection {
        Projection::Perspective => 1.0 / share.dot(depths.recip()),
        Projection::Orthographic { .. } => share.dot(depths),
    }
}

fn is_unclipped(share: Vec3, corners: [&Corner; 3], depth: f32, projection: Projection) -> bool {
    let share = match projection {
        Projection::Perspective => {
            share * depth / Vec3::from_array(corners.map(|corner| corner.depth))
        }
        Projection::Orthographic { .. } => share,
    };
    let [a, b, c] = corners.map(|corner| corner.in_cube);
    Clip::is_in_cube(a * share.x + b * share.y + c * share.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Appearance, Axes, Bounds, Coloring};
    use ostra_cloud::LabelledCloud;
    use ostra_frames::Image;
    use ostra_masks::{Label, LabelId};

    /// A red square at z = 2 and a nearer green triangle over its lower left half.
    fn scene() -> (LabelledMesh, ViewCamera) {
        let square =
            [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 2.0));
        let near = [[-0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| Vec3::new(x, y, 1.0));
        let mut vertices = LabelledCloud::from_positions([&square[..], &near].concat());
        vertices.normals = vec![Vec3::NEG_Z; 7];
        vertices.labels = [1, 1, 1, 1, 2, 2, 2].map(LabelId).to_vec();
        for (id, color) in [(1, [200, 0, 0]), (2, [0, 200, 0])] {
            vertices
                .tree
                .set(Label {
                    id: LabelId(id),
                    name: id.to_string(),
                    color,
                    parent: None,
                })
                .unwrap();
        }
        let mesh = LabelledMesh {
            vertices,
            triangles: vec![[0, 1, 2], [0, 2, 3], [4, 5, 6]],
        };
        let camera = ViewCamera {
            camera_from_world: glam::Mat4::IDENTITY,
            focal_px: 50.0,
            projection: Projection::Perspective,
            width: 80,
            height: 80,
            near: 0.01,
        };
        (mesh, camera)
    }

    #[test]
    fn nearer_triangle_occludes_unless_its_label_is_hidden() {
        let (mesh, camera) = scene();
        let mut style = SceneStyle {
            appearance: Appearance {
                coloring: Coloring::Label,
                ..Default::default()
            },
            ..Default::default()
        };
        let image = draw_mesh(&mesh, &camera, &style).image;
        let at = |image: &Image, x: usize, y: usize| image.pixels[y * 80 + x];
        assert!(at(&image, 30, 50)[1] > 150, "{:?}", at(&image, 30, 50));
        assert!(at(&image, 50, 30)[0] > 150 && at(&image, 50, 30)[1] == 0);
        assert_eq!(at(&image, 2, 2), style.background);
        // The square is 50 pixels wide: no cracks, no doubled pixels between its triangles.
        assert_eq!(
            image
                .pixels
                .iter()
                .filter(|&&color| color != style.background)
                .count(),
            50 * 50
        );
        style.appearance.hidden.insert(LabelId(2));
        assert!(at(&draw_mesh(&mesh, &camera, &style).image, 30, 50)[0] > 150);
    }

    #[test]
    fn triangles_are_clipped_at_the_box_and_faint_ones_are_see_through() {
        let (mesh, camera) = scene();
        let mut style = SceneStyle {
            appearance: Appearance {
                coloring: Coloring::Label,
                ..Default::default()
            },
            ..Default::default()
        };
        let sides = Bounds {
            min: Vec3::splat(-9.0),
            max: Vec3::new(0.5, 9.0, 9.0),
        };
        style.clip = Clip::inside(
            &Axes {
                right: Vec3::X,
                up: Vec3::Y,
                forward: Vec3::Z,
            },
            &sides,
        );
        let shot = draw_mesh(&mesh, &camera, &style);
        let columns = |shot: &Shot, y: usize| {
            shot.opacity[y * 80..][..80]
                .iter()
                .filter(|&&opacity| opacity > 0)
                .count()
        };
        assert_eq!(
            columns(&shot, 20),
            38,
            "the square ends at x = 0.5, half as far to the right as before"
        );
        style.clip = Clip::default();
        (style.appearance.isolated, style.appearance.faint) = (Some(LabelId(1)), 0.25);
        let shot = draw_mesh(&mesh, &camera, &style);
        let green = |shot: &Shot| {
            shot.image
                .pixels
                .iter()
                .filter(|pixel| pixel[1] > 100)
                .count() as f32
        };
        style.appearance.isolated = None;
        let share = green(&shot) / green(&draw_mesh(&mesh, &camera, &style));
        assert!(
            (0.2..0.3).contains(&share),
            "a quarter of the pixels of the near triangle: {share}"
        );
    }
}
