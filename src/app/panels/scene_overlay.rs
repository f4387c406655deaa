use egui::{Align2, Color32, FontId, Mesh, Painter, Pos2, Rect, Stroke, Ui, Vec2};
use glam::{DVec2, DVec3, Vec3};

use super::scene_bar::coloring_text;
use super::scene_content::SceneViewport;
use crate::textures::Textures;
use crate::{SessionView, ViewState};
use ostra_cloud::measure::{Dimension, LengthUnit};
use ostra_frames::Frame;
use ostra_view::{Coloring, ViewCamera, ramp};

/// Longest scale bar in screen points.
const BAR: f32 = 140.0;
/// Length of the drawn axes in screen points.
const AXIS: f32 = 26.0;

/// Draws scale bar, axes and colour legend over the 3-D view.
///
/// The scale bar is valid at the distance of the view's target.
pub(super) fn marks(
    ui: &Ui,
    viewport: &SceneViewport,
    view: &ViewState,
    unit: LengthUnit,
    range: Option<[f32; 2]>,
) {
    let &SceneViewport {
        rect,
        ref camera,
        depth,
    } = viewport;
    let painter = ui.painter_at(rect);
    let ink = ink_on(view.prefs.scene.background.unwrap_or_else(|| {
        let fill = ui.visuals().extreme_bg_color;
        [fill.r(), fill.g(), fill.b()]
    }));
    if view.prefs.scene.scale_bar {
        let points_per_unit = camera.px_per_unit(depth) * rect.width() / camera.width.max(1) as f32;
        scale_bar(
            &painter,
            rect.center_bottom() + Vec2::new(0.0, -22.0),
            points_per_unit,
            unit,
            ink,
        );
    }
    if view.prefs.scene.axes {
        axes(
            &painter,
            rect.right_bottom() + Vec2::new(-46.0, -46.0),
            camera,
            ink,
        );
    }
    if let Some(ends) = legend_ends(view.coloring, unit, range) {
        legend(
            &painter,
            rect.left_bottom() + Vec2::new(12.0, -34.0),
            coloring_text(view.coloring),
            ends,
            ink,
        );
    }
}

/// Returns a dark colour for light backgrounds and a light one for dark backgrounds.
fn ink_on([r, g, b]: [u8; 3]) -> Color32 {
    let light = 0.299 * f32::from(r) + 0.587 * f32::from(g) + 0.114 * f32::from(b);
    Color32::from_gray(if light > 127.0 { 30 } else { 225 })
}

fn scale_bar(
    painter: &Painter,
    middle: Pos2,
    points_per_unit: f32,
    unit: LengthUnit,
    ink: Color32,
) {
    let Some(length) = round_length(BAR / points_per_unit) else {
        return;
    };
    let half = Vec2::new(length * points_per_unit / 2.0, 0.0);
    let stroke = Stroke::new(1.5, ink);
    painter.line_segment([middle - half, middle + half], stroke);
    for end in [middle - half, middle + half] {
        painter.line_segment(
            [end - Vec2::new(0.0, 4.0), end + Vec2::new(0.0, 4.0)],
            stroke,
        );
    }
    let text = length_text(length, unit);
    painter.text(
        middle - Vec2::new(0.0, 5.0),
        Align2::CENTER_BOTTOM,
        text,
        FontId::proportional(12.0),
        ink,
    );
}

/// Formats a round length in the unit with the shortest text.
fn length_text(length: f32, unit: LengthUnit) -> String {
    let unit = match unit {
        LengthUnit::World => LengthUnit::World,
        _ if length < 0.0099 => LengthUnit::Millimetre,
        _ if length < 0.99 => LengthUnit::Centimetre,
        _ => LengthUnit::Metre,
    };
    let value = unit.value(f64::from(length), Dimension::Length) as f32;
    if (1e-4..1e5).contains(&value) {
        format!("{value} {}", unit.sign())
    } else {
        format!("{value:e} {}", unit.sign())
    }
}

/// Returns the largest of 1, 2 and 5 times a power of ten that is at most `most`.
fn round_length(most: f32) -> Option<f32> {
    let decade = 10_f64.powf(f64::from(most).log10().floor());
    let length = [5.0, 2.0, 1.0]
        .into_iter()
        .map(|digit| digit * decade)
        .find(|&length| length <= f64::from(most) * 1.000_001)?;
    (length.is_finite() && length > 0.0).then_some(length as f32)
}

/// Draws the directions of the world axes in the view, the farthest first.
fn axes(painter: &Painter, middle: Pos2, camera: &ViewCamera, ink: Color32) {
    let axis = |axis: Vec3, name: &'static str, color| {
        (
            camera.camera_from_world.transform_vector3(axis),
            name,
            color,
        )
    };
    let mut all = [
        axis(Vec3::X, "X", Color32::from_rgb(226, 72, 72)),
        axis(Vec3::Y, "Y", Color32::from_rgb(88, 178, 80)),
        axis(Vec3::Z, "Z", Color32::from_rgb(78, 128, 240)),
    ];
    all.sort_by(|a, b| b.0.z.total_cmp(&a.0.z));
    for (along, name, color) in all {
        let end = middle + Vec2::new(along.x, along.y) * AXIS;
        painter.line_segment([middle, end], Stroke::new(2.0, color));
        let beyond = middle + Vec2::new(along.x, along.y) * (AXIS + 9.0);
        painter.text(
            beyond,
            Align2::CENTER_CENTER,
            name,
            FontId::proportional(11.0),
            ink,
        );
    }
}

