use std::sync::Arc;

use egui::{Color32, Pos2, Rect, TextureId, Ui};

use crate::{SessionView, Shown, ViewState};
use ostra_view::{ImagePlane, PointsOver, Scene3d, SceneModel, SceneView, ViewCamera};

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

/// Returns the points of the shown frame to draw over the fused cloud.
pub(super) fn points_over(session: &SessionView<'_>) -> Option<PointsOver> {
    let points = session.depth_points.filter(|points| points.in_world)?;
    let is_model = session.cloud.is_none() || session.preview_cloud.is_some();
    (!is_model).then(|| PointsOver(Arc::clone(&points.cloud)))
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
