use super::pipelines::{COLOR_FORMAT, DEPTH_FORMAT};

/// The textures that the 3-D view is drawn into.
pub(super) struct Target {
    pub(super) size: (u32, u32),
    pub(super) color: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Target {
    pub(super) fn new(device: &wgpu::Device, size: (u32, u32)) -> Self {
        let texture = |format, usage| {
            let texture = device.create_texture(&wgpu::TextureDescriptor {
                label: Some("scene"),
                size: wgpu::Extent3d { width: size.0, height: size.1, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        };
        let color = texture(COLOR_FORMAT, wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC);
        Self { size, color, depth: texture(DEPTH_FORMAT, wgpu::TextureUsages::empty()) }
    }

    /// Begins a pass over what was drawn before, or over `background` where one is given.
    pub(super) fn begin<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
        background: Option<[u8; 3]>,
    ) -> wgpu::RenderPass<'e> {
        let load = background.map_or(wgpu::LoadOp::Load, |rgb| {
            let [r, g, b] = rgb.map(|channel| f64::from(channel) / 255.0);
            wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 })
        });
        let depth_load = if background.is_some() { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load };
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.color,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load, store: wgpu::StoreOp::Store },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations { load: depth_load, store: wgpu::StoreOp::Store }),
                stencil_ops: None,
            }),
            ..Default::default()
        })
    }
}