/// Returns the texts at the ends of the colour ramp.
fn legend_ends(
    coloring: Coloring,
    unit: LengthUnit,
    range: Option<[f32; 2]>,
) -> Option<[String; 2]> {
    let [low, high] = range?;
    Some(match coloring {
        Coloring::Confidence | Coloring::Conflict => {
            [low, high].map(|share| format!("{:.0} %", share * 100.0))
        }
        Coloring::Views => [low, high].map(|views| format!("{views:.0}")),
        _ => [low, high].map(|height| unit.text(f64::from(height), Dimension::Length)),
    })
}

fn legend(painter: &Painter, corner: Pos2, title: &str, ends: [String; 2], ink: Color32) {
    const STEPS: u32 = 32;
    let bar = Rect::from_min_size(corner, Vec2::new(120.0, 8.0));
    let mut mesh = Mesh::default();
    for step in 0..=STEPS {
        let share = step as f32 / STEPS as f32;
        let [r, g, b] = ramp(share);
        let x = bar.left() + bar.width() * share;
        mesh.colored_vertex(Pos2::new(x, bar.top()), Color32::from_rgb(r, g, b));
        mesh.colored_vertex(Pos2::new(x, bar.bottom()), Color32::from_rgb(r, g, b));
        if step > 0 {
            let n = step * 2;
            mesh.add_triangle(n - 2, n - 1, n);
            mesh.add_triangle(n - 1, n, n + 1);
        }
    }
    painter.add(mesh);
    let font = FontId::proportional(11.0);
    painter.text(
        bar.left_top() - Vec2::new(0.0, 3.0),
        Align2::LEFT_BOTTOM,
        title,
        font.clone(),
        ink,
    );
    let [low, high] = ends;
    let y = bar.bottom() + 3.0;
    for (x, align, text) in [
        (bar.left(), Align2::LEFT_TOP, low),
        (bar.right(), Align2::RIGHT_TOP, high),
    ] {
        painter.text(Pos2::new(x, y), align, text, font.clone(), ink);
    }
}

/// Cells per side of the image mesh, enough to show lens distortion.
const CELLS: usize = 24;

/// Draws the image of the camera that the view looks through over the scene.
///
/// The image is projected at the distance of the view's target.
pub(super) fn blend(
    ui: &Ui,
    viewport: &SceneViewport,
    session: &SessionView<'_>,
    view: &ViewState,
    textures: &mut Textures,
) {
    let opacity = view.prefs.scene.blend;
    let Some(frame) = view.scene.through.filter(|_| opacity > 0.0) else {
        return;
    };
    let image = session.images.and_then(|images| images.image(frame));
    let (Some(image), Some(frame)) = (image, session.project.frames.get(frame)) else {
        return;
    };
    let tint = Color32::WHITE.gamma_multiply(opacity);
    let texture = textures.image(ui.ctx(), &image, view.tone);
    let mut mesh = Mesh::with_texture(texture.id());
    let project = |ray: DVec3| {
        Some(to_screen(
            viewport,
            viewport.camera.project(ray.as_vec3())?.0,
        ))
    };
    if add_cells(&mut mesh, frame, f64::from(viewport.depth), project, tint) {
        ui.painter_at(viewport.rect).add(mesh);
    }
}

/// Returns the screen position of a pixel of the view.
pub(super) fn to_screen(viewport: &SceneViewport, px: glam::Vec2) -> egui::Pos2 {
    let SceneViewport { rect, camera, .. } = viewport;
    let (width, height) = (camera.width.max(1) as f32, camera.height.max(1) as f32);
    rect.min + egui::vec2(px.x / width * rect.width(), px.y / height * rect.height())
}

/// Adds the cells of a frame's image, placed at `depth` in front of its camera.
///
/// Returns `false` if `project` cannot see one of them.
fn add_cells(
    mesh: &mut Mesh,
    frame: &Frame,
    depth: f64,
    project: impl Fn(DVec3) -> Option<egui::Pos2>,
    tint: Color32,
) -> bool {
    let Some((camera, pose)) = frame.posed_camera() else {
        return false;
    };
    let world_from_camera = pose.inverse();
    let share = |k: usize| k as f64 / CELLS as f64;
    for (y, x) in (0..=CELLS).flat_map(|y| (0..=CELLS).map(move |x| (y, x))) {
        let px = DVec2::new(
            share(x) * f64::from(camera.width),
            share(y) * f64::from(camera.height),
        );
        let ray = camera.unproject(px).extend(1.0) * depth;
        let Some(at) = project(world_from_camera.transform(ray)) else {
            return false;
        };
        let uv = egui::pos2(share(x) as f32, share(y) as f32);
        mesh.vertices.push(egui::epaint::Vertex {
            pos: at,
            uv,
            color: tint,
        });
    }
    let at = |y: usize, x: usize| (y * (CELLS + 1) + x) as u32;
    for (y, x) in (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| (y, x))) {
        mesh.add_triangle(at(y, x), at(y, x + 1), at(y + 1, x));
        mesh.add_triangle(at(y + 1, x), at(y, x + 1), at(y + 1, x + 1));
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_bar_lengths_are_round() {
        let lengths = [0.034, 1.0, 1.99, 7.0, 430.0].map(|most| round_length(most).unwrap());
        assert_eq!(lengths, [0.02, 1.0, 1.0, 5.0, 200.0]);
        assert_eq!((round_length(0.0), round_length(f32::NAN)), (None, None));
        let texts =
            [0.002, 0.05, 0.5, 1.0, 200.0].map(|length| length_text(length, LengthUnit::Metre));
        assert_eq!(texts, ["2 mm", "5 cm", "50 cm", "1 m", "200 m"]);
        assert_eq!(length_text(0.05, LengthUnit::World), "0.05 units");
    }
}
