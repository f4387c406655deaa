use egui::{Color32, Mesh, Rect, Ui};
use glam::{DVec2, DVec3};

use crate::textures::Textures;
use crate::{Look, ViewState};
use ostra_frames::Frame;
use ostra_view::ViewCamera;

/// Cells along each side of the picture: a bent lens shows as it is.
const CELLS: usize = 24;

/// The picture of the frame whose camera the view looks through, laid over what it sees; `depth` (world units) is where the
/// view's target lies.
pub(super) fn blend(
    ui: &Ui,
    (rect, camera, depth): (Rect, &ViewCamera, f32),
    look: &Look<'_>,
    view: &ViewState,
    textures: &mut Textures,
) {
    let opacity = view.prefs.scene.blend;
    let Some(frame) = view.scene.through.filter(|_| opacity > 0.0) else {
        return;
    };
    let picture = look.pictures.and_then(|pictures| pictures.picture(frame));
    let (Some(picture), Some(frame)) = (picture, look.project.frames.get(frame)) else {
        return;
    };
    let tint = Color32::WHITE.gamma_multiply(opacity);
    let mut mesh = Mesh::with_texture(textures.picture(ui.ctx(), &picture).id());
    let project = |ray: DVec3| Some(to_screen(rect, camera, camera.project(ray.as_vec3())?.0));
    if add_cells(&mut mesh, frame, f64::from(depth), project, tint) {
        ui.painter_at(rect).add(mesh);
    }
}

fn to_screen(rect: Rect, camera: &ViewCamera, px: glam::Vec2) -> egui::Pos2 {
    let (width, height) = (camera.width.max(1) as f32, camera.height.max(1) as f32);
    rect.min + egui::vec2(px.x / width * rect.width(), px.y / height * rect.height())
}

/// Cells of the frame's picture where `project` sees the points `depth` before its camera; `false` where it sees one not.
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
