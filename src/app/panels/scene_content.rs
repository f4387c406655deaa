use std::sync::Arc;

use egui::{Color32, Pos2, Rect, TextureId, Ui};
use glam::Vec3;

use crate::{SessionView, Shown, ViewState};
use ostra_cloud::LabelledCloud;
use ostra_frames::Frame;
use ostra_view::{
    Axes, Bounds, ImagePlane, Orbit, Scene3d, SceneModel, SceneView, ViewCamera, default_view,
};

/// Part of the window that shows the scene.
pub(super) struct SceneViewport {
    /// Place in the window, in screen points.
    pub rect: Rect,
    /// Camera whose image fills the place.
    pub camera: ViewCamera,
    /// Distance of the view's target, in world units.
    pub depth: f32,
}

/// Scene rendered on the window's GPU and shown as a texture.
pub(super) struct SceneCanvas {
    gpu: egui_wgpu::RenderState,
    view: SceneView,
    texture: Option<(TextureId, [u32; 2])>,
    nothing: SceneModel,
}

impl SceneCanvas {
    pub fn new(gpu: &egui_wgpu::RenderState) -> Self {
        let view = SceneView::new(&gpu.device, &gpu.queue);
        Self {
            gpu: gpu.clone(),
            view,
            texture: None,
            nothing: SceneModel::Cloud(Arc::default()),
        }
    }

    /// Forgets the scene and its image.
    pub fn clear(&mut self) {
        self.view.clear();
        // The texture that egui knows shows the old image until it is replaced.
        if let Some((_, size)) = &mut self.texture {
            *size = [0; 2];
        }
    }

    /// Renders the next part of the scene and shows the result so far.
    ///
    /// The work per call is bounded. Returns `true` if the image is complete.
    pub fn draw(
        &mut self,
        ui: &Ui,
        rect: Rect,
        model: Option<SceneModel>,
        scene: &Scene3d,
    ) -> bool {
        self.view
            .set_model(model.unwrap_or_else(|| self.nothing.clone()));
        let whole = self.view.draw(scene);
        if let Some(id) = self.texture_id([scene.camera.width, scene.camera.height]) {
            let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(id, rect, uv, Color32::WHITE);
        }
        whole
    }

    /// Returns the values at the ends of the colour ramp.
    pub fn range(&self) -> Option<[f32; 2]> {
        self.view.range()
    }

    /// Returns egui's id of the view's texture, which is replaced after each change of size.
    fn texture_id(&mut self, size: [u32; 2]) -> Option<TextureId> {
        let texture = self.view.texture()?;
        let (device, filter) = (&self.gpu.device, Default::default());
        let mut renderer = self.gpu.renderer.write();
        let id = match self.texture {
            Some((id, known)) if known == size => id,
            Some((id, _)) => {
                renderer.update_egui_texture_from_wgpu_texture(device, texture, filter, id);
                id
            }
            None => renderer.register_native_texture(device, texture, filter),
        };
        self.texture = Some((id, size));
        Some(id)
    }
}

/// Content that the view was last framed for.
#[derive(Default)]
pub(super) struct Framed {
    pub(super) cloud: Option<Arc<LabelledCloud>>,
    pub(super) centre: Vec3,
    pub(super) radius: f32,
    pub(super) axes: Option<Axes>,
    /// Extent of the points along the axes.
    pub(super) extent: Option<Bounds>,
}

/// Maximum number of images shown in the scene.
const PLANES: usize = 200;

/// Returns the images at the ends of the frusta, of evenly spaced frames if there are many.
///
/// The frame that the view looks through is left out, because its image would hide everything.
pub(super) fn image_planes(
    session: &SessionView<'_>,
    view: &ViewState,
    size: f32,
) -> Vec<ImagePlane> {
    let Some(images) = session.images else {
        return Vec::new();
    };
    let frames = session
        .project
        .frames
        .iter()
        .enumerate()
        .filter(|(_, frame)| frame.posed_camera().is_some());
    let step = frames.clone().count().div_ceil(PLANES).max(1);
    let chosen = frames
        .step_by(step)
        .filter(|(number, _)| view.scene.through != Some(*number));
    chosen
        .filter_map(|(number, frame)| ImagePlane::of_frame(frame, size, images.thumbnail(number)?))
        .collect()
}

