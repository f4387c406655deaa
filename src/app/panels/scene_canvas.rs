use std::sync::Arc;

use egui::{Color32, Pos2, Rect, TextureId, Ui};

use ostra_view::{Model, Scene3d, SceneView};

/// The scene drawn on the window's GPU, shown as a texture.
pub(super) struct SceneCanvas {
    gpu: egui_wgpu::RenderState,
    view: SceneView,
    texture: Option<(TextureId, [u32; 2])>,
    nothing: Model,
}

impl SceneCanvas {
    pub fn new(gpu: &egui_wgpu::RenderState) -> Self {
        let view = SceneView::new(&gpu.device, &gpu.queue);
        Self {
            gpu: gpu.clone(),
            view,
            texture: None,
            nothing: Model::Cloud(Arc::default()),
        }
    }

    /// Draws a bounded part of the scene and shows what stands; whether the picture is whole.
    pub fn draw(&mut self, ui: &Ui, rect: Rect, model: Option<Model>, scene: &Scene3d) -> bool {
        self.view
            .set_model(model.unwrap_or_else(|| self.nothing.clone()));
        let whole = self.view.draw(scene);
        if let Some(id) = self.texture_id([scene.camera.width, scene.camera.height]) {
            let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(id, rect, uv, Color32::WHITE);
        }
        whole
    }

    /// What the ends of the ramp stand for that colours come from.
    pub fn range(&self) -> Option<[f32; 2]> {
        self.view.range()
    }

    /// egui's name for the view's texture, which is another one after each change of size.
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
