use std::sync::Arc;

use egui::{Color32, Pos2, Rect, TextureId, Ui};

use crate::scene::LabelledCloud;
use crate::view::{CloudView, Scene3d};

/// The cloud drawn on the window's GPU, shown as a texture.
pub(super) struct SceneCanvas {
    gpu: egui_wgpu::RenderState,
    view: CloudView,
    texture: Option<(TextureId, [u32; 2])>,
    empty: Arc<LabelledCloud>,
}

impl SceneCanvas {
    pub fn new(gpu: &egui_wgpu::RenderState) -> Self {
        let view = CloudView::new(&gpu.device, &gpu.queue);
        Self { gpu: gpu.clone(), view, texture: None, empty: Arc::default() }
    }

    /// Draws a bounded part of the scene and shows what stands; whether the picture is whole.
    pub fn draw(&mut self, ui: &Ui, rect: Rect, cloud: Option<&Arc<LabelledCloud>>, scene: &Scene3d) -> bool {
        self.view.set_cloud(cloud.unwrap_or(&self.empty));
        let whole = self.view.draw(scene);
        if let Some(id) = self.texture_id([scene.camera.width, scene.camera.height]) {
            let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            ui.painter().image(id, rect, uv, Color32::WHITE);
        }
        whole
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