/// Returns the model to draw.
///
/// Points are drawn until the requested surface is loaded, and while depth maps are computed.
pub(super) fn model(session: &SessionView<'_>, view: &ViewState) -> Option<SceneModel> {
    match (
        view.shown,
        session.surface.filter(|_| session.preview_cloud.is_none()),
    ) {
        (Shown::Mesh | Shown::Voxels, Some(surface)) => {
            Some(SceneModel::Surface(Arc::clone(surface)))
        }
        (Shown::Wireframe, Some(surface)) => Some(SceneModel::Wireframe(Arc::clone(surface))),
        _ => session.points().cloned().map(SceneModel::Cloud),
    }
}

pub(super) fn bounds(session: &SessionView<'_>) -> Option<Bounds> {
    match session.points() {
        Some(cloud) if session.cloud.is_none() => Bounds::of(near_the_cameras(session, cloud)),
        Some(cloud) => Bounds::of(every_nth(cloud).map(|index| cloud.positions[index])),
        None => {
            let poses = session
                .project
                .frames
                .iter()
                .filter_map(Frame::posed_camera);
            Bounds::of(poses.map(|(_, pose)| pose.centre().as_vec3()))
        }
    }
}

/// Returns the camera centres and the half of the sparse points nearest to their mean.
///
/// Some sparse points are always far away and would make the bounds too large.
fn near_the_cameras<'a>(
    session: &'a SessionView<'_>,
    cloud: &'a LabelledCloud,
) -> impl Iterator<Item = Vec3> + 'a {
    let centres = || {
        session
            .project
            .frames
            .iter()
            .filter_map(Frame::posed_camera)
            .map(|(_, pose)| pose.centre().as_vec3())
    };
    let middle = centres().sum::<Vec3>() / centres().count().max(1) as f32;
    let mut points: Vec<Vec3> = every_nth(cloud)
        .map(|index| cloud.positions[index])
        .collect();
    points.sort_by(|a, b| {
        a.distance_squared(middle)
            .total_cmp(&b.distance_squared(middle))
    });
    points.truncate(points.len() / 2 + 1);
    points.into_iter().chain(centres())
}

pub(super) fn framing(session: &SessionView<'_>, aspect: f32) -> Option<Orbit> {
    match session.points() {
        Some(cloud) if session.cloud.is_some() => {
            default_view(&thinned(cloud), &session.project.frames, aspect)
        }
        _ => cameras_view(session),
    }
}

/// Returns a view of all cameras from behind, slightly from above and from the side, upright.
fn cameras_view(session: &SessionView<'_>) -> Option<Orbit> {
    let poses = session
        .project
        .frames
        .iter()
        .filter_map(Frame::posed_camera);
    let rotations = poses.map(|(_, pose)| pose.rotation.as_quat().conjugate());
    let forward = rotations
        .map(|world_from_camera| world_from_camera * Vec3::Z)
        .sum::<Vec3>();
    let Axes { up, .. } = Axes::of_cameras(&session.project.frames);
    let forward = forward.try_normalize().unwrap_or(Vec3::Z);
    Some(Orbit::framing(
        &bounds(session)?,
        forward + 0.5 * forward.cross(up) - 0.4 * up,
        up,
    ))
}

/// Returns evenly spaced point indices, enough to estimate the extent of the cloud.
pub(super) fn every_nth(cloud: &LabelledCloud) -> impl Iterator<Item = usize> {
    (0..cloud.len()).step_by((cloud.len() / 100_000).max(1))
}

fn thinned(cloud: &LabelledCloud) -> LabelledCloud {
    LabelledCloud {
        positions: every_nth(cloud)
            .map(|index| cloud.positions[index])
            .collect(),
        labels: every_nth(cloud).map(|index| cloud.labels[index]).collect(),
        ..LabelledCloud::default()
    }
}

/// Shows a text in place of the scene.
pub(super) fn message(ui: &Ui, rect: Rect, text: &str) {
    let color = ui.visuals().weak_text_color();
    let galley = ui.painter().layout(
        text.into(),
        egui::FontId::proportional(14.0),
        color,
        (rect.width() - 60.0).max(60.0),
    );
    ui.painter()
        .galley(rect.center() - galley.size() / 2.0, galley, color);
}
